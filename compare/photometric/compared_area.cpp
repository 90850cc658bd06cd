#include "compare/photometric/compared_area.h"

#include <fmt/format.h>

#include <Eigen/LU>

#include "core/program/errors.h"
#include "sim/marker/topotag_pattern.h"

namespace etalon {
namespace {

PixelUse use_of(const Eigen::Vector2d& point_mm, const ComparedArea& area) {
    const bool inside = (point_mm.array() >= area.low_mm.array()).all() &&
                        (point_mm.array() <= area.high_mm.array()).all();
    if (!inside)
        return pixel_outside;
    const Eigen::Vector2d block =
        (point_mm - area.cell_corner_mm).cwiseQuotient(2.0 * area.cell_mm);
    const auto parity = static_cast<long long>(std::floor(block.x())) +
                        static_cast<long long>(std::floor(block.y()));
    return parity % 2 == 0 ? pixel_fitted : pixel_scored;
}

}  // namespace

ComparedArea compared_area(const Marker& marker, const ScoreMargin& margin,
                           const std::string& place) {
    if (marker.kind == Marker::Kind::chessboard) {
        // More than -0.5 leaves a rectangle on every board of 2 x 2 corners or more.
        const auto allowed = [](double squares) { return squares > -0.5 && squares <= 1.0; };
        if (!allowed(margin.x) || !allowed(margin.y))
            throw ConfigError({place}, fmt::format("a score margin must be over -0.5 and at most 1 "
                                                   "square, got {},{}",
                                                   margin.x, margin.y));
        const double square = marker.size_mm;
        const Eigen::Vector2d outside(margin.x * square, margin.y * square);
        const Eigen::Vector2d last((marker.columns - 1) * square, (marker.rows - 1) * square);
        return {-outside, last + outside, {square, square}, {0.0, 0.0}};
    }
    const CellGrid& grid = marker.grid;
    const Eigen::Vector2d size =
        grid.cell_mm.cwiseProduct(Eigen::Vector2d(grid.columns(), grid.rows()));
    // Boards and round TopoTags have cells far smaller than what is on them.
    Eigen::Vector2d cell = grid.cell_mm;
    if (marker.columns > 0)
        cell.setConstant(marker.size_mm / 2.0);
    else if (marker.kind == Marker::Kind::topotag)
        cell.setConstant(marker.size_mm / topotag_white_side(topotag_order(marker.family)));
    return {grid.corner_mm, grid.corner_mm + size, cell, grid.corner_mm};
}

PlaneSight::PlaneSight(const Projector& projector, const Rigid& camera_from_marker,
                       const cv::Rect& region)
    : projector_(&projector), region_(region), nodes_per_row_((region.width - 1) / spacing_px + 2) {
    // [r1 r2 t] takes (X, Y, 1) to the ray times its depth.
    Eigen::Matrix3d ray_from_plane = camera_from_marker.rotation.toRotationMatrix();
    ray_from_plane.col(2) = camera_from_marker.translation;
    const double volume = ray_from_plane.determinant();
    if (!std::isfinite(volume) || std::abs(volume) < 1e-12 * camera_from_marker.translation.norm())
        return;
    plane_from_ray_ = ray_from_plane.inverse();
    for (int j = 0; j < (region.height - 1) / spacing_px + 2; ++j)
        for (int i = 0; i < nodes_per_row_; ++i)
            nodes_.push_back(exactly(region.x + i * spacing_px, region.y + j * spacing_px));
}

Eigen::Vector3d PlaneSight::exactly(int x, int y) const {
    const auto ray = projector_->ray({x, y});
    if (!ray)
        return Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    return plane_from_ray_ * *ray;
}

std::optional<Eigen::Vector3d> PlaneSight::at(int x, int y) const {
    if (nodes_.empty())
        return std::nullopt;
    const int i = (x - region_.x) / spacing_px, j = (y - region_.y) / spacing_px;
    const double s = static_cast<double>(x - region_.x - i * spacing_px) / spacing_px;
    const double t = static_cast<double>(y - region_.y - j * spacing_px) / spacing_px;
    const Eigen::Vector3d *upper = &nodes_[static_cast<std::size_t>(j * nodes_per_row_ + i)],
                          *lower = upper + nodes_per_row_;
    Eigen::Vector3d met =
        (1 - t) * ((1 - s) * upper[0] + s * upper[1]) + t * ((1 - s) * lower[0] + s * lower[1]);
    if (!met.allFinite())  // next to where there are no rays
        met = exactly(x, y);
    if (!(met.z() > 0))
        return std::nullopt;
    return Eigen::Vector3d(met.x() / met.z(), met.y() / met.z(), 1.0 / met.z());
}

cv::Rect candidate_pixels(const Projector& projector, const Rigid& camera_from_marker,
                          const ComparedArea& area) {
    // The projection is one-to-one where it is valid: the outline bounds the image.
    constexpr int steps_per_side = 64;
    constexpr double room = 3.0;  // px, for what the outline does between two steps
    const cv::Size size(projector.camera().width, projector.camera().height);
    Eigen::AlignedBox2d box;
    for (int i = 0; i <= steps_per_side; ++i) {
        const double s = static_cast<double>(i) / steps_per_side;
        for (const Eigen::Vector2d& at : {Eigen::Vector2d(s, 0), Eigen::Vector2d(s, 1),
                                          Eigen::Vector2d(0, s), Eigen::Vector2d(1, s)}) {
            const Eigen::Vector2d point =
                area.low_mm + (area.high_mm - area.low_mm).cwiseProduct(at);
            const auto pixel =
                projector.project(camera_from_marker * Eigen::Vector3d(point.x(), point.y(), 0.0));
            if (!pixel)
                return {cv::Point(), size};
            box.extend(*pixel);
        }
    }
    const Eigen::Array2d none = Eigen::Array2d::Zero(), all(size.width, size.height);
    const Eigen::Array2i
        low = (box.min().array() - room).floor().max(none).min(all).cast<int>(),
        high = ((box.max().array() + room).ceil() + 1.0).max(none).min(all).cast<int>();
    return {low.x(), low.y(), high.x() - low.x(), high.y() - low.y()};
}

cv::Rect padded(const cv::Rect& box, int room_px, const cv::Size& image) {
    return cv::Rect(box.tl() - cv::Point(room_px, room_px),
                    box.br() + cv::Point(room_px, room_px)) &
           cv::Rect({0, 0}, image);
}

cv::Mat pixel_uses(const Projector& projector, const Rigid& camera_from_marker,
                   const ComparedArea& area) {
    require_point_of_view(projector.camera(), "comparing a photo with a rendering");
    cv::Mat uses(projector.camera().height, projector.camera().width, CV_8UC1,
                 cv::Scalar(pixel_outside));
    const cv::Rect box = candidate_pixels(projector, camera_from_marker, area);
    if (box.empty())
        return uses;
    const PlaneSight sight(projector, camera_from_marker, box);
    for (int y = box.y; y < box.br().y; ++y)
        for (int x = box.x; x < box.br().x; ++x)
            if (const auto met = sight.at(x, y))
                uses.at<uchar>(y, x) = use_of(met->head<2>(), area);
    return uses;
}

}  // namespace etalon
