#include "compare/pose/pose_bias.h"

#include "tests/compare/qualification/simulated_run.h"
#include "tests/test.h"

namespace etalon {
namespace {

const Rigid camera_from_marker{rotation_from_vector({0.4, -0.1, 0.3}), {50.0, -30.0, 470.0}};

Corners widened(const Corners& corners) {
    return moved_outwards(corners, 0.3);
}

std::vector<RegistrationPose> training(const SimulatedRun& run) {
    std::vector<RegistrationPose> poses;
    const auto all = positions(run, 3);
    for (std::size_t i = 0; i < all.size(); ++i) {
        const Rigid stage = base_from_carriage(run.axes, all[i]);
        poses.push_back({stage, run.camera_from_base * stage * run.carriage_from_marker,
                         photo(run, all[i], 3, i)});
    }
    return poses;
}

SimulatedRun exact_run() {
    SimulatedRun run = without_noise(demo_run());
    run.nominal_carriage_from_marker = run.carriage_from_marker;
    return run;
}

TEST(PoseError, IsInTheCameraFrameForPositionsAndInTheMarkerFrameForRotations) {
    const Eigen::Vector3d turn(0.02, -0.01, 0.03), shift(1.0, -2.0, 3.0);
    const Rigid estimated{camera_from_marker.rotation * rotation_from_vector(turn),
                          camera_from_marker.translation + shift};
    const PoseError error = pose_error(estimated, camera_from_marker);
    EXPECT_LT((error.translation_mm - shift).norm(), 1e-12);
    EXPECT_LT((error.rotation_rad - turn).norm(), 1e-12);
}

TEST(PoseBias, KeepsTheDetectorTheStageAndTheCameraApart) {
    const SimulatedRun run = demo_run();
    const Projector projector(run.camera);
    Rigid truth = camera_from_marker;
    truth.translation += Eigen::Vector3d(0.7, -0.5, 1.1);
    const PoseBias bias =
        pose_bias(projector, run.points_mm, camera_from_marker,
                  widened(corners_at(projector, run.points_mm, truth)),
                  widened(corners_at(projector, run.points_mm, camera_from_marker)));
    ASSERT_TRUE(bias.b1 && bias.b2 && bias.b3);
    EXPECT_LT(bias.b1->translation_mm.z(), -1.0);  // a marker seen too large is seen too near
    EXPECT_LT((bias.b3->translation_mm - Eigen::Vector3d(0.7, -0.5, 1.1)).norm(), 0.03);
    EXPECT_LT((bias.b2->translation_mm - bias.b1->translation_mm - bias.b3->translation_mm).norm(),
              1e-9);
}

TEST(PoseBias, LeavesOutWhatWasNotDetected) {
    const SimulatedRun run = demo_run();
    const Projector projector(run.camera);
    const PoseBias bias = pose_bias(projector, run.points_mm, camera_from_marker, {},
                                    corners_at(projector, run.points_mm, camera_from_marker));
    EXPECT_TRUE(bias.b1);
    EXPECT_FALSE(bias.b2 || bias.b3);
}

// A board's first point is its origin. Tilted about the line from there to its middle, both planar
// solutions put it at almost the same place, and only the rotation tells them apart.
TEST(PoseBias, TellsTheSolutionsOfABoardApartByTheirRotation) {
    const auto board = parse_marker("chessboard:7x5@8mm", "test").points_mm;
    const Rigid truth{rotation_from_vector(0.4 * Eigen::Vector3d(3, 2, 0).normalized()),
                      {-24.0, -16.0, 470.0}};
    const CameraModel camera = demo_run().camera;
    const Corners corners = corners_at(Projector(camera), board, truth);
    const auto estimate = estimate_pose(Projector(camera), board, corners);
    ASSERT_TRUE(estimate && estimate->alternative);
    const Rigid predicted{truth.rotation, estimate->alternative->translation};
    const PoseBias bias = pose_bias(Projector(camera), board, predicted, corners, {});
    ASSERT_TRUE(bias.b2);
    EXPECT_LT(bias.b2->rotation_rad.norm(), 1e-6) << "0.8 rad for the other solution";
}

// A detector that draws corners apart by 0.3 px sees the marker about 5 mm too near. Registered on
// its corners as they are, X takes part of that over, and B3 would show it as the camera's error.
TEST(BiasCorrectedRegistration, KeepsTheDetectorsBiasOutOfXAndY) {
    SimulatedRun run = exact_run();
    run.detector = widened;
    const Projector projector(run.camera);
    const auto poses = training(run);
    const Registration naive =
        register_stage(projector, run.points_mm, poses, run.nominal_carriage_from_marker);
    EXPECT_GT((naive.camera_from_base.translation - run.camera_from_base.translation).norm(), 0.3);

    const auto render = [&](const Rigid& pose) -> std::optional<Corners> {
        return widened(corners_at(projector, run.points_mm, pose));
    };
    const BiasCorrectedRegistration corrected = register_bias_corrected(
        projector, run.points_mm, poses, run.nominal_carriage_from_marker, render);
    // The bias is taken at a pose that is a fraction of a pixel away: second order.
    EXPECT_LT(
        (corrected.registration.camera_from_base.translation - run.camera_from_base.translation)
            .norm(),
        2e-3);
    EXPECT_EQ(corrected.used.size(), poses.size());
    EXPECT_LE(corrected.rounds, 3);
}

TEST(BiasCorrectedRegistration, LeavesOutPosesWhoseRenderIsNotDetected) {
    const SimulatedRun run = exact_run();
    const Projector projector(run.camera);
    const auto poses = training(run);
    int calls = 0;
    const auto render = [&](const Rigid& pose) -> std::optional<Corners> {
        if (++calls % 5 == 0)
            return std::nullopt;
        return corners_at(projector, run.points_mm, pose);
    };
    const BiasCorrectedRegistration result = register_bias_corrected(
        projector, run.points_mm, poses, run.nominal_carriage_from_marker, render);
    EXPECT_EQ(result.used.size(), poses.size() - poses.size() / 5);
    EXPECT_LT(left_difference(run.camera_from_base, result.registration.camera_from_base).norm(),
              1e-6);
}

}  // namespace
}  // namespace etalon
