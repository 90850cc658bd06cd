// Whether the halves of a set differ by as much as they are said to.
#include "calib/intrinsics/model_advice.h"

#include <gtest/gtest.h>

#include "tests/calib/synthetic_views.h"

namespace etalon {
namespace {

// The difference of two halves, squared, over what their formal covariances lead to expect: a sum
// of squares of about nine parameters' worth, of which few matter, with mean 1. Of 40 runs with a
// relative deviation of at most sqrt(2): standard error 0.22; 3.5 of it.
TEST(CrossValidationStatistics, HalvesDifferAsMuchAsTheirCovariancesSay) {
    const CalibrationModel& model = calibration_model("radial");
    const int runs = 40;
    double ratio = 0.0, robust = 0.0;
    for (int run = 0; run < runs; ++run) {
        const auto views = test::synthetic_views(test::calibration_truth(), 8, 0.2, 500 + run);
        const auto halves = cross_validate(views, fit_camera(views, test::image_size, model));
        EXPECT_EQ(halves.views[0], 4u);
        EXPECT_EQ(halves.views[1], 4u);
        ratio += std::pow(halves.rms_px / halves.expected_formal_px, 2) / runs;
        robust += std::pow(halves.expected_robust_px / halves.expected_formal_px, 2) / runs;
    }
    EXPECT_NEAR(ratio, 1.0, 3.5 * 0.22);
    EXPECT_NEAR(robust, 1.0, 3.5 * 0.22);
}

}  // namespace
}  // namespace etalon
