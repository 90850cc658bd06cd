// Which model the cross-validation advises for a wide lens.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calib/intrinsics/camera_consistency.h"
#include "tests/calib/synthetic_views.h"
#include "tests/calib/wide_views.h"

namespace etalon {
namespace {

using testing::HasSubstr;

// Boards 350 to 450 mm away whose middles lie up to 43 degrees from the axis, their corners up to
// 59: what a lens of 120 degrees sees.
Rigid mildly_wide_pose(int view) {
    const double turn = 2.4 * view, angles[] = {0.1, 0.45, 0.75}, angle = angles[view % 3];
    const Eigen::Vector3d sight(std::sin(angle) * std::cos(turn), std::sin(angle) * std::sin(turn),
                                std::cos(angle));
    const Eigen::Quaterniond rotation =
        rotation_between(Eigen::Vector3d::UnitZ(), sight) *
        rotation_from_vector(
            {0.55 * std::cos(3 * turn), 0.5 * std::sin(2 * turn), 0.15 * std::sin(5 * turn)});
    return {rotation,
            (400.0 + 50.0 * std::sin(4 * turn)) * sight - rotation * Eigen::Vector3d(100, 62.5, 0)};
}

const ModelScore& score_of(const CameraCalibration& calibration, const std::string& model) {
    return *std::ranges::find(calibration.advice.models, model, &ModelScore::model);
}

// Perspective models and those of wide lenses are held against each other where photos may tell
// them apart, and nowhere else. 0.1 px of noise is 0.141 px of distance.
TEST(WideCalibration, ComparesPerspectiveModelsWithThoseOfWideLenses) {
    const CameraCalibration ordinary =
        calibrate_camera(test::synthetic_views(test::calibration_truth(), 12, 0.1, 3),
                         test::image_size, {.resamples = 0});
    EXPECT_EQ(ordinary.advice.models.size(), calibration_models().size());
    EXPECT_EQ(ordinary.model.name, "standard");

    const CameraModel mild = test::wide_truth(
        {Projection::equidistant}, 374.0, {.k1 = 0.031, .k2 = -0.014, .k3 = 0.0021, .k7 = -2e-4});
    const CameraCalibration either =
        calibrate_camera(test::synthetic_views(mild, 12, 0.1, 3, mildly_wide_pose),
                         test::image_size, {.resamples = 0});
    EXPECT_EQ(either.advice.models.size(), perspective_and_wide_models().size());
    EXPECT_LT(*either.leave_one_out_rms_px, 0.15);
    // Rational holds such a lens as well, with twice as many parameters.
    EXPECT_LT(*score_of(either, "rational").leave_one_out_rms_px, 0.15);
    EXPECT_LE(either.model.parameters.size(), 8u);
    EXPECT_FALSE(either.camera.projection.is_flat());
    EXPECT_FALSE(score_of(either, "standard").doubt.empty());
    EXPECT_FALSE(score_of(either, "omnidirectional").doubt.empty());  // fx and xi for each other

    const CameraModel wide = test::wide_truth({Projection::double_sphere, -0.17, 0.59}, 165.0);
    const CameraCalibration far =
        calibrate_camera(test::wide_views(wide, 12, 0.1, 7), test::image_size, {.resamples = 0});
    EXPECT_EQ(far.model.name, "double_sphere");
    for (const CalibrationModel& model : calibration_models())
        EXPECT_THAT(score_of(far, model.name).doubt, HasSubstr("px in the fit, ")) << model.name;
    EXPECT_FALSE(score_of(far, "tilted").overfits);
}

TEST(WideCalibration, AdvisesAModelThatFollowsTheLens) {
    for (const std::size_t lens : {1u, 3u}) {
        const auto [name, truth] = test::wide_models()[lens];
        SCOPED_TRACE(name);
        const auto views = test::wide_views(truth, 12, 0.1, 5);
        EXPECT_EQ(camera_groups(views, test::image_size).size(), 1u);
        const CameraCalibration found = calibrate_camera(views, test::image_size, {.resamples = 0});
        EXPECT_EQ(found.advice.models.size(), perspective_and_wide_models().size());
        EXPECT_FALSE(found.camera.projection.is_flat());
        EXPECT_LT(found.rms_px, 0.1 * std::sqrt(2.0) * 1.05);
        EXPECT_LT(*found.leave_one_out_rms_px, 0.1 * std::sqrt(2.0) * 1.1);
        // Where the rays of the truth land, after the best rotation.
        const ImageRays rays = rays_among(image_rays(truth), all_pixels(views));
        const auto off = projection_difference(found.camera, rays,
                                               Eigen::VectorXd::Ones(std::ssize(rays.pixels)));
        for (const Eigen::Vector2d& each : off.differences_px)
            EXPECT_LT(each.norm(), 0.3);
    }
}

}  // namespace
}  // namespace etalon
