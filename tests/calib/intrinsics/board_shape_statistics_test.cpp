// How often a true board is called bent, and how often camera.yml's intervals hold the truth of a
// bowed board.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <iostream>

#include "tests/calib/intrinsics/bent_boards.h"

namespace etalon {
namespace {

TEST(BoardShapeStatistics, TrueBoardsAreCalledBentAsRarelyAsStated) {
    constexpr int runs = 150;
    const CalibrationModel& model = calibration_model("standard");
    for (const int count : {8, 11}) {
        int alarms = 0;
        for (int run = 0; run < runs; ++run) {
            const auto views = test::views_of(test::flat, count, 0.1, 100 + run);
            alarms += check_board(views, fit_camera(views, test::image_size, model))
                          ->is_distorted();
        }
        std::cout << count << " views: " << alarms << " false alarms of " << runs << "\n";
        // Binomial with max_board_chance: four standard deviations above the mean.
        EXPECT_LE(alarms, runs * max_board_chance + 4 * std::sqrt(runs * max_board_chance));
    }
}

// Squared errors over stated variances, and how many of the nine parameters' 95 % intervals hold
// the truth.
struct Coverage {
    double held = 0.0;
    std::array<double, 9> bias{}, deviation{};
};
Coverage coverage_of(const test::Displacement& displacement, bool fit_board, int runs) {
    Coverage coverage;
    const CalibrationModel& model = calibration_model("standard");
    const Eigen::VectorXd truth = parameters_of(test::calibration_truth(), model);
    for (int run = 0; run < runs; ++run) {
        const CameraCalibration found = calibrate_camera(
            test::views_of(displacement, 12, 0.1, 500 + run), test::image_size,
            {.model = "standard", .leave_one_out = false, .resamples = 0, .fit_board = fit_board});
        const Eigen::VectorXd error = parameters_of(found.camera, model) - truth;
        for (std::size_t i = 0; i < 9; ++i) {
            const double stated = found.deviations[i].stated;
            const double of = error[static_cast<Eigen::Index>(i)];
            coverage.held += std::abs(of) < 1.96 * stated ? 1.0 / (9.0 * runs) : 0.0;
            coverage.bias[i] += of / runs;
            coverage.deviation[i] += stated / runs;
        }
    }
    std::cout << (fit_board ? "fitted" : "as drawn") << ": intervals hold " << coverage.held
              << "; bias of fx " << coverage.bias[0] << " (stated " << coverage.deviation[0]
              << "), of k1 " << coverage.bias[4] << " (" << coverage.deviation[4] << ")\n";
    return coverage;
}

// The nine parameters of a run err together: as if three of them were independent.
TEST(BoardShapeStatistics, IntervalsHoldTheTruthOfABowedBoard) {
    constexpr int runs = 100;
    const double deviation = std::sqrt(0.95 * 0.05 / (3.0 * runs));
    const Coverage drawn = coverage_of(test::bow, false, runs),
                   fitted = coverage_of(test::bow, true, runs);
    EXPECT_LT(drawn.held, 0.95 - 4 * deviation);
    EXPECT_GT(std::abs(drawn.bias[0]), 2 * drawn.deviation[0]);
    EXPECT_GT(fitted.held, 0.95 - 4 * deviation);
    EXPECT_LT(std::abs(fitted.bias[0]), 4 * fitted.deviation[0] / std::sqrt(double(runs)));
}

TEST(BoardShapeStatistics, AFlatBoardLosesLittle) {
    constexpr int runs = 40;
    const Coverage drawn = coverage_of(test::flat, false, runs),
                   fitted = coverage_of(test::flat, true, runs);
    EXPECT_GT(fitted.held, 0.95 - 4 * std::sqrt(0.95 * 0.05 / (3.0 * runs)));
    EXPECT_LT(fitted.deviation[0], 2.0 * drawn.deviation[0]);
}

}  // namespace
}  // namespace etalon
