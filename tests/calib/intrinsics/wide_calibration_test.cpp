// Calibrating lenses that see more than a plane: found from the views alone.

#include "calib/intrinsics/calibration_start.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(WideCalibration, FindsTheCameraThatMadeExactViews) {
    for (const auto& [name, truth] : test::wide_models()) {
        SCOPED_TRACE(name);
        const CalibrationModel& model = calibration_model(name);
        const CameraFit fit =
            fit_camera(test::wide_views(truth, 9, 0.0, 1), test::image_size, model);
        EXPECT_TRUE(fit.converged);
        EXPECT_LT(
            (parameters_of(fit.camera, model) - parameters_of(truth, model)).cwiseAbs().maxCoeff(),
            1e-6);
        EXPECT_EQ(fit.camera.projection.kind, truth.projection.kind);
        for (int v = 0; v < 9; ++v)
            EXPECT_LT((fit.camera_from_target[static_cast<std::size_t>(v)].translation -
                       test::wide_pose(v).translation)
                          .norm(),
                      1e-4);
    }
}

TEST(WideCalibration, FindsAPoseBesideTheAxis) {
    for (const auto& [name, truth] : test::wide_models())
        for (int v = 0; v < 6; ++v) {
            const Rigid pose =
                fit_view_pose(truth, test::synthetic_view(truth, test::wide_pose(v), 0.0, 1));
            EXPECT_LT((pose.translation - test::wide_pose(v).translation).norm(), 1e-6)
                << name << v;
        }
}

TEST(WideCalibration, TellsWideLensesFromOthers) {
    for (const auto& [name, truth] : test::wide_models())
        EXPECT_EQ(lens_angle(test::wide_views(truth, 9, 0.2, 3), test::image_size), LensAngle::wide)
            << name;
    EXPECT_EQ(
        lens_angle(test::synthetic_views(test::calibration_truth(), 9, 0.2, 3), test::image_size),
        LensAngle::ordinary);
    // Photos of two zooms follow neither kind.
    auto mixed = test::synthetic_views(test::calibration_truth(), 4, 0.2, 3);
    for (int v = 4; v < 8; ++v)
        mixed.push_back(test::synthetic_view(test::zoomed(1.3), test::synthetic_pose(v), 0.2, v));
    EXPECT_EQ(lens_angle(mixed, test::image_size), LensAngle::ordinary);
}

TEST(WideCalibration, RefusesWhatItCannotMean) {
    const auto views = test::wide_views(test::wide_models()[3].truth, 9, 0.1, 1);
    EXPECT_THAT(text_of_error<NumericalError>([&] {
                    fit_camera(
                        views, test::image_size, calibration_model("kannala_brandt"),
                        {.start = CameraStart{test::calibration_truth(), std::vector<Rigid>(9)}});
                }),
                HasSubstr("model kannala_brandt cannot start from a camera that is perspective"));
}

}  // namespace
}  // namespace etalon
