// `etalon devices`: the kinds of cameras and stages that this program can use, why others are left
// out, and the cameras that answer now, with their pixel formats and controls.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "capture/camera.h"
#include "core/errors.h"
#include "stage/profile.h"
#include "station/commands.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

constexpr std::size_t columns = 79;

struct ListedCamera {
    CameraIdentity identity;
    CameraAbilities abilities;
    std::string fault;  // why it has none: it is in use, or we may not open it
};

struct ListedBackend {
    CameraBackend backend;
    std::vector<ListedCamera> cameras;
};

ListedCamera listed(const CameraIdentity& identity, Clock& clock) {
    ListedCamera camera{identity, {}, ""};
    try {
        camera.abilities = open_camera(identity.uri, {}, clock)->abilities();
    } catch (const Error& error) {
        camera.fault = error.what();
    }
    return camera;
}

std::vector<ListedBackend> listed_backends() {
    SteadyClock clock;
    std::vector<ListedBackend> backends;
    for (CameraBackend& backend : list_cameras()) {
        std::vector<ListedCamera> cameras;
        for (const CameraIdentity& identity : backend.cameras)
            cameras.push_back(listed(identity, clock));
        backends.push_back({std::move(backend), std::move(cameras)});
    }
    return backends;
}

// ---- JSON ----------------------------------------------------------------------------------

ordered_json number(const std::optional<double>& value) {
    return value ? ordered_json(*value) : ordered_json();
}

ordered_json format_json(const CameraFormat& format) {
    ordered_json json = {{"name", format.name},
                         {"description", format.description},
                         {"bits", format.bits},
                         {"sizes", ordered_json::array()}};
    for (const FrameSizes& sizes : format.sizes)
        json["sizes"].push_back({{"smallest", {sizes.smallest.width, sizes.smallest.height}},
                                 {"largest", {sizes.largest.width, sizes.largest.height}},
                                 {"step", {sizes.step.width, sizes.step.height}}});
    return json;
}

ordered_json control_json(const CameraControl& control) {
    return {{"name", control.name},         {"value", control.value},
            {"unit", control.unit},         {"low", number(control.low)},
            {"high", number(control.high)}, {"step", number(control.step)},
            {"choices", control.choices},   {"read_only", control.read_only}};
}

ordered_json camera_json(const ListedCamera& camera) {
    ordered_json json = {{"uri", camera.identity.uri},
                         {"vendor", camera.identity.vendor},
                         {"model", camera.identity.model},
                         {"serial", camera.identity.serial},
                         {"fault", camera.fault},
                         {"formats", ordered_json::array()},
                         {"controls", ordered_json::array()}};
    for (const CameraFormat& format : camera.abilities.formats)
        json["formats"].push_back(format_json(format));
    for (const CameraControl& control : camera.abilities.controls)
        json["controls"].push_back(control_json(control));
    return json;
}

void print_json(const std::vector<ListedBackend>& backends) {
    ordered_json json = {{"etalon", "devices/1"},
                         {"camera_backends", ordered_json::array()},
                         {"stage_profiles", builtin_stage_profile_names()}};
    for (const ListedBackend& listed : backends) {
        ordered_json cameras = ordered_json::array();
        for (const ListedCamera& camera : listed.cameras)
            cameras.push_back(camera_json(camera));
        json["camera_backends"].push_back({{"name", listed.backend.name},
                                           {"built_in", listed.backend.built_in},
                                           {"detail", listed.backend.detail},
                                           {"cameras", cameras}});
    }
    fmt::print("{}\n", json.dump(2, ' ', false, ordered_json::error_handler_t::replace));
}

// ---- table ---------------------------------------------------------------------------------

// Words after a heading, continued on further lines under its end.
void print_words(const std::string& heading, const std::vector<std::string>& words) {
    std::string line = heading;
    bool empty = true;
    for (const std::string& word : words) {
        if (!empty && line.size() + word.size() + 2 > columns) {
            fmt::print("{},\n", line);
            line = std::string(heading.size(), ' ');
            empty = true;
        }
        line += (empty ? "" : ", ") + word;
        empty = false;
    }
    fmt::print("{}\n", line);
}

std::string sizes_text(const FrameSizes& sizes) {
    const auto text = [](cv::Size size) { return fmt::format("{}x{}", size.width, size.height); };
    if (sizes.smallest == sizes.largest)
        return text(sizes.largest);
    return text(sizes.smallest) + " to " + text(sizes.largest);
}

void print_format(const CameraFormat& format) {
    std::vector<std::string> sizes;
    for (const FrameSizes& each : format.sizes)
        sizes.push_back(sizes_text(each));
    const std::string bits =
        format.bits ? fmt::format("{} bits", format.bits) : std::string("cannot be unpacked");
    print_words(fmt::format("        {:<16}{:<9}", format.name, bits), sizes);
}

std::string range_text(const CameraControl& control) {
    std::string text;
    if (control.low && control.high)
        text = fmt::format("{:g} to {:g}", *control.low, *control.high);
    if (control.step && *control.step != 1.0)
        text += fmt::format(" in steps of {:g}", *control.step);
    return text;
}

void print_control(const CameraControl& control) {
    std::vector<std::string> words = control.choices;
    if (words.empty())
        words.push_back(range_text(control));
    if (control.read_only)
        words.emplace_back("read only");
    std::erase(words, "");
    const std::string value = control.value + (control.unit.empty() ? "" : " " + control.unit);
    print_words(fmt::format("        {:<24} {:<14} ", control.name, value), words);
}

void print_camera(const ListedCamera& camera) {
    const CameraIdentity& identity = camera.identity;
    fmt::print("      {}  {} {}, serial {}\n", identity.uri, identity.vendor, identity.model,
               identity.serial.empty() ? "unknown" : identity.serial);
    if (!camera.fault.empty())
        fmt::print("        {}\n", camera.fault);
    for (const CameraFormat& format : camera.abilities.formats)
        print_format(format);
    for (const CameraControl& control : camera.abilities.controls)
        print_control(control);
}

void print_table(const std::vector<ListedBackend>& backends) {
    fmt::print("cameras\n");
    for (const ListedBackend& listed : backends) {
        const CameraBackend& backend = listed.backend;
        fmt::print("  {:<11}{:<5}{}\n", backend.name, backend.built_in ? "yes" : "no",
                   backend.detail);
        for (const ListedCamera& camera : listed.cameras)
            print_camera(camera);
        if (backend.built_in && backend.name != "files" && listed.cameras.empty())
            fmt::print("      no camera answers\n");
    }
    fmt::print("stages\n");
    for (const std::string& profile : builtin_stage_profile_names())
        fmt::print("  {:<11}{:<5}Modbus TCP\n", profile, "yes");
}

}  // namespace

int run_devices(const DevicesArguments& arguments) {
    const std::vector<ListedBackend> backends = listed_backends();
    if (arguments.json)
        print_json(backends);
    else
        print_table(backends);
    return 0;
}

}  // namespace etalon
