#include "calib/intrinsics/projection_uncertainty.h"

#include <Eigen/QR>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "calib/camera/projector.h"
#include "calib/intrinsics/camera_fit.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr int columns = 33;  // of the grid; rows as many as make its cells about square

// Of one displacement with the covariance m, in its worst direction.
double largest_deviation(const Eigen::Matrix2d& m) {
    const double mean = 0.5 * (m(0, 0) + m(1, 1)), half = 0.5 * (m(0, 0) - m(1, 1));
    return std::sqrt(std::max(0.0, mean + std::hypot(half, 0.5 * (m(0, 1) + m(1, 0)))));
}

std::vector<cv::Point2f> convex_hull(std::span<const Eigen::Vector2d> points) {
    std::vector<cv::Point2f> all, hull;
    for (const Eigen::Vector2d& point : points)
        all.emplace_back(static_cast<float>(point.x()), static_cast<float>(point.y()));
    if (!all.empty())
        cv::convexHull(all, hull);
    return hull;
}

bool is_inside(const std::vector<cv::Point2f>& hull, const Eigen::Vector2d& pixel) {
    const cv::Point2f point(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()));
    return !hull.empty() && cv::pointPolygonTest(hull, point, false) >= 0.0;
}

}  // namespace

ImageRays image_rays(const CameraModel& camera) {
    const Projector projector(camera);
    const int rows = std::max(
        2, static_cast<int>(std::lround(1.0 + (columns - 1.0) * camera.height / camera.width)));
    ImageRays rays;
    rays.step_x_px = camera.width / (columns - 1.0);
    rays.step_y_px = camera.height / (rows - 1.0);
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            const Eigen::Vector2d pixel(-0.5 + rays.step_x_px * column,
                                        -0.5 + rays.step_y_px * row);
            if (const auto ray = projector.ray(pixel)) {
                rays.pixels.push_back(pixel);
                rays.rays.push_back(*ray);
            }
        }
    if (rays.pixels.empty())
        throw NumericalError("no ray of this camera reaches its image");
    rays.share_without_ray =
        1.0 - static_cast<double>(rays.pixels.size()) / static_cast<double>(rows * columns);
    return rays;
}

std::vector<Eigen::Vector2d> all_pixels(std::span<const CalibrationView> views) {
    std::vector<Eigen::Vector2d> pixels;
    for (const CalibrationView& view : views)
        pixels.insert(pixels.end(), view.pixels.begin(), view.pixels.end());
    return pixels;
}

ImageRays rays_among(const ImageRays& rays, std::span<const Eigen::Vector2d> pixels) {
    const std::vector<cv::Point2f> hull = convex_hull(pixels);
    ImageRays among{{}, {}, rays.step_x_px, rays.step_y_px};
    for (std::size_t i = 0; i < rays.pixels.size(); ++i) {
        if (!is_inside(hull, rays.pixels[i]))
            continue;
        among.pixels.push_back(rays.pixels[i]);
        among.rays.push_back(rays.rays[i]);
    }
    return among;
}

Eigen::MatrixXd parameter_jacobian(const CameraModel& camera, const ImageRays& rays,
                                   const CalibrationModel& model) {
    const auto count = static_cast<Eigen::Index>(rays.rays.size());
    Eigen::MatrixXd jacobian(2 * count, static_cast<Eigen::Index>(model.parameters.size()));
    for (Eigen::Index i = 0; i < count; ++i)
        jacobian.middleRows<2>(2 * i) =
            parameter_jacobian(camera, rays.rays[static_cast<std::size_t>(i)], model);
    return jacobian;
}

// A ray r turned by a small w moves by w x r.
Eigen::MatrixXd rotation_jacobian(const CameraModel& camera, const ImageRays& rays) {
    const PixelModel<double> model(camera.projection, all_parameters(camera));
    const auto count = static_cast<Eigen::Index>(rays.rays.size());
    Eigen::MatrixXd jacobian(2 * count, 3);
    for (Eigen::Index i = 0; i < count; ++i) {
        const Eigen::Vector3d& r = rays.rays[static_cast<std::size_t>(i)];
        jacobian.middleRows<2>(2 * i) = model(r).of * -cross_matrix(r);
    }
    return jacobian;
}

Eigen::MatrixXd best_rotation(const Eigen::MatrixXd& moved, const Eigen::MatrixXd& rotation,
                              const Eigen::VectorXd& deviations) {
    constexpr double certain = 1e-12;  // px; a ray is never held for more certain
    Eigen::VectorXd weights(moved.rows());
    for (Eigen::Index i = 0; i < weights.size(); ++i)
        weights[i] = 1.0 / std::max(certain, deviations[i / 2]);
    const Eigen::MatrixXd weighted_rotation = weights.asDiagonal() * rotation;
    return weighted_rotation.colPivHouseholderQr().solve(
        Eigen::MatrixXd(weights.asDiagonal() * moved));
}

Eigen::MatrixXd less_best_rotation(const Eigen::MatrixXd& moved, const Eigen::MatrixXd& rotation,
                                   const Eigen::VectorXd& deviations) {
    return moved - rotation * best_rotation(moved, rotation, deviations);
}

Eigen::VectorXd ray_deviations(const Eigen::MatrixXd& jacobian, const Eigen::MatrixXd& covariance) {
    Eigen::VectorXd deviations(jacobian.rows() / 2);
    for (Eigen::Index ray = 0; ray < deviations.size(); ++ray) {
        const auto rows = jacobian.middleRows<2>(2 * ray);
        deviations[ray] = largest_deviation(rows * covariance * rows.transpose());
    }
    return deviations;
}

double ProjectionUncertainty::mean(double PixelUncertainty::*value) const {
    double sum = 0.0;
    for (const PixelUncertainty& each : pixels)
        sum += each.*value;
    return sum / static_cast<double>(pixels.size());
}

double ProjectionUncertainty::worst(double PixelUncertainty::*value) const {
    return std::ranges::max(pixels, {}, value).*value;
}

double ProjectionUncertainty::worst_among_points(double PixelUncertainty::*value) const {
    double worst = 0.0;
    for (const PixelUncertainty& each : pixels)
        if (each.among_points)
            worst = std::max(worst, each.*value);
    return worst;
}

double ProjectionUncertainty::share_among_points() const {
    const auto among = std::ranges::count(pixels, true, &PixelUncertainty::among_points);
    return static_cast<double>(among) / static_cast<double>(pixels.size());
}

ProjectionUncertainty projection_uncertainty(const CameraModel& camera,
                                             const CalibrationModel& model,
                                             const Eigen::MatrixXd& covariance,
                                             std::span<const Eigen::Vector2d> points) {
    const ImageRays rays = image_rays(camera);
    const Eigen::MatrixXd moved = parameter_jacobian(camera, rays, model);
    const Eigen::VectorXd held = ray_deviations(moved, covariance);
    const Eigen::VectorXd rotated = ray_deviations(
        less_best_rotation(moved, rotation_jacobian(camera, rays), held), covariance);
    const std::vector<cv::Point2f> hull = convex_hull(points);
    ProjectionUncertainty uncertainty{{}, rays.step_x_px, rays.step_y_px, rays.share_without_ray};
    for (std::size_t i = 0; i < rays.pixels.size(); ++i) {
        const auto ray = static_cast<Eigen::Index>(i);
        uncertainty.pixels.push_back(
            {rays.pixels[i], held[ray], rotated[ray], is_inside(hull, rays.pixels[i])});
    }
    return uncertainty;
}

}  // namespace etalon
