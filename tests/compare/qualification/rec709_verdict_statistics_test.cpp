// A perfect camera whose codes follow Rec. 709, through pixels: photographs with noise, AprilTag on
// photographs and renders, and photometric poses. The curve moves the detector's edges: B1 has it,
// B3 has not, and B4 takes it between the photograph's own levels.
#include <gtest/gtest.h>

#include "compare/make_detector.h"
#include "compare/photometric/photometric_detector.h"
#include "sim/sensor/sensor_model.h"
#include "tests/compare/qualification/simulated_run.h"

namespace etalon {
namespace {

constexpr double background = 0.6, white_level = 0.8;

CameraModel rec709_camera(const CameraModel& geometry) {
    CameraModel camera = geometry;
    camera.lens = Lens{1.4, 1200.0, 550.0, {}};
    camera.sensor = Sensor{.pixel_pitch_um = 5.0,
                           .transfer = {Transfer::Kind::rec709, {}},
                           .black_dn = 8,
                           .gain_e_per_dn = 60,
                           .read_noise_e = 10};
    return camera;
}

// Of a coordinate in one exposure, from six.
CornerNoise noise_of_exposures(
    const std::function<std::optional<DetectedCorners>(std::uint32_t frame)>& corners_in,
    std::uint32_t first) {
    constexpr std::uint32_t exposures = 6;
    Eigen::MatrixXd seen(8, exposures);
    for (std::uint32_t i = 0; i < exposures; ++i) {
        const Corners corners = corners_in(first + i).value().pixels;
        seen.col(i) = Eigen::Map<const Eigen::VectorXd>(corners.front().data(), 8);
    }
    const double freedom = 8.0 * (exposures - 1.0);
    return {(seen.colwise() - seen.rowwise().mean()).squaredNorm() / freedom, freedom};
}

TEST(Rec709, DoesNotKeepAPerfectCameraFromPassing) {
    SimulatedRun run = demo_run();
    run.camera = run.true_camera = rec709_camera(run.camera);
    run.training = 20;
    run.hold_out = 20;
    run.limits.b4_position_field_rms_mm = 0.16;
    run.limits.b4_position_field_max_mm = 0.45;
    const Marker marker = parse_marker("apriltag:36h11:5@80mm", "test");
    const Renderer renderer(run.camera);
    const SensorModel sensor(run.camera);
    const auto detector = make_detector("auto", marker, "test");
    const PhotometricDetector photometric(run.camera, marker, "test");
    const auto radiance = [&](const Rigid& pose) {
        return Radiance(renderer.render({{{marker.grid, pose}}, background}).radiance *
                        white_level);
    };

    QualificationInput input = input_of(run, 1);
    input.render_and_detect = [&](const Rigid& pose) -> std::optional<Corners> {
        const auto found = detector->detect(sensor.expose(radiance(pose))).corners;
        return found ? std::optional(found->pixels) : std::nullopt;
    };
    const auto all = positions(run, *run.plan_seed);
    for (std::size_t i = 0; i < all.size(); ++i) {
        RandomStream stage_noise(1, 100, i);
        const Rigid truth = true_pose(run, all[i], stage_noise, i);
        const CodeImage photo =
            sensor.expose(radiance(truth), NoiseKey{1, static_cast<std::uint32_t>(i)});
        const auto found = detector->detect(photo).corners;
        ASSERT_TRUE(found) << i;
        VisitedPose& pose = input.poses[i];
        pose.corners = found->pixels;
        pose.corner_noise.reset();
        if (i % 4 == 0)
            pose.stated_noise = noise_of_exposures(
                [&](std::uint32_t frame) {
                    return detector->detect(sensor.expose(radiance(truth), NoiseKey{2, frame}))
                        .corners;
                },
                static_cast<std::uint32_t>(100 * i));
        pose.photometric.reset();
        if (!pose.hold_out)
            continue;
        const auto start =
            estimate_pose(photometric.camera()->projector(), marker.points_mm, found->pixels);
        const PhotometricPose reading = photometric.find(photo, start->camera_from_marker, 0.5);
        pose.photometric = PhotometricReading{reading.camera_from_marker, reading.covariance};
    }
    const Qualification result = qualify(input);
    EXPECT_EQ(result.verdict, Outcome::pass);
    for (const JudgedQuantity& each : result.quantities) {
        EXPECT_EQ(each.outcome, Outcome::pass) << each.name;
        EXPECT_LT(each.value, each.expanded_uncertainty) << each.name;
    }
    double b1_mm = 0.0;
    for (const AnalysedPose& pose : result.poses)
        if (pose.hold_out && pose.bias.b1)
            b1_mm = std::max(b1_mm, pose.bias.b1->translation_mm.norm());
    EXPECT_GT(b1_mm, 3.0);  // 0.05 mm is left of it
}

}  // namespace
}  // namespace etalon
