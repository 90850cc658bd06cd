// The plugin `genicam`: see capture/frame/camera.h.
#include "capture/genicam/genicam_camera.h"
#include "plugins/plugin.h"

namespace etalon {
namespace {

constexpr CameraPlugin table{list_genicam_cameras, open_genicam_camera};

}  // namespace
}  // namespace etalon

ETALON_EXPORT_PLUGIN(etalon::table)
