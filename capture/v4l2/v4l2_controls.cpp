#include "capture/v4l2/v4l2_controls.h"

#include <fmt/format.h>
#include <linux/videodev2.h>

#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>

namespace etalon {
namespace {

using std::chrono::microseconds;

constexpr int exposure_unit_us = 100;  // of V4L2_CID_EXPOSURE_ABSOLUTE

// Where a control is to be when it does nothing.
struct Rest {
    enum class Place { value, lowest, normal };
    std::uint32_t id;
    Place place;
    std::int64_t value = 0;
};
using enum Rest::Place;

// Automatic functions first: while they run, the controls below them cannot be set.
constexpr Rest rests[] = {
    {V4L2_CID_EXPOSURE_AUTO, value, V4L2_EXPOSURE_MANUAL},
    {V4L2_CID_EXPOSURE_AUTO_PRIORITY, value},
    {V4L2_CID_AUTOGAIN, value},
    {V4L2_CID_AUTO_WHITE_BALANCE, value},
    {V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE, value, V4L2_WHITE_BALANCE_MANUAL},
    {V4L2_CID_HUE_AUTO, value},
    {V4L2_CID_AUTOBRIGHTNESS, value},
    {V4L2_CID_CHROMA_AGC, value},
    {V4L2_CID_ISO_SENSITIVITY_AUTO, value, V4L2_ISO_SENSITIVITY_MANUAL},
    {V4L2_CID_FOCUS_AUTO, value},
    {V4L2_CID_SCENE_MODE, value, V4L2_SCENE_MODE_NONE},
    {V4L2_CID_POWER_LINE_FREQUENCY, value, V4L2_CID_POWER_LINE_FREQUENCY_DISABLED},
    {V4L2_CID_BAND_STOP_FILTER, value},
    {V4L2_CID_WIDE_DYNAMIC_RANGE, value},
    {V4L2_CID_IMAGE_STABILIZATION, value},
    {V4L2_CID_COLORFX, value, V4L2_COLORFX_NONE},
    {V4L2_CID_TEST_PATTERN, value},
    {V4L2_CID_HFLIP, value},
    {V4L2_CID_VFLIP, value},
    {V4L2_CID_ROTATE, value},
    {V4L2_CID_BACKLIGHT_COMPENSATION, lowest},
    {V4L2_CID_SHARPNESS, lowest},
    {V4L2_CID_GAIN, lowest},
    {V4L2_CID_BRIGHTNESS, normal},
    {V4L2_CID_CONTRAST, normal},
    {V4L2_CID_GAMMA, normal},
    {V4L2_CID_SATURATION, normal},
    {V4L2_CID_HUE, normal},
};

// Drivers' own enhancing functions have no number that all share, only names.
constexpr std::string_view enhancing_names[] = {"noise_reduction", "denoise", "hdr"};

std::string normalised(std::string_view name) {
    std::string result;
    for (const char c : name) {
        const auto letter = static_cast<unsigned char>(c);
        if (std::isalnum(letter))
            result += static_cast<char>(std::tolower(letter));
        else if (!result.empty() && result.back() != '_')
            result += '_';
    }
    while (!result.empty() && result.back() == '_')
        result.pop_back();
    return result;
}

bool is_menu(std::uint32_t type) {
    return type == V4L2_CTRL_TYPE_MENU || type == V4L2_CTRL_TYPE_INTEGER_MENU;
}

bool has_a_number(std::uint32_t type) {
    return type == V4L2_CTRL_TYPE_INTEGER || type == V4L2_CTRL_TYPE_INTEGER64 ||
           type == V4L2_CTRL_TYPE_BOOLEAN || type == V4L2_CTRL_TYPE_BITMASK || is_menu(type);
}

bool enhances(const std::string& name) {
    return std::any_of(std::begin(enhancing_names), std::end(enhancing_names),
                       [&](std::string_view part) { return name.find(part) != name.npos; });
}

}  // namespace

V4l2Controls::V4l2Controls(V4l2Device& device) : device_(device) {
    v4l2_query_ext_ctrl answer{};
    answer.id = V4L2_CTRL_FLAG_NEXT_CTRL;
    while (controls_.size() < 1000 && device_.ask(VIDIOC_QUERY_EXT_CTRL, &answer) == 0) {
        if (has_a_number(answer.type) && !(answer.flags & V4L2_CTRL_FLAG_DISABLED))
            controls_.push_back(
                {answer.id, answer.type, answer.flags,
                 normalised({answer.name, strnlen(answer.name, sizeof answer.name)}),
                 answer.minimum, answer.maximum, static_cast<std::int64_t>(answer.step),
                 answer.default_value});
        answer.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    }
    if (device_.lost())
        device_.fail("list the controls", ENODEV);
}

const V4l2Controls::Control* V4l2Controls::find(std::uint32_t id) const {
    const auto found = std::find_if(controls_.begin(), controls_.end(),
                                    [=](const Control& control) { return control.id == id; });
    return found == controls_.end() ? nullptr : &*found;
}

const V4l2Controls::Control& V4l2Controls::named(const std::string& name,
                                                 const std::string& what) const {
    const auto found =
        std::find_if(controls_.begin(), controls_.end(),
                     [&](const Control& control) { return control.name == normalised(name); });
    if (found == controls_.end())
        device_.fail(what, "the device has no such control");
    return *found;
}

int V4l2Controls::transfer(unsigned long direction, const Control& control, std::int64_t& value) {
    const bool is_wide = control.type == V4L2_CTRL_TYPE_INTEGER64;
    v4l2_ext_control one{};
    one.id = control.id;
    if (is_wide)
        one.value64 = value;
    else
        one.value = static_cast<std::int32_t>(value);
    v4l2_ext_controls request{};
    request.which = V4L2_CTRL_WHICH_CUR_VAL;
    request.count = 1;
    request.controls = &one;
    const int error = device_.ask(direction, &request);
    value = is_wide ? one.value64 : one.value;
    return error;
}

int V4l2Controls::read(const Control& control, std::int64_t& value) {
    return transfer(VIDIOC_G_EXT_CTRLS, control, value);
}

int V4l2Controls::write(const Control& control, std::int64_t value) {
    return transfer(VIDIOC_S_EXT_CTRLS, control, value);
}

// ---- setting ---------------------------------------------------------------------------------

std::vector<std::string> V4l2Controls::bring_to_rest() {
    std::vector<std::string> remarks;
    const auto bring = [&](const Control& control, std::int64_t rest) {
        if (const auto remark = bring_to(control, rest))
            remarks.push_back(*remark);
    };
    for (const Rest& rest : rests) {
        const Control* control = find(rest.id);
        if (control)
            bring(*control, rest.place == value    ? rest.value
                            : rest.place == lowest ? control->low
                                                   : control->normal);
    }
    for (const Control& control : controls_)
        if (enhances(control.name))
            bring(control, control.low);
    return remarks;
}

// Nothing if it is there.
std::optional<std::string> V4l2Controls::bring_to(const Control& control, std::int64_t rest) {
    std::int64_t actual = 0;
    if (read(control, actual) == 0 && actual == rest)
        return std::nullopt;
    const int refused = write(control, rest);
    if (device_.lost())
        device_.fail("set " + control.name, ENODEV);
    if (const int error = read(control, actual))
        return fmt::format("{} cannot be read: {}", control.name, describe_error(error));
    if (actual == rest)
        return std::nullopt;
    return fmt::format("{} stays at {}: it cannot be set to {}{}", control.name, actual, rest,
                       refused ? ", " + describe_error(refused) : "");
}

void V4l2Controls::set_checked(const Control& control, std::int64_t value,
                               const std::string& what) {
    if (value < control.low || value > control.high)
        device_.fail(what,
                     fmt::format("{} takes {} to {}", control.name, control.low, control.high));
    if (const int error = write(control, value))
        device_.fail(what, error);
    std::int64_t actual = 0;
    if (const int error = read(control, actual))
        device_.fail(what, error);
    if (actual != value)
        device_.fail(what, fmt::format("the device uses {} = {}", control.name, actual));
}

void V4l2Controls::set(const std::string& name, double value) {
    const std::string what = fmt::format("set control {} = {}", name, value);
    const Control& control = named(name, what);
    if (value != std::floor(value) || std::abs(value) > 1e15)
        device_.fail(what, "controls are whole numbers");
    set_checked(control, static_cast<std::int64_t>(value), what);
}

double V4l2Controls::get(const std::string& name) {
    const std::string what = "read control " + name;
    std::int64_t value = 0;
    if (const int error = read(named(name, what), value))
        device_.fail(what, error);
    return static_cast<double>(value);
}

// ---- exposure --------------------------------------------------------------------------------

std::optional<microseconds> V4l2Controls::exposure() {
    const Control* control = find(V4L2_CID_EXPOSURE_ABSOLUTE);
    std::int64_t units = 0;
    if (!control || read(*control, units) != 0)
        return std::nullopt;
    return microseconds(units * exposure_unit_us);
}

microseconds V4l2Controls::exposure_step() const {
    const Control* control = find(V4L2_CID_EXPOSURE_ABSOLUTE);
    return microseconds(exposure_unit_us *
                        (control ? std::max<std::int64_t>(control->step, 1) : 1));
}

void V4l2Controls::set_exposure(microseconds exposure) {
    const std::string what = fmt::format("set exposure {} us", exposure.count());
    const Control* control = find(V4L2_CID_EXPOSURE_ABSOLUTE);
    if (!control)
        device_.fail(what, "the device has no exposure time in known units");
    if (const Control* automatic = find(V4L2_CID_EXPOSURE_AUTO)) {
        std::int64_t mode = 0;
        if (read(*automatic, mode) != 0 ||
            (mode != V4L2_EXPOSURE_MANUAL && mode != V4L2_EXPOSURE_SHUTTER_PRIORITY))
            device_.fail(what, "the automatic exposure cannot be switched off");
    }
    const std::int64_t step = exposure_step().count() / exposure_unit_us;
    const double steps = (static_cast<double>(exposure.count()) / exposure_unit_us -
                          static_cast<double>(control->low)) /
                         static_cast<double>(step);
    const std::int64_t units = control->low + std::llround(steps) * step;
    set_checked(*control, units, what);
}

// ---- listing ---------------------------------------------------------------------------------

std::vector<CameraControl> V4l2Controls::list() {
    std::vector<CameraControl> all;
    for (const Control& control : controls_)
        all.push_back(described(control));
    return all;
}

CameraControl V4l2Controls::described(const Control& control) {
    CameraControl result;
    result.name = control.name;
    result.read_only = control.flags & V4L2_CTRL_FLAG_READ_ONLY;
    std::int64_t number = 0;
    const bool known = read(control, number) == 0;
    result.value = known ? std::to_string(number) : "";
    result.low = static_cast<double>(control.low);
    result.high = static_cast<double>(control.high);
    result.step = static_cast<double>(control.step);
    if (control.id == V4L2_CID_EXPOSURE_ABSOLUTE)
        result.unit = "100 us";
    if (!is_menu(control.type))
        return result;
    result.choices = choices(control);
    for (const std::string& choice : result.choices)
        if (known && choice.rfind(std::to_string(number) + ":", 0) == 0)
            result.value = choice;
    return result;
}

// "1: Manual Mode": the number is what set() takes; drivers leave numbers out.
std::vector<std::string> V4l2Controls::choices(const Control& control) {
    std::vector<std::string> found;
    v4l2_querymenu item{};
    item.id = control.id;
    for (std::int64_t i = std::max<std::int64_t>(control.low, 0);
         i <= std::min<std::int64_t>(control.high, 255); ++i) {
        item.index = static_cast<std::uint32_t>(i);
        if (device_.ask(VIDIOC_QUERYMENU, &item) != 0)
            continue;
        const char* name = reinterpret_cast<const char*>(item.name);
        const std::int64_t number = item.value;  // the other member of a packed union
        found.push_back(fmt::format("{}: {}", i,
                                    control.type == V4L2_CTRL_TYPE_INTEGER_MENU
                                        ? std::to_string(number)
                                        : std::string(name, strnlen(name, 32))));
    }
    return found;
}

}  // namespace etalon
