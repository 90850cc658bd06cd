// What calibrations state against what noise does to them: deviations, the difference of halves,
// how often a true board is called bent and how often intervals hold the truth of a bowed board,
// and which model the cross-validation advises for a wide lens.
#include <iostream>

#include "calib/intrinsics/camera_consistency.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

// n calibrations of the same views with independent noise of 0.3 px. An estimated standard
// deviation from n = 60 has the relative standard error 1/sqrt(2 (n - 1)) = 0.092; the formal one
// varies with the residuals' variance, by 1/sqrt(2 * 783) = 0.025. Four of both together: 0.38.
TEST(CalibrateStatistics, FormalDeviationsAreWhatIndependentNoiseDoes) {
    const int n = 60;
    const CameraModel truth = calibration_truth();
    Eigen::Matrix<double, 9, 1> sum, squares, formal;
    for (auto* each : {&sum, &squares, &formal})
        each->setZero();
    double mean_squares = 0.0;
    for (int run = 0; run < n; ++run) {
        const auto calibration =
            calibrate_camera(synthetic_views(truth, 8, 0.3, 100 + run), {640, 480},
                             {.model = "standard", .leave_one_out = false, .resamples = 0});
        const Eigen::VectorXd x = parameters_of(calibration.camera, calibration.model);
        sum += x;
        squares += x.cwiseAbs2();
        for (int p = 0; p < 9; ++p)
            formal[p] += calibration.deviations[p].formal / n;
        mean_squares += calibration.rms_px * calibration.rms_px / n;
    }
    const Eigen::Matrix<double, 9, 1> variance = (squares - sum.cwiseAbs2() / n) / (n - 1);
    for (int p = 0; p < 9; ++p)
        EXPECT_NEAR(std::sqrt(variance[p]) / formal[p], 1.0, 0.38) << p;
    // 864 residuals less 57 parameters, over 432 points: 0.09 * 807 / 432. Relative standard error
    // sqrt(2 / (807 * 60)) = 0.0064, four of it.
    EXPECT_NEAR(mean_squares, 0.09 * 807 / 432, 0.09 * 807 / 432 * 0.026);
}

// A photo whose corners err together, by a bend that no pose takes back: up to 0.4 px at 100 mm
// from the board's middle, of another size in each photo.
void bend(CalibrationView& view, RandomStream& random) {
    const double across = 0.4 * random.normal(), down = 0.4 * random.normal();
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const double x = (view.points_mm[i].x() - 100) / 100, y = (view.points_mm[i].y() - 62) / 62;
        view.pixels[i] += Eigen::Vector2d(across * x * x * y, down * y * y * x);
    }
}

// Of 150 runs the scatter's variance has a relative standard error of sqrt(2 / 149) = 0.116; the
// mean of the robust variances of 10 views has a smaller one. 3.5 of both: 0.5. The correction for
// few views is exact for independent points only.
TEST(CalibrateStatistics, RobustDeviationsAreWhatPhotosDoWhoseCornersErrTogether) {
    const int n = 150;
    const CalibrationModel& model = calibration_model("radial");
    CameraModel truth = calibration_truth();
    truth.distortion = {.k1 = -0.27, .k2 = 0.09};
    Eigen::Matrix<double, 6, 1> sum, squares, robust, formal;
    for (auto* each : {&sum, &squares, &robust, &formal})
        each->setZero();
    for (int run = 0; run < n; ++run) {
        auto views = synthetic_views(truth, 10, 0.1, 4000 + run);
        RandomStream random(5000 + run, 3);
        for (CalibrationView& view : views)
            bend(view, random);
        const CameraFit fit = fit_camera(views, {640, 480}, model);
        const auto covariances = covariances_of(view_equations(views, fit), model, fit.variance);
        const Eigen::VectorXd found = parameters_of(fit.camera, model);
        sum += found;
        squares += found.cwiseAbs2();
        robust += covariances.cluster_robust.diagonal() / n;
        formal += covariances.formal.diagonal() / n;
    }
    const Eigen::Matrix<double, 6, 1> variance = (squares - sum.cwiseAbs2() / n) / (n - 1);
    for (int p = 0; p < 6; ++p)
        EXPECT_NEAR(robust[p] / variance[p], 1.0, 0.5) << model.parameters[p];
    EXPECT_LT(formal.cwiseQuotient(variance).minCoeff(), 0.6);
}

