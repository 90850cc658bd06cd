// A straight edge before a small camera: the scene in which sampling errors are largest; and a
// marker of a few cells.
#pragma once

#include <tbb/global_control.h>

#include "sim/render/reference_integrator.h"
#include "sim/render/renderer.h"
#include "sim/scene/marker_view.h"
#include "tests/calib/cameras.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon::test {

// 96 x 72 px, f = 400 px, focused at 150 mm: blur radius at z is 400 d/2 |1/z - 1/150|, d = 1.71
// mm.
inline CameraModel small_camera(PointSpread spread) {
    return camera_with(96, 72, {400.0, 400.0, 47.0, 35.0}, {}, Sensor{.pixel_pitch_um = 6.0},
                       Lens{1.4, 150.0, 600.0, spread});
}

// The depth, nearer than the plane of focus, at which the blur disk has this radius.
inline double depth_of_blur(const CameraModel& camera, double radius_px) {
    const double aperture_radius_mm = aperture_of(camera).radius_mm;
    return 1.0 / (1.0 / camera.lens->focus_distance_mm +
                  radius_px / (camera.intrinsics.fx * aperture_radius_mm));
}

// Black left of x = edge_mm, white right of it, far beyond the image on every side.
inline Scene half_plane(double edge_mm, double z_mm) {
    const CellGrid grid{
        (cv::Mat_<float>(1, 2) << 0.0f, 1.0f), {edge_mm - 2000.0, -2000.0}, {2000.0, 4000.0}};
    return {{{grid, {Eigen::Quaterniond::Identity(), {0.0, 0.0, z_mm}}}}};
}

// 4 x 3 cells without symmetry.
inline PlacedMarker twelve_cells(const Eigen::Vector2d& cell_mm, const Eigen::Vector2d& corner_mm,
                                 const Rigid& camera_from_marker) {
    const cv::Mat cells = (cv::Mat_<float>(3, 4) << 0, 0.8, 0.2, 1, 1, 0, 0.6, 0, 0.3, 1, 0, 0.9);
    return {{cells, corner_mm, cell_mm}, camera_from_marker};
}

// Integral of the normal distribution function from minus infinity.
inline double swept_normal(double z) {
    const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
    return z * 0.5 * std::erfc(-z / std::numbers::sqrt2) + density;
}

// Across an edge the disk's, the Gaussian's and the box's spreads meet in one dimension:
// profile(x) = integral over the disk's line spread of the mean of Phi over the box.
inline double edge_profile(double distance_px, double disk_px, double sigma_px) {
    const auto phi_integral = [&](double x) { return sigma_px * swept_normal(x / sigma_px); };
    constexpr int steps = 20000;
    double sum = 0.0;
    for (int i = 0; i < steps; ++i) {  // x = R sin(angle): weight 2/pi cos^2
        const double angle = ((i + 0.5) / steps - 0.5) * std::numbers::pi;
        const double x = distance_px - disk_px * std::sin(angle);
        sum += std::cos(angle) * std::cos(angle) * (phi_integral(x + 0.5) - phi_integral(x - 0.5));
    }
    return sum * 2.0 / steps;
}

inline double largest_difference(const cv::Mat& a, const cv::Mat& b) {
    return cv::norm(a, b, cv::NORM_INF);
}

// ---- Images against the reference integrator, and against those of parts and of other threads.

// Within 0.1 gray and so many of the reference's own standard errors. Gives the reference.
inline std::vector<ReferencePixel> expect_reference(const cv::Mat& radiance,
                                                    const CameraModel& camera, const Scene& scene,
                                                    const std::vector<cv::Point>& pixels,
                                                    const ReferenceOptions& options,
                                                    double standard_errors = 4.0) {
    const auto reference = integrate_reference(camera, scene, pixels, options);
    for (std::size_t i = 0; i < pixels.size(); ++i)
        EXPECT_NEAR(radiance.at<float>(pixels[i]), reference[i].mean,
                    0.1 / 255.0 + standard_errors * reference[i].standard_error)
            << pixels[i];
    return reference;
}

// The same bytes on any number of threads, and in a region by itself but for its tail.
inline void expect_the_same_everywhere(const CameraModel& camera, const Scene& scene,
                                       const cv::Rect& region) {
    const Renderer renderer(camera);
    const RenderedImage image = renderer.render(scene);
    const RenderedImage part = renderer.render(scene, {.region = region});
    EXPECT_LT(255.0 * cv::norm(image.radiance(region), part.radiance(region), cv::NORM_INF), 0.01);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(cv::norm(image.radiance, renderer.render(scene).radiance, cv::NORM_INF), 0.0);
}

}  // namespace etalon::test
