// The min_white squares of a target as samples of the light that falls into the image.
#include <algorithm>
#include <cmath>
#include <map>

#include "compare/characterise/illumination_estimate.h"
#include "compare/photometric/compared_area.h"
#include "core/program/errors.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

constexpr double inside_px = 4.0, inside_cell = 0.25;
constexpr int min_pixels_of_a_cell = 9;
constexpr float min_white = 0.5f;

struct CellSums {
    double pixels = 0.0, radiance = 0.0, square = 0.0, x = 0.0, y = 0.0;
    bool is_clipped = false;
};

// Where a pixel's ray meets the target's plane; nothing behind the lens or edge-on.
std::optional<Eigen::Vector2d> on_target(const Projector& projector,
                                         const Rigid& camera_from_marker,
                                         const Eigen::Vector2d& pixel) {
    const auto undistorted = projector.unproject(pixel);
    if (!undistorted)
        return std::nullopt;
    const bool is_telecentric = projector.camera().projection.kind == Projection::telecentric;
    const Rigid marker_from_camera = camera_from_marker.inverse();
    const Eigen::Vector3d through(undistorted->x(), undistorted->y(), is_telecentric ? 0.0 : 1.0);
    const Eigen::Vector3d direction =
        marker_from_camera.rotation * (is_telecentric ? Eigen::Vector3d(0.0, 0.0, 1.0) : through);
    const Eigen::Vector3d origin =
        is_telecentric ? marker_from_camera * through : marker_from_camera.translation;
    if (std::abs(direction.z()) < 1e-9)
        return std::nullopt;
    const double along = -origin.z() / direction.z();
    if (!(along > 0.0))
        return std::nullopt;
    return (origin + along * direction).head<2>();
}

// Pixels per mm on the target, the smaller of both directions.
double px_per_mm(const Projector& projector, const Rigid& camera_from_marker,
                 const Eigen::Vector2d& point) {
    const Eigen::Vector3d p(point.x(), point.y(), 0.0);
    const auto projected = projector.project_with_jacobian(camera_from_marker * p);
    if (!projected)
        return 0.0;
    const Eigen::Matrix<double, 2, 3> j =
        projected->jacobian * camera_from_marker.rotation.toRotationMatrix();
    return std::min(j.col(0).norm(), j.col(1).norm());
}

cv::Rect bounding_box(const Projector& projector, const Marker& marker,
                      const Rigid& camera_from_marker) {
    Eigen::Vector2d low(1e9, 1e9), high(-1e9, -1e9);
    for (int v = 0; v <= marker.grid.rows(); ++v)
        for (int u = 0; u <= marker.grid.columns(); ++u)
            if (const auto q = projector.project(camera_from_marker * marker.grid.point_mm(u, v))) {
                low = low.cwiseMin(*q);
                high = high.cwiseMax(*q);
            }
    const cv::Rect image(0, 0, projector.camera().width, projector.camera().height);
    if (!(low.x() <= high.x()))
        return {};
    const auto whole = [](double value) { return static_cast<int>(std::clamp(value, -1e6, 1e6)); };
    return cv::Rect(cv::Point(whole(low.x()), whole(low.y())),
                    cv::Point(whole(high.x()) + 2, whole(high.y()) + 2)) &
           image;
}

// Nothing of a cell that is clipped or hardly seen.
std::optional<WhitePatch> patch_of(const CellSums& cell, int photo, double full_scale) {
    if (cell.is_clipped || cell.pixels < min_pixels_of_a_cell)
        return std::nullopt;
    WhitePatch patch;
    patch.photo = photo;
    patch.radiance = cell.radiance / cell.pixels;
    patch.centre_px = Eigen::Vector2d(cell.x, cell.y) / cell.pixels;
    const double variance =
        std::max(cell.square / cell.pixels - patch.radiance * patch.radiance, 0.0) * cell.pixels /
        (cell.pixels - 1.0);
    const double rounding = 0.29 / full_scale;
    patch.standard_uncertainty = std::hypot(std::sqrt(variance), rounding) / std::sqrt(cell.pixels);
    return patch;
}

}  // namespace

std::vector<WhitePatch> white_cell_patches(const CodeImage& image, const Projector& projector,
                                           const Marker& marker, const Rigid& camera_from_marker,
                                           int photo) {
    const CellGrid& grid = marker.grid;
    const Radiance radiance = SensorModel(projector.camera()).linear_radiance(image);
    std::map<std::pair<int, int>, CellSums> cells;
    const cv::Rect box = bounding_box(projector, marker, camera_from_marker);
    for (int y = box.y; y < box.br().y; ++y)
        for (int x = box.x; x < box.br().x; ++x) {
            const auto point = on_target(projector, camera_from_marker, Eigen::Vector2d(x, y));
            if (!point)
                continue;
            const Eigen::Vector2d place = (*point - grid.corner_mm).cwiseQuotient(grid.cell_mm);
            const int column = static_cast<int>(std::floor(place.x()));
            const int row = static_cast<int>(std::floor(place.y()));
            // The outermost cells are the margin, of which prints have more or less.
            if (column < 1 || row < 1 || column + 1 >= grid.columns() || row + 1 >= grid.rows() ||
                grid.cells.at<float>(row, column) < min_white)
                continue;
            const Eigen::Vector2d within(place.x() - column, place.y() - row);
            const double border = within.cwiseMin(Eigen::Vector2d::Ones() - within).minCoeff();
            const double border_px =
                border * grid.cell_mm.minCoeff() * px_per_mm(projector, camera_from_marker, *point);
            if (border < inside_cell || border_px < inside_px)
                continue;
            CellSums& cell = cells[{row, column}];
            const double value = radiance.at<float>(y, x);
            const double code = image.pixels.depth() == CV_8U
                                    ? image.pixels.at<std::uint8_t>(y, x)
                                    : image.pixels.at<std::uint16_t>(y, x);
            cell.is_clipped |= code >= image.full_scale();
            cell.pixels += 1.0;
            cell.radiance += value;
            cell.square += value * value;
            cell.x += x;
            cell.y += y;
        }
    std::vector<WhitePatch> patches;
    for (const auto& [place, cell] : cells)
        if (const auto patch = patch_of(cell, photo, image.full_scale()))
            patches.push_back(*patch);
    return patches;
}

}  // namespace etalon
