#include "calib/intrinsics/calibration_view.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "core/program/errors.h"

namespace etalon {
namespace {

[[noreturn]] void refuse_view(std::size_t view, const std::string& why) {
    throw NumericalError(fmt::format("view {}: {}", view, why));
}

// The smaller extent of the points below a millionth of the larger.
bool are_collinear(const std::vector<Eigen::Vector3d>& points) {
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
    for (const Eigen::Vector3d& point : points)
        mean += point.head<2>() / static_cast<double>(points.size());
    Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
    for (const Eigen::Vector3d& point : points) {
        const Eigen::Vector2d arm = point.head<2>() - mean;
        scatter += arm * arm.transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(Eigen::MatrixXd(scatter),
                                                               Eigen::EigenvaluesOnly);
    return !(eigen.eigenvalues()[0] > 1e-12 * eigen.eigenvalues()[1]);
}

void check_points(const CalibrationView& view, std::size_t index) {
    for (std::size_t i = 0; i < view.points_mm.size(); ++i)
        if (!view.points_mm[i].allFinite() || !view.pixels[i].allFinite())
            refuse_view(index, fmt::format("point {} is not finite", i));
        else if (view.points_mm[i].z() != 0.0)
            refuse_view(index, fmt::format("point {} is not in the plane z = 0", i));
}

void check_labels(const CalibrationView& view, std::size_t index) {
    const std::size_t points = view.points_mm.size();
    for (const auto& [size, what] : {std::pair{view.ids.size(), "ids"},
                                     {view.sigma_px.size(), "standard deviations"},
                                     {view.displacements_mm.size(), "displacements"}})
        if (size != 0 && size != points)
            refuse_view(index, fmt::format("has {} points but {} {}", points, size, what));
    std::set<int> seen;
    for (const int id : view.ids)
        if (!seen.insert(id).second)
            refuse_view(index, fmt::format("the id {} is there twice", id));
    for (std::size_t i = 0; i < view.displacements_mm.size(); ++i)
        if (!view.displacements_mm[i].allFinite())
            refuse_view(index, fmt::format("the displacement of point {} is not finite", i));
    for (std::size_t i = 0; i < view.sigma_px.size(); ++i)
        if (!(view.sigma_px[i] > 0.0) || !std::isfinite(view.sigma_px[i]))
            refuse_view(index, fmt::format("point {} has the standard deviation {} px", i,
                                           view.sigma_px[i]));
}

}  // namespace

std::size_t point_count(std::span<const CalibrationView> views) {
    std::size_t count = 0;
    for (const CalibrationView& view : views)
        count += view.pixels.size();
    return count;
}

void check_view(const CalibrationView& view, std::size_t index, std::size_t needed) {
    const std::size_t points = view.points_mm.size();
    if (points != view.pixels.size())
        refuse_view(index, fmt::format("has {} points but {} pixels", points, view.pixels.size()));
    if (points < needed)
        refuse_view(index, fmt::format("has {} points, {} are needed", points, needed));
    check_points(view, index);
    check_labels(view, index);
    if (are_collinear(view.points_mm))
        refuse_view(index, "the points are collinear");
}

void check_views(std::span<const CalibrationView> views) {
    if (views.size() < min_views)
        throw NumericalError(fmt::format("{} views, three are needed", views.size()));
    for (std::size_t i = 0; i < views.size(); ++i)
        check_view(views[i], i, min_view_points);
}

double corner_scatter_px(std::span<const CalibrationView> views,
                         std::span<const std::vector<Eigen::Vector2d>> residuals_px) {
    constexpr std::size_t neighbours = 4;
    double squares = 0.0, count = 0.0;
    for (std::size_t v = 0; v < views.size(); ++v) {
        const auto& points = views[v].points_mm;
        std::vector<std::size_t> order(points.size());
        std::iota(order.begin(), order.end(), 0);
        for (std::size_t i = 0; points.size() > neighbours && i < points.size(); ++i) {
            std::ranges::partial_sort(
                order, order.begin() + neighbours + 1, {},
                [&](std::size_t k) { return (points[k] - points[i]).squaredNorm(); });
            Eigen::Vector2d mean = Eigen::Vector2d::Zero();
            for (std::size_t k = 1; k <= neighbours; ++k)
                mean += residuals_px[v][order[k]] / double(neighbours);
            squares += (residuals_px[v][i] - mean).squaredNorm();
            count += 1.0 + 1.0 / neighbours;
        }
    }
    return count > 0.0 ? std::sqrt(squares / count) : 0.0;
}

}  // namespace etalon
