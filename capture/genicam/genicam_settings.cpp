#include "capture/genicam/genicam_settings.h"

#include <arv.h>
#include <fmt/format.h>

#include <cmath>

#include "capture/frame/frame_checks.h"

namespace etalon {
namespace {

using std::chrono::microseconds;

// A list of the library's, freed here. Entries without a name are left out.
std::vector<std::string> taken_names(const char** names, guint count) {
    std::vector<std::string> taken;
    for (guint i = 0; i < count; ++i)
        if (names[i])
            taken.push_back(names[i]);
    g_free(names);
    return taken;
}

// ---- off: whatever changes pixels by itself --------------------------------------------------

void switch_automatics_off(const GenicamDevice& device) {
    for (const char* feature : {"ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto"}) {
        if (!device.has(feature))
            continue;
        const std::string request = fmt::format("switch {} off", feature);
        device.call(request, arv_camera_set_string, feature, "Off");
        const std::string now = text_or_empty(device.call(request, arv_camera_get_string, feature));
        if (now != "Off")
            device.fail(request, "the device keeps it at " + now);
    }
}

// Functions that most devices do not have, and some will not part with.
std::vector<std::string> switch_enhancements_off(const GenicamDevice& device) {
    std::vector<std::string> remarks;
    for (const char* feature : {"GammaEnable", "LUTEnable", "SharpnessEnable", "SharpeningEnable",
                                "NoiseReductionEnable"}) {
        if (!device.has(feature))
            continue;
        ErrorSlot refused;
        arv_camera_set_boolean(device.camera(), feature, FALSE, refused.out());
        if (device.call(fmt::format("read {}", feature), arv_camera_get_boolean, feature))
            remarks.push_back(fmt::format("{} stays on: it cannot be switched off", feature));
    }
    return remarks;
}

// ---- image -----------------------------------------------------------------------------------

std::vector<std::string> available_formats(const GenicamDevice& device) {
    guint count = 0;
    const char** names = device.ask("read pixel formats", [&](GError** e) {
        return arv_camera_dup_available_pixel_formats_as_strings(device.camera(), &count, e);
    });
    return taken_names(names, count);
}

// The plainest monochrome format of the device that holds `bits`.
std::string monochrome_format(const GenicamDevice& device, int bits) {
    if (bits < 1 || bits > 16)
        device.fail("configure", fmt::format("{} bits a pixel: only 1 to 16 are possible", bits));
    if (bits <= 8)
        return "Mono8";
    const std::vector<std::string> available = available_formats(device);
    for (const int held : {10, 12, 14, 16})
        for (const char* packing : {"", "p", "Packed"}) {
            const std::string name = fmt::format("Mono{}{}", held, packing);
            if (held >= bits && find_pfnc_format(name) &&
                std::find(available.begin(), available.end(), name) != available.end())
                return name;
        }
    return "Mono16";  // which the device will refuse
}

const PixelFormat* set_pixel_format(const GenicamDevice& device, const CaptureSettings& wanted) {
    const std::string name =
        wanted.format.empty() ? monochrome_format(device, wanted.bits) : wanted.format;
    const std::string request = "set pixel format " + name;
    const PixelFormat* format = find_pfnc_format(name);
    if (!format)
        device.fail(request, "this program cannot unpack it");
    const bool fits = wanted.bits <= format->bits && (wanted.bits > 8) == (format->bits > 8);
    if (wanted.bits != 0 && !fits)
        device.fail(fmt::format("set {} bits a pixel", wanted.bits),
                    fmt::format("{} has {}", name, format->bits));
    device.call(request, arv_camera_set_pixel_format_from_string, name.c_str());
    const auto code = device.call(request, arv_camera_get_pixel_format);
    if (static_cast<std::uint32_t>(code) != format->pfnc_code)
        device.fail(request, fmt::format("the device uses format {:#x}", code));
    return format;
}

// A negative offset and a size of 0 keep the device's: moving moves the principal point.
void set_image_size(const GenicamDevice& device, int width, int height) {
    device.call(fmt::format("set image size {}x{}", width, height), arv_camera_set_region, -1, -1,
                width, height);
}

// ---- exposure and levels ---------------------------------------------------------------------

bool has_gain(const GenicamDevice& device) {
    return device.says_yes(
        [&](GError** e) { return arv_camera_is_gain_available(device.camera(), e); });
}

bool has_black_level(const GenicamDevice& device) {
    return device.says_yes(
        [&](GError** e) { return arv_camera_is_black_level_available(device.camera(), e); });
}

void set_exposure(const GenicamDevice& device, microseconds exposure) {
    if (exposure.count() == 0)
        return;
    device.call(fmt::format("set exposure {} us", exposure.count()), arv_camera_set_exposure_time,
                static_cast<double>(exposure.count()));
}

// A device without a feature is read back without it, and a wish for it refused then.
void set_levels(const GenicamDevice& device, const CaptureSettings& wanted) {
    if (has_gain(device))
        device.call(fmt::format("set gain {} dB", wanted.gain_db), arv_camera_set_gain,
                    wanted.gain_db);
    if (wanted.black_level && has_black_level(device))
        device.call(fmt::format("set black level {}", *wanted.black_level),
                    arv_camera_set_black_level, *wanted.black_level);
}

// The device's own step of the exposure time, and at least our own resolution.
double exposure_step_us(const GenicamDevice& device) {
    for (const char* feature : {"ExposureTime", "ExposureTimeAbs"}) {
        ErrorSlot missing;
        const double step = arv_camera_get_float_increment(device.camera(), feature, missing.out());
        if (!missing && std::isfinite(step))
            return std::max(step, 0.5);
    }
    return 0.5;
}

// ---- trigger ---------------------------------------------------------------------------------

std::string trigger_in_force(const GenicamDevice& device) {
    if (!device.has("TriggerMode"))
        return "none";
    const std::string mode =
        text_or_empty(device.call("read trigger mode", arv_camera_get_string, "TriggerMode"));
    if (mode == "Off")
        return "none";
    return text_or_empty(device.call("read trigger source", arv_camera_get_trigger_source));
}

void set_trigger(const GenicamDevice& device, const std::string& wanted) {
    ArvCamera* camera = device.camera();
    device.call("set acquisition mode", arv_camera_set_acquisition_mode,
                ARV_ACQUISITION_MODE_CONTINUOUS);
    const bool by_software = device.says_yes(
        [&](GError** e) { return arv_camera_is_software_trigger_supported(camera, e); });
    const std::string source = !wanted.empty() ? wanted : by_software ? "Software" : "none";
    const std::string request = "set trigger " + source;
    if (source != "none")
        device.call(request, arv_camera_set_trigger, source.c_str());
    else if (device.has("TriggerMode"))
        device.call(request, arv_camera_clear_triggers);
    if (const std::string now = trigger_in_force(device); now != source)
        device.fail(request, "the device uses " + now);
}

// ---- features by name ------------------------------------------------------------------------

ArvGcNode* feature_node(const GenicamDevice& device, const std::string& name) {
    return arv_device_get_feature(arv_camera_get_device(device.camera()), name.c_str());
}

double feature_number(const GenicamDevice& device, const std::string& name) {
    ArvGcNode* node = feature_node(device, name);
    return device.ask("read " + name, [&](GError** e) -> double {
        if (ARV_IS_GC_BOOLEAN(node))
            return arv_gc_boolean_get_value(ARV_GC_BOOLEAN(node), e) ? 1.0 : 0.0;
        if (ARV_IS_GC_ENUMERATION(node))
            return static_cast<double>(
                arv_gc_enumeration_get_int_value(ARV_GC_ENUMERATION(node), e));
        if (ARV_IS_GC_INTEGER(node))
            return static_cast<double>(arv_gc_integer_get_value(ARV_GC_INTEGER(node), e));
        return arv_gc_float_get_value(ARV_GC_FLOAT(node), e);
    });
}

// Through the camera where a range is to be checked.
void set_feature(const GenicamDevice& device, const std::string& name, double value) {
    ArvGcNode* node = feature_node(device, name);
    const std::string request = fmt::format("set {} to {}", name, value);
    const auto whole = static_cast<gint64>(std::llround(value));
    device.ask(request, [&](GError** e) {
        if (ARV_IS_GC_BOOLEAN(node))
            arv_camera_set_boolean(device.camera(), name.c_str(), value != 0.0, e);
        else if (ARV_IS_GC_ENUMERATION(node))
            arv_gc_enumeration_set_int_value(ARV_GC_ENUMERATION(node), whole, e);
        else if (ARV_IS_GC_INTEGER(node))
            arv_camera_set_integer(device.camera(), name.c_str(), whole, e);
        else if (ARV_IS_GC_FLOAT(node))
            arv_camera_set_float(device.camera(), name.c_str(), value, e);
        else
            device.fail(request, "the device has no such number");
    });
}

// ---- reading back ----------------------------------------------------------------------------

CaptureSettings read_back(const GenicamDevice& device, const CaptureSettings& wanted,
                          const PixelFormat& format) {
    CaptureSettings actual;
    int x = 0, y = 0;
    device.call("read image size", arv_camera_get_region, &x, &y, &actual.width, &actual.height);
    actual.format = format.pfnc;
    actual.bits = wanted.bits ? wanted.bits : format.bits;
    const double exposure_us = device.call("read exposure", arv_camera_get_exposure_time);
    actual.exposure = microseconds(std::llround(exposure_us));
    if (has_gain(device))
        actual.gain_db = device.call("read gain", arv_camera_get_gain);
    if (has_black_level(device))
        actual.black_level = device.call("read black level", arv_camera_get_black_level);
    actual.trigger = trigger_in_force(device);
    for (const auto& control : wanted.controls)
        actual.controls[control.first] = feature_number(device, control.first);
    return actual;
}

// ---- listing ---------------------------------------------------------------------------------

FrameSizes frame_sizes(const GenicamDevice& device) {
    ArvCamera* camera = device.camera();
    FrameSizes sizes;
    device.call("read image sizes", arv_camera_get_width_bounds, &sizes.smallest.width,
                &sizes.largest.width);
    device.call("read image sizes", arv_camera_get_height_bounds, &sizes.smallest.height,
                &sizes.largest.height);
    ErrorSlot missing_x, missing_y;
    sizes.step = {std::max(1, arv_camera_get_width_increment(camera, missing_x.out())),
                  std::max(1, arv_camera_get_height_increment(camera, missing_y.out()))};
    return sizes;
}

// Bounds that say nothing are the largest numbers there are.
std::optional<double> said(double bound) {
    return std::abs(bound) < 1e18 ? std::optional(bound) : std::nullopt;
}

void describe_number(const GenicamDevice& device, ArvGcNode* node, CameraControl& control) {
    const auto describe = [&](auto* number, auto low, auto high, auto step, auto unit) {
        ErrorSlot ignored[2], no_step;
        control.low = said(static_cast<double>(low(number, ignored[0].out())));
        control.high = said(static_cast<double>(high(number, ignored[1].out())));
        const auto increment = static_cast<double>(step(number, no_step.out()));
        if (!no_step && increment > 1e-300)  // the smallest number there is: no step
            control.step = said(increment);
        control.unit = text_or_empty(unit(number));
    };
    if (ARV_IS_GC_FLOAT(node))
        describe(ARV_GC_FLOAT(node), arv_gc_float_get_min, arv_gc_float_get_max,
                 arv_gc_float_get_inc, arv_gc_float_get_unit);
    else
        describe(ARV_GC_INTEGER(node), arv_gc_integer_get_min, arv_gc_integer_get_max,
                 arv_gc_integer_get_inc, arv_gc_integer_get_unit);
    control.value = fmt::format("{:g}", feature_number(device, control.name));
}

void describe_choice(const GenicamDevice& device, CameraControl& control) {
    guint count = 0;
    ErrorSlot missing, unreadable;
    const char** names = arv_camera_dup_available_enumerations_as_strings(
        device.camera(), control.name.c_str(), &count, missing.out());
    control.choices = taken_names(names, missing ? 0 : count);
    const char* now =
        arv_camera_get_string(device.camera(), control.name.c_str(), unreadable.out());
    if (!unreadable)
        control.value = text_or_empty(now);
}

std::optional<CameraControl> described(const GenicamDevice& device, const std::string& name) {
    ArvGcNode* node = feature_node(device, name);
    if (!node || !device.has(name.c_str()))
        return std::nullopt;
    CameraControl control;
    control.name = name;
    control.read_only = arv_gc_feature_node_get_actual_access_mode(ARV_GC_FEATURE_NODE(node)) ==
                        ARV_GC_ACCESS_MODE_RO;
    if (ARV_IS_GC_BOOLEAN(node))
        control.value = fmt::format("{:g}", feature_number(device, name));
    else if (ARV_IS_GC_ENUMERATION(node))
        describe_choice(device, control);
    else if (ARV_IS_GC_FLOAT(node) || ARV_IS_GC_INTEGER(node))
        describe_number(device, node, control);
    else
        return std::nullopt;  // a command
    return control;
}

}  // namespace

GenicamCapture configure_genicam(const GenicamDevice& device, const CaptureSettings& wanted) {
    GenicamCapture capture;
    switch_automatics_off(device);
    capture.remarks = switch_enhancements_off(device);
    capture.chunks = switch_chunks_on(device);
    capture.format = set_pixel_format(device, wanted);
    set_image_size(device, wanted.width, wanted.height);
    set_exposure(device, wanted.exposure);
    set_levels(device, wanted);
    for (const auto& [name, value] : wanted.controls)
        set_feature(device, name, value);
    capture.chunks.active = chunks_are_on(device);
    set_trigger(device, wanted.trigger);
    capture.settings = read_back(device, wanted, *capture.format);
    capture.exposure_step_us = exposure_step_us(device);
    if (const auto difference =
            first_difference(wanted, capture.settings, capture.exposure_step_us))
        device.fail(difference->request, difference->cause);
    if (has_gain(device) && !device.has("Gain"))
        capture.remarks.emplace_back(
            "the gain in dB is written as it is to a feature without a unit");
    capture.payload = device.call("read payload size", arv_camera_get_payload);
    return capture;
}

// Formats, and the features of SFNC's acquisition and analog control.
CameraAbilities genicam_abilities(const GenicamDevice& device) {
    CameraAbilities abilities;
    const FrameSizes sizes = frame_sizes(device);
    for (const std::string& name : available_formats(device)) {
        const PixelFormat* format = find_pfnc_format(name);
        abilities.formats.push_back({name, "", format ? format->bits : 0, {sizes}});
    }
    for (const char* category : {"AcquisitionControl", "AnalogControl"}) {
        ArvGcNode* node = feature_node(device, category);
        if (!node || !ARV_IS_GC_CATEGORY(node))
            continue;
        for (const GSList* item = arv_gc_category_get_features(ARV_GC_CATEGORY(node)); item;
             item = item->next)
            if (auto control = described(device, static_cast<const char*>(item->data)))
                abilities.controls.push_back(*control);
    }
    return abilities;
}

}  // namespace etalon