// The difference of two halves, squared, over what their formal covariances lead to expect: a sum
// of squares of about nine parameters' worth, of which few matter, with mean 1. Of 40 runs with a
// relative deviation of at most sqrt(2): standard error 0.22; 3.5 of it.
TEST(CrossValidationStatistics, HalvesDifferAsMuchAsTheirCovariancesSay) {
    const CalibrationModel& model = calibration_model("radial");
    const int runs = 40;
    double ratio = 0.0, robust = 0.0;
    for (int run = 0; run < runs; ++run) {
        const auto views = synthetic_views(calibration_truth(), 8, 0.2, 500 + run);
        const auto halves = cross_validate(views, fit_camera(views, image_size, model));
        EXPECT_EQ(halves.views[0], 4u);
        EXPECT_EQ(halves.views[1], 4u);
        ratio += std::pow(halves.rms_px / halves.expected_formal_px, 2) / runs;
        robust += std::pow(halves.expected_robust_px / halves.expected_formal_px, 2) / runs;
    }
    EXPECT_NEAR(ratio, 1.0, 3.5 * 0.22);
    EXPECT_NEAR(robust, 1.0, 3.5 * 0.22);
}

TEST(BoardShapeStatistics, TrueBoardsAreCalledBentAsRarelyAsStated) {
    constexpr int runs = 150;
    const CalibrationModel& model = calibration_model("standard");
    for (const int count : {8, 11}) {
        int alarms = 0;
        for (int run = 0; run < runs; ++run) {
            const auto views = test::views_of(flat, count, 0.1, 100 + run);
            alarms += check_board(views, fit_camera(views, image_size, model))->is_distorted();
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
Coverage coverage_of(const Displacement& displacement, bool fit_board, int runs) {
    Coverage coverage;
    const CalibrationModel& model = calibration_model("standard");
    const Eigen::VectorXd truth = parameters_of(calibration_truth(), model);
    for (int run = 0; run < runs; ++run) {
        const CameraCalibration found = calibrate_camera(
            test::views_of(displacement, 12, 0.1, 500 + run), image_size,
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
    const Coverage drawn = coverage_of(bow, false, runs), fitted = coverage_of(bow, true, runs);
    EXPECT_LT(drawn.held, 0.95 - 4 * deviation);
    EXPECT_GT(std::abs(drawn.bias[0]), 2 * drawn.deviation[0]);
    EXPECT_GT(fitted.held, 0.95 - 4 * deviation);
    EXPECT_LT(std::abs(fitted.bias[0]), 4 * fitted.deviation[0] / std::sqrt(double(runs)));
}

TEST(BoardShapeStatistics, AFlatBoardLosesLittle) {
    constexpr int runs = 40;
    const Coverage drawn = coverage_of(flat, false, runs), fitted = coverage_of(flat, true, runs);
    EXPECT_GT(fitted.held, 0.95 - 4 * std::sqrt(0.95 * 0.05 / (3.0 * runs)));
    EXPECT_LT(fitted.deviation[0], 2.0 * drawn.deviation[0]);
}

// Boards 350 to 450 mm away whose middles lie up to 43 degrees from the axis, their corners up to
// 59: what a lens of 120 degrees sees.
Rigid mildly_wide_pose(int view) {
    return pose_aside(view, {0.1, 0.45, 0.75}, 400.0);
}

const ModelScore& score_of(const CameraCalibration& calibration, const std::string& model) {
    return *std::ranges::find(calibration.advice.models, model, &ModelScore::model);
}

// Perspective models and those of wide lenses are held against each other where photos may tell
// them apart, and nowhere else. 0.1 px of noise is 0.141 px of distance.
TEST(WideCalibration, ComparesPerspectiveModelsWithThoseOfWideLenses) {
    const CameraCalibration ordinary = calibrate_camera(
        synthetic_views(calibration_truth(), 12, 0.1, 3), image_size, {.resamples = 0});
    EXPECT_EQ(ordinary.advice.models.size(), calibration_models().size());
    EXPECT_EQ(ordinary.model.name, "standard");

    const CameraModel mild = wide_truth({Projection::equidistant}, 374.0,
                                        {.k1 = 0.031, .k2 = -0.014, .k3 = 0.0021, .k7 = -2e-4});
    const CameraCalibration either = calibrate_camera(
        synthetic_views(mild, 12, 0.1, 1, mildly_wide_pose), image_size, {.resamples = 0});
    EXPECT_EQ(either.advice.models.size(), perspective_and_wide_models().size());
    EXPECT_LT(*either.leave_one_out_rms_px, 0.15);
    // Rational holds such a lens as well, with twice as many parameters: in 6 of 16 draws within the
    // standard error, and then it is advised. In this one it is not.
    EXPECT_LT(*score_of(either, "rational").leave_one_out_rms_px, 0.15);
    EXPECT_LE(either.model.parameters.size(), 8u);
    EXPECT_FALSE(either.camera.projection.is_flat());
    EXPECT_FALSE(score_of(either, "standard").doubt.empty());
    EXPECT_FALSE(score_of(either, "omnidirectional").doubt.empty());  // fx and xi for each other

    const CameraModel wide = wide_truth({Projection::double_sphere, -0.17, 0.59}, 165.0);
    const CameraCalibration far =
        calibrate_camera(wide_views(wide, 12, 0.1, 7), image_size, {.resamples = 0});
    EXPECT_EQ(far.model.name, "double_sphere");
    for (const CalibrationModel& model : calibration_models())
        EXPECT_THAT(score_of(far, model.name).doubt, HasSubstr("px in the fit, ")) << model.name;
    EXPECT_FALSE(score_of(far, "tilted").overfits);
}

TEST(WideCalibration, AdvisesAModelThatFollowsTheLens) {
    for (const std::size_t lens : {1u, 3u}) {
        const auto [name, truth] = wide_models()[lens];
        SCOPED_TRACE(name);
        const auto views = wide_views(truth, 12, 0.1, 5);
        EXPECT_EQ(camera_groups(views, image_size).size(), 1u);
        const CameraCalibration found = calibrate_camera(views, image_size, {.resamples = 0});
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

// ---- camera consistency

// How often an honest set is split: camera_groups() allows one in 100 000. And how mixed sets are
// told apart.

// As photos err: each view as a whole as much as all of its points do, the board bent by a
// paraboloid of its own, 0.15 mm from middle to corner.
CalibrationView bent(CalibrationView view, const CameraModel& camera, const Rigid& pose, int seed) {
    RandomStream random(seed, 2);
    const double across = 0.15 * random.normal(), along = 0.15 * random.normal();
    const Projector projector(camera);
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const Eigen::Vector3d flat = view.points_mm[i];
        const double x = (flat.x() - 100.0) / 100.0, y = (flat.y() - 62.5) / 62.5;
        const Eigen::Vector3d curled(flat.x(), flat.y(), across * x * x + along * y * y);
        view.pixels[i] +=
            projector.project(pose * curled).value() - projector.project(pose * flat).value();
    }
    return view;
}

// 120 sets each: that one is split has a chance of 0.0012 where views err independently.
void expect_no_split(bool with_bent_boards) {
    const CameraModel camera = calibration_truth();
    int split = 0;
    for (int set = 0; set < 120; ++set) {
        auto views = synthetic_views(camera, 8 + set % 7, 0.15, 100 + set);
        if (with_bent_boards)
            for (std::size_t i = 0; i < views.size(); ++i)
                views[i] = bent(views[i], camera, synthetic_pose(int(i)), 1000 * set + int(i));
        split += camera_groups(views, image_size).size() > 1 ? 1 : 0;
    }
    EXPECT_EQ(split, 0);
}

TEST(MixedViewsStatistics, SetsOfOneCameraAreNotSplit) {
    expect_no_split(false);
}
TEST(MixedViewsStatistics, NorThoseOfBentBoards) {
    expect_no_split(true);
}

struct Mix {
    std::vector<std::size_t> aside;
    double zoom, distortion;
};

class MixedViews : public testing::TestWithParam<Mix> {};

// Half a set may be either the largest group or the other.
TEST_P(MixedViews, AreToldApart) {
    const Mix& mix = GetParam();
    auto groups = camera_groups(mixed(mix.aside, zoomed(mix.zoom, mix.distortion)), image_size);
    ASSERT_EQ(groups.size(), 2u);
    EXPECT_GE(groups[0].views.size(), groups[1].views.size());
    if (groups[0].views == mix.aside)
        std::swap(groups[0], groups[1]);
    EXPECT_EQ(groups[1].views, mix.aside);
    const double truth = 537.0;  // (541 + 533) / 2
    EXPECT_NEAR(groups[0].focal_px, truth, 5.0 * groups[0].deviation_px);
    EXPECT_LT(groups[0].deviation_px, 2.0);
    // Of one view with the others' distortion the focal length makes up for its own.
    const double by_distortion = mix.aside.size() < 3 && mix.distortion != 1.0 ? 6.0 : 0.0;
    EXPECT_NEAR(groups[1].focal_px, mix.zoom * truth, 5.0 * groups[1].deviation_px + by_distortion);
    EXPECT_LT(groups[1].deviation_px, 8.0);
}

using I = std::vector<std::size_t>;
INSTANTIATE_TEST_SUITE_P(OneThreeAndSixOfTwelve, MixedViews,
                         testing::Values(Mix{I{5}, 1.03, 1.0}, Mix{I{5}, 0.97, 0.8},
                                         Mix{I{0}, 1.3, 0.8}, Mix{I{0, 5, 8}, 1.03, 1.0},
                                         Mix{I{0, 5, 8}, 0.97, 0.8}, Mix{I{0, 1, 2}, 1.3, 1.0},
                                         Mix{I{0, 1, 2, 3, 4, 5}, 0.97, 1.0},
                                         Mix{I{0, 2, 5, 6, 8, 10}, 1.03, 0.8},
                                         Mix{I{0, 2, 5, 6, 8, 10}, 1.3, 0.8}));

TEST(MixedViews, OfThreeZoomsAreThreeGroups) {
    auto views = mixed({0, 5, 8}, zoomed(1.3));
    for (const int i : {1, 4, 9})
        views[std::size_t(i)] =
            synthetic_view(zoomed(1.12), synthetic_pose(i), mixed_noise_px, 700 + i);
    const auto groups = camera_groups(views, image_size);
    ASSERT_EQ(groups.size(), 3u);
    EXPECT_THAT(groups[0].views, ElementsAre(2u, 3u, 6u, 7u, 10u, 11u));
    for (const auto& group : {groups[1], groups[2]})
        EXPECT_THAT(group.views, testing::AnyOf(ElementsAre(0u, 5u, 8u), ElementsAre(1u, 4u, 9u)));
}

TEST(MixedViews, NeedFiveViewsThatDetermineACamera) {
    auto views = mixed({0}, zoomed(1.3));
    views.resize(4);
    const auto groups = camera_groups(views, image_size);
    ASSERT_EQ(groups.size(), 1u);
    EXPECT_EQ(groups[0].views.size(), 4u);
    const std::vector<CalibrationView> alike(6, mixed({}, calibration_truth())[2]);
    EXPECT_EQ(camera_groups(alike, image_size).size(), 1u);  // determine nothing
}

}  // namespace
}  // namespace etalon
