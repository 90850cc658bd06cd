#include "sim/scene/marker_in_view.h"

#include "sim/scene/marker_view.h"

namespace etalon {
namespace {

constexpr int parts_of_bent_edge = 8;

// The plane passes before all of the lens (telecentric: no ray of the cone runs along it).
bool shows_front(const CameraModel& camera, const Rigid& camera_from_marker) {
    const Eigen::Vector3d inward = camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const double radius = camera.lens ? aperture_of(camera).radius_mm : 0.0;
    const double before = camera.projection.kind == Projection::telecentric
                              ? inward.z()
                              : inward.dot(camera_from_marker.translation);
    return before > radius * (camera.projection.is_flat() ? inward.head<2>().norm() : 1.0);
}

bool is_inside(const CameraModel& camera, const Eigen::Vector2d& pixel, double margin_px) {
    return pixel.x() >= margin_px && pixel.y() >= margin_px &&
           pixel.x() <= camera.width - 1 - margin_px && pixel.y() <= camera.height - 1 - margin_px;
}

}  // namespace

bool is_in_view(const Projector& projector, const CellGrid& grid, const Rigid& camera_from_marker,
                double margin_px) {
    const CameraModel& camera = projector.camera();
    if (!shows_front(camera, camera_from_marker))
        return false;
    const auto is_seen = [&](double u, double v) {
        const auto pixel = projector.project(camera_from_marker * grid.point_mm(u, v));
        return pixel && is_inside(camera, *pixel, margin_px);
    };
    const double columns = grid.columns(), rows = grid.rows();
    const int parts = images_lines_straight(camera) ? 1 : parts_of_bent_edge;
    for (int part = 0; part < parts; ++part) {  // the corners first: they decide most cases
        const double along = static_cast<double>(part) / parts, back = 1.0 - along;
        if (!is_seen(along * columns, 0.0) || !is_seen(columns, along * rows) ||
            !is_seen(back * columns, rows) || !is_seen(0.0, back * rows))
            return false;
    }
    return true;
}

}  // namespace etalon
