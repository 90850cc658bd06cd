// The plugin `libcamera`: see capture/frame/camera.h.
#include "capture/libcamera/libcamera_camera.h"
#include "plugins/plugin.h"

namespace etalon {
namespace {

std::unique_ptr<Camera> open(const std::string& id, const CameraLink& link, Clock& clock) {
    return open_libcamera_camera(id, link, clock);
}

constexpr CameraPlugin table{list_libcamera_cameras, open};

}  // namespace
}  // namespace etalon

ETALON_EXPORT_PLUGIN(etalon::table)
