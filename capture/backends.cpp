// Which kinds of cameras this program can open, and opening one by its URI. A backend is one row of
// the table below.
#include <functional>

#include "capture/camera_plugin.h"
#include "capture/files_camera.h"
#include "capture/frame/camera.h"
#include "capture/v4l2/v4l2_camera.h"
#include "core/program/errors.h"
#include "core/program/plugin.h"

namespace etalon {
namespace {

struct Backend {
    const char* name;
    std::string detail;  // the SDK's version, or why the backend is left out
    std::function<std::vector<CameraIdentity>()> list;
    // (what follows the colon of the URI, link, clock); empty when left out
    std::function<std::unique_ptr<Camera>(const std::string&, const CameraLink&, Clock&)> open;
};

// One whose SDK is loaded with its plugin.
Backend of_plugin(const char* name, const char* sdk_version) {
    return {name, sdk_version, [name] { return plugin<CameraPlugin>(name).list(); },
            [name](const std::string& id, const CameraLink& link, Clock& clock) {
                return plugin<CameraPlugin>(name).open(id, link, clock);
            }};
}

Backend genicam() {
#ifdef ETALON_ARAVIS
    return of_plugin("genicam", ETALON_ARAVIS);
#else
    return {
        "genicam", "left out: Aravis 0.8 was not found when this program was configured", {}, {}};
#endif
}

Backend libcamera() {
#ifdef ETALON_LIBCAMERA
    return of_plugin("libcamera", ETALON_LIBCAMERA);
#else
    return {
        "libcamera", "left out: libcamera was not found when this program was configured", {}, {}};
#endif
}

Backend v4l2() {
    return {"v4l2", "cameras with a Linux video driver: v4l2:/dev/videoN or v4l2:PLACE-ON-THE-BUS",
            [] { return list_v4l2_cameras(); },
            [](const std::string& id, const CameraLink& link, Clock& clock) {
                return open_v4l2_camera(id, link, clock);
            }};
}

Backend files() {
    return {"files",
            "replays the images of a folder or of a recorded run: files:FOLDER",
            {},
            [](const std::string& folder, const CameraLink&, Clock& clock) {
                return open_files_camera(folder, clock);
            }};
}

std::vector<Backend> backends() {
    return {genicam(), files(), v4l2(), libcamera()};
}

CameraBackend described(const Backend& backend) {
    return {backend.name, static_cast<bool>(backend.open), backend.detail, {}};
}

std::string names(const std::vector<Backend>& known) {
    std::string names;
    for (const Backend& backend : known)
        names += (names.empty() ? "" : ", ") + std::string(backend.name);
    return names;
}

}  // namespace

std::vector<CameraBackend> camera_backends() {
    std::vector<CameraBackend> known;
    for (const Backend& backend : backends())
        known.push_back(described(backend));
    return known;
}

std::vector<CameraBackend> list_cameras() {
    std::vector<CameraBackend> found;
    for (const Backend& backend : backends()) {
        found.push_back(described(backend));
        if (backend.list)
            found.back().cameras = backend.list();
    }
    return found;
}

std::unique_ptr<Camera> open_camera(const std::string& uri, const CameraLink& link, Clock& clock) {
    const std::size_t colon = uri.find(':');
    const std::string name = uri.substr(0, colon);
    const std::string rest = colon == std::string::npos ? "" : uri.substr(colon + 1);
    const std::vector<Backend> known = backends();
    if (rest.empty())
        throw ConfigError({}, "camera \"" + uri +
                                  "\": must be genicam:ID-or-IP, v4l2:DEVICE, libcamera:ID or "
                                  "files:FOLDER");
    for (const Backend& backend : known) {
        if (name != backend.name)
            continue;
        if (!backend.open)
            throw ConfigError({}, "camera \"" + uri + "\": " + name + " is " + backend.detail);
        return backend.open(rest, link, clock);
    }
    throw ConfigError({}, "camera \"" + uri + "\": there is no backend \"" + name +
                              "\"; there are " + names(known));
}

void Camera::reconnect(Instant, std::stop_token) {
    throw DeviceError("camera " + identity().uri, "reconnect", "it is none that can come back");
}

}  // namespace etalon
