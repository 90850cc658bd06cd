#include "compare/drift/target_movement.h"

#include <fmt/format.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "compare/detect/board/calibration_target.h"
#include "compare/make_detector.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double min_radius_px = 1e-3;

}  // namespace

TargetReference::TargetReference(TargetPoints points) : points_(std::move(points)) {
    if (points_.size() < min_target_points)
        throw NumericalError(fmt::format("a target with {} points: {} are needed", points_.size(),
                                         min_target_points));
    const auto count = static_cast<double>(points_.size());
    for (const auto& [id, pixel] : points_)
        centre_ += pixel / count;
    double squares = 0.0;
    for (const auto& [id, pixel] : points_)
        squares += (pixel - centre_).squaredNorm();
    radius_ = std::sqrt(squares / count);
    if (!(radius_ > min_radius_px) || !std::isfinite(radius_))
        throw NumericalError("a target whose points are all in one place");
}

Eigen::Matrix<double, 2, 4> TargetReference::at(const Eigen::Vector2d& pixel) const {
    const Eigen::Vector2d q = (pixel - centre_) / radius_;
    Eigen::Matrix<double, 2, 4> matrix;
    matrix << 1, 0, q.x(), -q.y(), 0, 1, q.y(), q.x();
    return matrix;
}

std::optional<TargetReference::Look> TargetReference::look(const TargetPoints& points) const {
    std::vector<std::pair<int, Eigen::Vector2d>> displacements;
    for (const auto& [id, pixel] : points)
        if (const auto first = points_.find(id); first != points_.end())
            displacements.emplace_back(id, pixel - first->second);
    if (displacements.size() < min_target_points || 2 * displacements.size() < points_.size())
        return std::nullopt;
    const auto rows = static_cast<Eigen::Index>(2 * displacements.size());
    Eigen::MatrixXd design(rows, 4);
    Eigen::VectorXd moved(rows);
    for (Eigen::Index i = 0; 2 * i < rows; ++i) {
        const auto& [id, displacement] = displacements[static_cast<std::size_t>(i)];
        design.middleRows<2>(2 * i) = at(points_.at(id));
        moved.segment<2>(2 * i) = displacement;
    }
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(design);
    if (qr.rank() < 4 || !moved.allFinite())
        return std::nullopt;
    Look result;
    result.movement = qr.solve(moved);
    const Eigen::VectorXd left = moved - design * result.movement;
    for (Eigen::Index i = 0; 2 * i < rows; ++i)
        result.residuals[displacements[static_cast<std::size_t>(i)].first] = left.segment<2>(2 * i);
    return result;
}

double TargetReference::largest(const Movement& movement) const {
    double largest = 0.0;
    for (const auto& [id, pixel] : points_)
        largest = std::max(largest, (at(pixel) * movement).norm());
    return largest;
}

double misfit(const TargetPoints& residuals) {
    if (residuals.size() <= 2)
        return 0.0;
    double squares = 0.0;
    for (const auto& [id, residual] : residuals)
        squares += residual.squaredNorm();
    return std::sqrt(squares / (2.0 * static_cast<double>(residuals.size()) - 4.0));
}

namespace {

TargetPoints by_id(const std::vector<Eigen::Vector2d>& pixels, const std::vector<int>& ids) {
    TargetPoints points;
    for (std::size_t i = 0; i < pixels.size(); ++i)
        points[ids.empty() ? static_cast<int>(i) : ids[i]] = pixels[i];
    return points;
}

TargetFinder tag_finder(const Marker& tag, const std::string& place) {
    const std::shared_ptr<Detector> detector = make_detector("auto", tag, place);
    return [detector](const CodeImage& image) {
        const auto found = detector->detect(image).corners;
        return found ? by_id(found->pixels, found->points) : TargetPoints{};
    };
}

}  // namespace

TargetFinder make_target_finder(const std::string& spec, const std::string& place) {
    const Marker marker = parse_marker(spec, place);
    if (marker.kind == Marker::Kind::apriltag || marker.kind == Marker::Kind::aruco ||
        marker.kind == Marker::Kind::stag || marker.kind == Marker::Kind::topotag)
        return tag_finder(marker, place);
    return [target = parse_calibration_target(spec, place)](const CodeImage& image) {
        const auto view = observe(target, image).view;
        return view ? by_id(view->pixels, view->ids) : TargetPoints{};
    };
}

}  // namespace etalon
