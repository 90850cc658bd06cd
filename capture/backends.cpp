// Which kinds of cameras this program can open, and opening one by its URI.
#include "capture/camera.h"
#include "capture/files_camera.h"
#include "core/errors.h"
#ifdef ETALON_HAVE_ARAVIS
#include "capture/genicam_camera.h"
#endif

namespace etalon {
namespace {

constexpr std::string_view no_aravis =
    "left out: Aravis 0.8 was not found when this program was configured";

CameraBackend genicam_backend() {
    CameraBackend backend{"genicam", false, std::string(no_aravis), {}};
#ifdef ETALON_HAVE_ARAVIS
    backend.built_in = true;
    backend.detail = genicam_sdk_version();
    backend.cameras = list_genicam_cameras();
#endif
    return backend;
}

std::unique_ptr<Camera> open_genicam(const std::string& uri, const std::string& id,
                                     const CameraLink& link, Clock& clock) {
#ifdef ETALON_HAVE_ARAVIS
    (void)uri;
    return open_genicam_camera(id, link, clock);
#else
    (void)id, (void)link, (void)clock;
    throw ConfigError({}, "camera \"" + uri + "\": genicam is " + std::string(no_aravis));
#endif
}

}  // namespace

std::vector<CameraBackend> list_cameras() {
    return {genicam_backend(),
            {"files", true, "replays the images of a folder: files:FOLDER", {}},
            {"v4l2", false, "not built yet", {}},
            {"libcamera", false, "not built yet", {}}};
}

std::unique_ptr<Camera> open_camera(const std::string& uri, const CameraLink& link, Clock& clock) {
    const std::size_t colon = uri.find(':');
    const std::string backend = uri.substr(0, colon);
    const std::string rest = colon == std::string::npos ? "" : uri.substr(colon + 1);
    if (rest.empty())
        throw ConfigError(
            {}, "camera \"" + uri + "\": must be genicam:ID, genicam:IP-ADDRESS or files:FOLDER");
    if (backend == "genicam")
        return open_genicam(uri, rest, link, clock);
    if (backend == "files")
        return open_files_camera(rest, clock);
    throw ConfigError({}, "camera \"" + uri + "\": there is no backend \"" + backend +
                              "\"; there are genicam and files");
}

}  // namespace etalon
