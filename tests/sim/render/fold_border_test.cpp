// Pixels that the border of the distortion model's valid region cuts: beyond it nothing is seen.
#include <gtest/gtest.h>

#include "sim/marker/marker.h"
#include "sim/render/reference_integrator.h"
#include "sim/render/renderer.h"

namespace etalon {
namespace {

// Barrel distortion folds over where r (1 + k1 r^2) is largest: r = 1 / sqrt(-3 k1), image radius
// 2/3 of that.
constexpr double k1 = -0.3, focal_px = 4000.0;
const double fold = 1.0 / std::sqrt(-3.0 * k1), fold_px = focal_px * 2.0 / 3.0 * fold;

// A sharp camera whose fold, hardly curved within the image, passes through `at`, its outward
// direction turned by `angle` from x.
CameraModel camera_with_fold(const Eigen::Vector2d& at, double angle) {
    CameraModel camera;
    camera.width = 24;
    camera.height = 16;
    const Eigen::Vector2d centre = at - fold_px * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    camera.intrinsics = {focal_px, focal_px, centre.x(), centre.y()};
    camera.distortion.k1 = k1;
    return camera;
}

// Black wherever the camera sees anything, before a white background.
Scene black_scene(double angle) {
    PlacedMarker marker;
    marker.grid.cells = cv::Mat(1, 1, CV_32FC1, cv::Scalar(0.0));
    marker.grid.cell_mm = {400.0, 400.0};
    marker.grid.corner_mm = {-200.0, -200.0};
    const double place = 250.0 * fold;
    marker.camera_from_marker.translation = {place * std::cos(angle), place * std::sin(angle),
                                             250.0};
    return {{marker}, 1.0};
}

// Of the pixel's area, by the midpoint rule on 1000 rows with the border's exact x in each.
double share_beyond_fold(const CameraModel& camera, int x, int y) {
    double share = 0.0;
    for (int i = 0; i < 1000; ++i) {
        const double dy = y - 0.5 + (i + 0.5) / 1000.0 - camera.intrinsics.cy;
        const double border = camera.intrinsics.cx + std::sqrt(fold_px * fold_px - dy * dy);
        share += std::clamp(x + 0.5 - border, 0.0, 1.0) / 1000.0;
    }
    return share;
}

TEST(FoldBorder, CutsAPixelToTheToleranceWhicheverWayItRuns) {
    for (const double angle : {0.0, 0.61})
        for (const double x : {15.27, 15.49, 15.508, 16.53, 17.06, 17.13, 17.29, 17.41}) {
            const CameraModel camera = camera_with_fold({x, 7.0}, angle);
            const RenderedImage image =
                Renderer(camera).render(black_scene(angle), {.region = {12, 4, 8, 4}});
            for (int column = 14; column <= 19; ++column) {
                if (image.valid.at<uchar>(7, column) == 0)
                    continue;
                EXPECT_NEAR(255.0 * image.radiance.at<float>(7, column),
                            255.0 * share_beyond_fold(camera, column, 7), 0.13)
                    << "angle " << angle << ", border at " << x << ", column " << column;
            }
        }
}

// Blurred, a pixel beside the border is off by what the plan states: 0.45 gray.
TEST(FoldBorder, IsWithinWhatThePlanStatesUnderALens) {
    CameraModel camera;
    camera.width = 640;
    camera.height = 480;
    camera.intrinsics = {616.6, 616.6, 319.5, 239.5};
    camera.distortion.k1 = -0.38;
    camera.sensor = Sensor{.pixel_pitch_um = 4.8};
    camera.lens = Lens{2.8, 150.0, 600.0, {}};
    const Marker marker = parse_marker("apriltag:36h11:5@60mm", "marker");
    const Rigid pose{rotation_from_vector({0.26494, 0.01620, 0.57263}), {272.0, 204.0, 400.0}};
    const Scene scene{{{marker.grid, pose}}, 1.0};
    const cv::Rect region(636, 456, 3, 3);
    const RenderedImage image = Renderer(camera).render(scene, {.region = region});
    const ReferenceImage reference =
        integrate_reference(camera, scene, region, {.scrambles = 16, .samples_per_scramble = 4096});
    EXPECT_LT(image.plan.border_gray, 0.5);
    EXPECT_LT(image.plan.sampling_gray, 0.1);
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x)
            if (image.valid.at<uchar>(region.y + y, region.x + x) != 0) {
                EXPECT_NEAR(255.0 * image.radiance.at<float>(region.y + y, region.x + x),
                            255.0 * reference.mean.at<float>(y, x),
                            0.1 + image.plan.border_gray +
                                4.0 * 255.0 * reference.standard_error.at<float>(y, x));
            }
}

}  // namespace
}  // namespace etalon
