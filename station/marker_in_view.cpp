#include "station/marker_in_view.h"

#include "sim/marker_view.h"

namespace etalon {
namespace {

bool is_inside(const CameraModel& camera, const Eigen::Vector2d& pixel, double margin_px) {
    return pixel.x() >= margin_px && pixel.y() >= margin_px &&
           pixel.x() <= camera.width - 1 - margin_px && pixel.y() <= camera.height - 1 - margin_px;
}

}  // namespace

bool is_in_view(const Projector& projector, const CellGrid& grid, const Rigid& camera_from_marker,
                double margin_px) {
    const CameraModel& camera = projector.camera();
    const Eigen::Vector3d inward = camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const double lens_mm = camera.lens ? aperture_of(camera).radius_mm : 0.0;
    if (!(inward.dot(camera_from_marker.translation) > lens_mm * inward.head<2>().norm()))
        return false;
    for (const int u : {0, grid.columns()})
        for (const int v : {0, grid.rows()}) {
            const auto pixel = projector.project(camera_from_marker * grid.point_mm(u, v));
            if (!pixel || !is_inside(camera, *pixel, margin_px))
                return false;
        }
    return true;
}

}  // namespace etalon
