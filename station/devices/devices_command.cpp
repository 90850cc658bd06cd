// `etalon devices`: the kinds of cameras and stages that this program can use, why others are left
// out, and the cameras that answer now, with their pixel formats and controls.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/program/errors.h"
#include "report/json_text.h"
#include "stage/profile/profile.h"
#include "station/devices/commands.h"
#include "station/devices/devices_table.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

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
    fmt::print("{}\n", text_of(json));
}

}  // namespace

int run_devices(const DevicesArguments& arguments) {
    const std::vector<ListedBackend> backends = listed_backends();
    if (arguments.json)
        print_json(backends);
    else
        fmt::print("{}", devices_table(backends, builtin_stage_profile_names()));
    return 0;
}

void declare_devices(Command& program) {
    program.add(run_devices, "devices", "list cameras, and the backends that are built in",
                "Each camera is opened for a moment to ask for its pixel formats and controls. A\n"
                "backend whose SDK was missing when this program was built is named as left out,\n"
                "with the reason.\n");
}

}  // namespace etalon
