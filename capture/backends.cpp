// Which kinds of cameras this program can open, and opening one by its URI. A backend is one row of
// the table below.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "capture/files_camera.h"
#include "capture/v4l2/v4l2_camera.h"
#include "core/program/plugin.h"

#ifndef ETALON_ARAVIS
#define ETALON_ARAVIS nullptr
#endif
#ifndef ETALON_LIBCAMERA
#define ETALON_LIBCAMERA nullptr
#endif

namespace etalon {
namespace {

struct Backend {
    const char* name;
    std::string detail;  // the SDK's version, or why the backend is left out
    std::function<std::vector<CameraIdentity>()> list;
    // (what follows the colon of the URI, link, clock); empty when left out
    std::function<std::unique_ptr<Camera>(const std::string&, const CameraLink&, Clock&)> open;
};

// One whose SDK is loaded with its plugin. `version` is null where it was built without the SDK.
Backend of_plugin(const char* name, const char* sdk, const char* version) {
    if (!version)
        return {name,
                fmt::format("left out: {} was not found when this program was configured", sdk),
                {},
                {}};
    return {name, version, [name] { return plugin<CameraPlugin>(name).list(); },
            [name](const std::string& id, const CameraLink& link, Clock& clock) {
                return plugin<CameraPlugin>(name).open(id, link, clock);
            }};
}

std::vector<Backend> backends() {
    return {of_plugin("genicam", "Aravis 0.8", ETALON_ARAVIS),
            {"files",
             "replays the images of a folder or of a recorded run: files:FOLDER",
             {},
             [](const std::string& folder, const CameraLink&, Clock& clock) {
                 return open_files_camera(folder, clock);
             }},
            {"v4l2", "cameras with a Linux video driver: v4l2:/dev/videoN or v4l2:PLACE-ON-THE-BUS",
             [] { return list_v4l2_cameras(); },
             [](const std::string& id, const CameraLink& link, Clock& clock) {
                 return open_v4l2_camera(id, link, clock);
             }},
            of_plugin("libcamera", "libcamera", ETALON_LIBCAMERA)};
}

std::vector<CameraBackend> described_backends(bool with_cameras) {
    std::vector<CameraBackend> known;
    for (const Backend& backend : backends()) {
        known.push_back({backend.name, static_cast<bool>(backend.open), backend.detail, {}});
        if (with_cameras && backend.list)
            known.back().cameras = backend.list();
    }
    return known;
}

}  // namespace

std::vector<CameraBackend> camera_backends() {
    return described_backends(false);
}

std::vector<CameraBackend> list_cameras() {
    return described_backends(true);
}

std::unique_ptr<Camera> open_camera(const std::string& uri, const CameraLink& link, Clock& clock) {
    const std::size_t colon = uri.find(':');
    const std::string name = uri.substr(0, colon);
    const std::string rest = colon == std::string::npos ? "" : uri.substr(colon + 1);
    if (rest.empty())
        throw ConfigError({}, "camera \"" + uri +
                                  "\": must be genicam:ID-or-IP, v4l2:DEVICE, libcamera:ID or "
                                  "files:FOLDER");
    std::vector<std::string> names;
    for (const Backend& backend : backends()) {
        names.push_back(backend.name);
        if (name != backend.name)
            continue;
        if (!backend.open)
            throw ConfigError({}, "camera \"" + uri + "\": " + name + " is " + backend.detail);
        return backend.open(rest, link, clock);
    }
    throw ConfigError({}, fmt::format("camera \"{}\": there is no backend \"{}\"; there are {}",
                                      uri, name, fmt::join(names, ", ")));
}

}  // namespace etalon
