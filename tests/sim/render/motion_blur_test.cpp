#include "sim/render/motion_blur.h"

#include "tests/gray.h"
#include "tests/sim/edge_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

CameraModel narrow_pinhole() {
    return test::camera_with(64, 24, {400.0, 400.0, 31.0, 11.0}, {});
}

// 4 x 3 cells in an image of 64 x 24 px.
Scene moving_marker() {
    return {{test::twelve_cells({3.0, 2.0}, {-6.0, -3.0},
                                {rotation_from_vector({0.3, -0.4, 0.2}), {1.0, -0.5, 250.0}})}};
}

MotionDuringExposure along_x(double mm_per_s, double exposure_s) {
    MotionDuringExposure motion{Vector6d::Zero(), exposure_s};
    motion.velocity[3] = mm_per_s;
    return motion;
}

// Integral of the pixel's value (the part of it right of the edge) from an edge at minus infinity.
double swept(double edge_to_pixel_px) {
    const double t = edge_to_pixel_px + 0.5;
    return t <= 0.0 ? 0.0 : t >= 1.0 ? t - 0.5 : 0.5 * t * t;
}

// 400 px/mm/250 mm = 1.6 px per mm: the edge sweeps from 33.4 - 4.8 to 33.4 + 4.8.
TEST(MovingEdge, IsTheTrapeziumOfItsSweep) {
    const auto moving = render_moving(Renderer(narrow_pinhole()), test::half_plane(1.5, 250.0),
                                      along_x(120.0, 0.05));
    EXPECT_GE(moving.path_px, 9.6);
    for (int x = 20; x < 48; ++x) {
        const double from = x - (33.4 - 4.8), to = x - (33.4 + 4.8);
        EXPECT_NEAR(moving.image.radiance.at<float>(10, x), (swept(from) - swept(to)) / 9.6,
                    0.1 * gray)
            << x;
    }
}

// The error of a swept edge's parts, 255 * 9.6 px / (4 n^2) gray, is at most 0.05 gray from
// sqrt(255 * 9.6 / 0.2) = 110.6 parts on.
TEST(MovingEdge, NeedsItsParts) {
    EXPECT_EQ(parts_of_exposure(9.6, 1.0, 0.05), 111);
}

TEST(MovingMarker, IsTheLongAverageOfStillOnes) {
    const Renderer renderer(narrow_pinhole());
    const Scene scene = moving_marker();
    MotionDuringExposure motion{Vector6d::Zero(), 0.02};
    motion.velocity << 0.4, -1.1, 6.0, 90.0, -40.0, 300.0;
    const auto moving = render_moving(renderer, scene, motion);
    cv::Mat sum = cv::Mat::zeros(24, 64, CV_64FC1);
    constexpr int steps = 600;
    for (int i = 0; i < steps; ++i) {
        const double t = ((i + 0.5) / steps - 0.5) * 0.02;
        Scene still = scene;
        still.markers[0].camera_from_marker =
            left_perturbed(scene.markers[0].camera_from_marker, motion.velocity * t);
        sum += renderer.render(still).radiance / steps;
    }
    EXPECT_LT(moving.parts, steps / 3);
    EXPECT_GT(moving.path_px, 2.5);
    cv::Mat truth;
    sum.convertTo(truth, CV_32F);
    EXPECT_LT(cv::norm(moving.image.radiance, truth, cv::NORM_INF), 0.1 * gray);
    EXPECT_GT(cv::norm(renderer.render(scene).radiance, truth, cv::NORM_INF), 20 * gray);
}

TEST(MovingMarker, StandsStillWithoutMotion) {
    const Renderer renderer(narrow_pinhole());
    const auto moving = render_moving(renderer, moving_marker(), along_x(120.0, 0.0));
    EXPECT_EQ(moving.parts, 1);
    EXPECT_EQ(moving.path_px, 0.0);
    const Radiance still = renderer.render(moving_marker(), {.tolerance_gray = 0.05}).radiance;
    EXPECT_EQ(cv::norm(moving.image.radiance, still, cv::NORM_INF), 0.0);
}

TEST(MovingScene, MovesAsOneBody) {
    Scene scene = moving_marker();
    scene.markers.push_back(scene.markers[0]);
    scene.markers[1].camera_from_marker.translation += Eigen::Vector3d(20.0, 5.0, -3.0);
    MotionDuringExposure motion{Vector6d::Zero(), 1.0};
    motion.velocity << 0.1, 0.2, -0.5, 3.0, 4.0, 5.0;
    const Scene moved = scene_at(scene, motion, 0.3);
    const auto relative = [](const Scene& s) {
        return s.markers[0].camera_from_marker.inverse() * s.markers[1].camera_from_marker;
    };
    EXPECT_LT(left_difference(relative(scene), relative(moved)).norm(), 1e-12);
    const Vector6d done =
        left_difference(scene.markers[0].camera_from_marker, moved.markers[0].camera_from_marker);
    EXPECT_LT((done - 0.3 * motion.velocity).norm(), 1e-12);
}

TEST(MotionDuringExposure, RefusesWhatIsNone) {
    const Renderer renderer(narrow_pinhole());
    EXPECT_THROW(render_moving(renderer, moving_marker(), along_x(std::nan(""), 0.1)),
                 NumericalError);
    EXPECT_THROW(render_moving(renderer, moving_marker(), along_x(1.0, -0.1)), NumericalError);
    EXPECT_THROW(render_moving(renderer, moving_marker(), along_x(1e9, 1.0)), NumericalError);
}

}  // namespace
}  // namespace etalon
