// `etalon devices`: the kinds of cameras and stages that this program can use, why others are left
// out, and the cameras that answer now.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "capture/camera.h"
#include "stage/profile.h"
#include "station/commands.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

ordered_json backend_json(const CameraBackend& backend) {
    ordered_json json = {{"name", backend.name},
                         {"built_in", backend.built_in},
                         {"detail", backend.detail},
                         {"cameras", ordered_json::array()}};
    for (const CameraIdentity& camera : backend.cameras)
        json["cameras"].push_back({{"uri", camera.uri},
                                   {"vendor", camera.vendor},
                                   {"model", camera.model},
                                   {"serial", camera.serial}});
    return json;
}

void print_json(const std::vector<CameraBackend>& backends) {
    ordered_json json = {{"etalon", "devices/1"},
                         {"camera_backends", ordered_json::array()},
                         {"stage_profiles", builtin_stage_profile_names()}};
    for (const CameraBackend& backend : backends)
        json["camera_backends"].push_back(backend_json(backend));
    fmt::print("{}\n", json.dump(2, ' ', false, ordered_json::error_handler_t::replace));
}

void print_table(const std::vector<CameraBackend>& backends) {
    fmt::print("cameras\n");
    for (const CameraBackend& backend : backends) {
        fmt::print("  {:<11}{:<5}{}\n", backend.name, backend.built_in ? "yes" : "no",
                   backend.detail);
        for (const CameraIdentity& camera : backend.cameras)
            fmt::print("      {}  {} {}, serial {}\n", camera.uri, camera.vendor, camera.model,
                       camera.serial.empty() ? "unknown" : camera.serial);
        if (backend.name == "genicam" && backend.built_in && backend.cameras.empty())
            fmt::print("      no camera answers\n");
    }
    fmt::print("stages\n");
    for (const std::string& profile : builtin_stage_profile_names())
        fmt::print("  {:<11}{:<5}Modbus TCP\n", profile, "yes");
}

}  // namespace

int run_devices(const DevicesArguments& arguments) {
    const std::vector<CameraBackend> backends = list_cameras();
    if (arguments.json)
        print_json(backends);
    else
        print_table(backends);
    return 0;
}

}  // namespace etalon
