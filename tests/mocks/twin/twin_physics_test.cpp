#include "sim/twin/twin_physics.h"

#include "sim/marker/marker.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

CameraModel camera_with_noise() {
    CameraModel camera =
        test::camera_with(64, 48, {75.0, 73.0, 30.0, 25.0}, {.k1 = -0.2, .k2 = 0.05});
    camera.sensor = Sensor{.pixel_pitch_um = 8.3, .gain_e_per_dn = 40.0, .read_noise_e = 20.0};
    return camera;
}

TwinScene scene() {
    TwinScene scene;
    scene.marker = parse_marker("apriltag:36h11:5@50mm", "test").grid;
    scene.background = 0.6;
    scene.camera_from_base.translation = {7.0, -5.0, 300.0};
    return scene;
}

Rigid moved(double x, double y, double z) {
    return {Eigen::Quaterniond::Identity(), {x, y, z}};
}

TEST(TwinPhysics, PutsErrorsIntoTheParametersTheyName) {
    const CameraModel camera = with_errors(
        camera_with_noise(),
        {.focal_length_percent = 0.5, .k1_percent = 10.0, .principal_point_px = {0.7, -0.3}});
    EXPECT_NEAR(camera.intrinsics.fx, 75.375, 1e-12);
    EXPECT_NEAR(camera.intrinsics.fy, 73.365, 1e-12);
    EXPECT_NEAR(camera.intrinsics.cx, 30.7, 1e-12);
    EXPECT_NEAR(camera.intrinsics.cy, 24.7, 1e-12);
    EXPECT_NEAR(camera.distortion.k1, -0.22, 1e-12);
    EXPECT_EQ(camera.distortion.k2, 0.05);
}

TEST(TwinPhysics, ChainsCameraBaseCarriageAndMarker) {
    const TwinPhysics physics(camera_with_noise(), scene(), RenderMethod::automatic, 7);
    Scene expected{{{scene().marker, moved(7.0 - 12.0, -5.0 + 4.0, 330.0)}}, 0.6};
    const Radiance rendered = Renderer(camera_with_noise()).render(expected).radiance;
    const Radiance shown = physics.radiance(moved(-12.0, 4.0, 30.0));
    EXPECT_LT(cv::norm(shown, rendered, cv::NORM_INF), 1e-6);
    EXPECT_GT(cv::norm(shown, physics.radiance(moved(0, 0, 0)), cv::NORM_INF), 0.3);
}

TEST(TwinPhysics, ShowsBackgroundWhereTheMarkerCannotBeRenderedOrSeen) {
    const TwinPhysics physics(camera_with_noise(), scene(), RenderMethod::automatic, 7);
    for (const Rigid& away : {moved(0, 0, -300), moved(0, 0, -400), moved(5000, 0, 0)}) {
        const Radiance shown = physics.radiance(away);
        ASSERT_EQ(shown.size(), cv::Size(64, 48));
        EXPECT_LT(cv::norm(shown, cv::Mat(48, 64, CV_32FC1, cv::Scalar(0.6f)), cv::NORM_INF), 1e-5);
    }
}

TEST(TwinPhysics, MakesTheSameNoiseOfTheSameSeedAndFrameOnly) {
    const TwinPhysics physics(camera_with_noise(), scene(), RenderMethod::automatic, 7);
    const TwinPhysics other_seed(camera_with_noise(), scene(), RenderMethod::automatic, 8);
    const Radiance light(48, 64, CV_32FC1, cv::Scalar(0.6f));
    const auto differ = [](const CodeImage& a, const CodeImage& b) {
        return cv::norm(a.pixels, b.pixels, cv::NORM_INF) > 0.0;
    };
    const CodeImage frame = physics.expose(light, 1.0, 3);
    EXPECT_FALSE(differ(frame, physics.expose(light, 1.0, 3)));
    EXPECT_TRUE(differ(frame, physics.expose(light, 1.0, 4)));
    EXPECT_TRUE(differ(frame, other_seed.expose(light, 1.0, 3)));
}

TEST(TwinPhysics, ExposesInProportionAndSaturates) {
    CameraModel camera = camera_with_noise();
    camera.sensor->gain_e_per_dn = camera.sensor->read_noise_e = 0.0;
    const TwinPhysics physics(camera, scene(), RenderMethod::automatic, 7);
    const Radiance light(48, 64, CV_32FC1, cv::Scalar(0.4f));
    EXPECT_EQ(physics.expose(light, 1.0, 0).pixels.at<std::uint8_t>(7, 5), 102);
    EXPECT_EQ(physics.expose(light, 2.0, 0).pixels.at<std::uint8_t>(7, 5), 204);
    EXPECT_EQ(physics.expose(light, 3.0, 0).pixels.at<std::uint8_t>(7, 5), 255);
    EXPECT_EQ(physics.expose(light, 0.0, 0).pixels.at<std::uint8_t>(7, 5), 0);
}

}  // namespace
}  // namespace etalon
