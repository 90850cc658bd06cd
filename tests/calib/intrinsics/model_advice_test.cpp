#include "calib/intrinsics/model_advice.h"

#include <opencv2/calib3d.hpp>

#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

ModelScore score(const char* name, int parameters, std::vector<double> left_out, double points) {
    ModelScore made;
    made.model = name;
    made.parameters = parameters;
    made.fit = CameraFit{.converged = true};
    made.projection_deviation_px = made.halves_px = 0.001;
    double sum = 0.0;
    for (const double each : left_out)
        sum += each;
    if (!left_out.empty())
        made.leave_one_out_rms_px = std::sqrt(sum / points);
    made.left_out_squares = std::move(left_out);
    return made;
}

std::vector<CalibrationView> five_views_of(std::size_t points) {
    CalibrationView view;
    view.pixels.resize(points);
    view.points_mm.resize(points);
    return std::vector<CalibrationView>(5, view);
}

// Sums of squares are of ten points a view, 50 in all. "c" is best with 1 px^2 a view.
//   b: 0.2 -0.1 0.3 -0.2 0.1 above it: the sum 0.3; about the mean 0.06 the squares add up to
//   0.172,
//      and sqrt(5/4 * 0.172) = 0.4637: within one standard error, and simpler than c.
//   a: 1.1 0.9 1.0 1.2 0.8 above it: 5.0 against sqrt(5/4 * 0.10) = 0.3536.
//   d: 1.5 in one view alone: 1.5 against sqrt(5/4 * 1.8) = 1.5. No more than a standard error, but
//      sqrt(6.5/5.3) - 1 = 10.7 % worse than b.
//   e: 0.02 -0.01 0.01 0.03 -0.02 above c: less than b is.
TEST(ModelAdvice, TakesTheSimplestModelWithinAStandardErrorOfTheBest) {
    std::vector<ModelScore> scores{score("a", 4, {2.1, 1.9, 2.0, 2.2, 1.8}, 50),
                                   score("b", 6, {1.2, 0.9, 1.3, 0.8, 1.1}, 50),
                                   score("c", 9, {1.0, 1.0, 1.0, 1.0, 1.0}, 50),
                                   score("d", 12, {1.0, 2.5, 1.0, 1.0, 1.0}, 50),
                                   score("e", 16, {1.02, 0.99, 1.01, 1.03, 0.98}, 50),
                                   score("f", 18, {}, 50)};
    scores.back().failed_view = 0;
    const ModelAdvice advice = compare_models(std::move(scores), five_views_of(10));
    EXPECT_EQ(advice.best, 2u);
    EXPECT_EQ(advice.advised, 1u);
    EXPECT_NEAR(advice.models[1].above_best, 0.3 / 50, 1e-12);
    EXPECT_NEAR(advice.models[1].above_best_error, std::sqrt(1.25 * 0.172) / 50, 1e-12);
    EXPECT_NEAR(advice.models[0].above_best, 5.0 / 50, 1e-12);
    EXPECT_NEAR(advice.models[0].above_best_error, std::sqrt(1.25 * 0.10) / 50, 1e-12);
    const bool overfits[] = {false, false, false, true, false, true};
    for (int i = 0; i < 6; ++i)
        EXPECT_EQ(advice.models[i].overfits, overfits[i]) << advice.models[i].model;
}

// Left-out errors fall from a to e; the best is 0.1 px.
std::vector<ModelScore> ever_better_scores() {
    std::vector<ModelScore> scores;
    double square = 1.0;
    for (const char* name : {"a", "b", "c", "d", "e"}) {
        const double less = square *= 0.5;
        scores.push_back(score(name, 4, std::vector<double>(5, less), 500));
    }
    return scores;
}

TEST(ModelAdvice, DoubtsModelsThatPredictButDoNotDetermineTheLens) {
    std::vector<ModelScore> scores = ever_better_scores();
    EXPECT_EQ(compare_models(scores, five_views_of(100)).advised, 4u);
    const double best = *scores[4].leave_one_out_rms_px;

    scores[4].projection_deviation_px = 2.1 * best;
    ModelAdvice advice = compare_models(scores, five_views_of(100));
    EXPECT_EQ(advice.advised, 3u);
    EXPECT_TRUE(advice.models[4].doubt.starts_with("its projection is certain to"));

    scores[3].halves_px = 3.1 * best;
    advice = compare_models(scores, five_views_of(100));
    EXPECT_EQ(advice.advised, 2u);
    EXPECT_TRUE(advice.models[3].doubt.starts_with("two halves of the photos differ by"));

    scores[2].halves_px.reset();
    advice = compare_models(scores, five_views_of(100));
    EXPECT_EQ(advice.advised, 1u);
    EXPECT_EQ(advice.models[2].doubt, "half of the photos do not determine it");

    scores[1].fit->converged = false;
    advice = compare_models(scores, five_views_of(100));
    EXPECT_EQ(advice.advised, 0u);
    EXPECT_EQ(advice.models[1].doubt, "its best fit lies where its distortion folds over");
}

// Few photos leave every model uncertain: that speaks against none of them.
TEST(ModelAdvice, DoubtsNoModelForWhatAllOfThemDoNotDetermine) {
    std::vector<ModelScore> scores = ever_better_scores();
    for (ModelScore& each : scores)
        each.projection_deviation_px = each.halves_px = 5.0;
    EXPECT_EQ(compare_models(scores, five_views_of(100)).advised, 4u);
}

// A standard error of two views is anything; 1.6 times the best error is not as good.
TEST(ModelAdvice, TakesNoModelThatIsAQuarterWorseHoweverLargeTheStandardError) {
    const ModelAdvice advice = compare_models({score("a", 4, {0.1, 5.0, 0.1, 0.1, 0.1}, 500),
                                               score("b", 6, {0.2, 1.9, 0.1, 0.2, 0.2}, 500)},
                                              five_views_of(100));
    EXPECT_LT(advice.models[0].above_best, advice.models[0].above_best_error);
    EXPECT_EQ(advice.advised, 1u);
}

// A wide lens on views whose plain start leads each model astray by itself.
TEST(ScoreModels, AModelNeverFitsWorseThanOneThatItContains) {
    CameraModel truth = calibration_truth();
    truth.distortion = {.k1 = 0.9,
                        .k2 = 0.11,
                        .p1 = 0.0004,
                        .p2 = -0.0007,
                        .k3 = 0.002,
                        .k4 = 1.2,
                        .k5 = 0.41,
                        .k6 = 0.03};
    for (const int seed : {1, 2, 3}) {
        const auto views = synthetic_views(truth, 9, 0.2, seed);
        const auto scores =
            score_models(views, image_size, calibration_models(), /*leave_out_views=*/false);
        for (std::size_t i = 1; i < scores.size(); ++i)
            EXPECT_LE(scores[i].rms_px, 1.0001 * scores[i - 1].rms_px) << scores[i].model;
    }
}

TEST(ModelAdvice, AdvisesNothingWhereNoViewWasLeftOut) {
    const ModelAdvice advice =
        compare_models({score("a", 4, {}, 50), score("b", 6, {}, 50)}, five_views_of(10));
    EXPECT_FALSE(advice.best);
    EXPECT_FALSE(advice.advised);
}

// OpenCV's own calibration and pose, one view at a time, of single-precision pixels.
double left_out_by_opencv(const std::vector<CalibrationView>& views, std::size_t left_out) {
    const auto [points, pixels] = opencv_views(views);
    auto [other_points, other_pixels] = opencv_views(views);
    other_points.erase(other_points.begin() + left_out);
    other_pixels.erase(other_pixels.begin() + left_out);
    const cv::TermCriteria until(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 200, 1e-15);
    cv::Mat k, d, r, t;
    std::vector<cv::Mat> rotations, translations;
    cv::calibrateCamera(other_points, other_pixels, image_size, k, d, rotations, translations, 0,
                        until);
    cv::solvePnP(points[left_out], pixels[left_out], k, d, r, t);
    cv::solvePnPRefineLM(points[left_out], pixels[left_out], k, d, r, t, until);
    std::vector<cv::Point2f> projected;
    cv::projectPoints(points[left_out], r, t, k, d, projected);
    double sum = 0.0;
    for (std::size_t i = 0; i < projected.size(); ++i) {
        const cv::Point2f difference = pixels[left_out][i] - projected[i];
        sum += difference.ddot(difference);
    }
    return sum;
}

// 54 points of 0.3 px noise: 10 px^2 a view. OpenCV's single precision leaves 1e-4 of that.
TEST(ModelAdvice, LeavesOutAsOpenCvWould) {
    const auto views = synthetic_views(calibration_truth(), 6, 0.3, 4);
    const auto scores = score_models(views, image_size, {{calibration_model("standard")}});
    ASSERT_EQ(scores[0].left_out_squares.size(), 6u);
    double sum = 0.0;
    for (std::size_t v = 0; v < views.size(); ++v) {
        const double by_opencv = left_out_by_opencv(views, v);
        EXPECT_NEAR(scores[0].left_out_squares[v] / by_opencv, 1.0, 1e-3) << v;
        sum += by_opencv;
    }
    EXPECT_NEAR(*scores[0].leave_one_out_rms_px, std::sqrt(sum / (6 * 54)), 1e-3 * 0.4);
}

// With k1 and k2 alone in the lens, the richer model has nothing to find. One standard error lets
// the wrong one through in about a sixth of the cases: more than half of 12 in 1 of 100 000.
TEST(ModelAdvice, AdvisesTheModelThatTheLensHas) {
    CameraModel truth = calibration_truth();
    truth.distortion = {.k1 = -0.27, .k2 = 0.09};
    const auto models = std::span(calibration_models()).first(3);
    int right = 0;
    for (int seed = 0; seed < 12; ++seed) {
        const auto views = synthetic_views(truth, 7, 0.2, 300 + seed);
        const ModelAdvice advice = compare_models(score_models(views, image_size, models), views);
        ASSERT_TRUE(advice.advised);
        right += advice.models[*advice.advised].model == "radial";
        EXPECT_NE(advice.models[*advice.advised].model, "pinhole");
    }
    EXPECT_GT(right, 6);
}

TEST(ModelAdvice, SaysWhyAModelHasNoScore) {
    auto views = synthetic_views(calibration_truth(), 3, 0.2, 4);
    const auto three = score_models(views, image_size, {{calibration_model("radial")}});
    EXPECT_TRUE(three[0].fit);
    EXPECT_FALSE(three[0].leave_one_out_rms_px);
    const Rigid flat_on{Eigen::Quaterniond::Identity(), {-100.0, -62.0, 500.0}};
    views.assign(5, synthetic_view(calibration_truth(), flat_on, 0.2, 4));
    const auto alike = score_models(views, image_size, {{calibration_model("radial")}});
    EXPECT_FALSE(alike[0].fit);
    EXPECT_FALSE(alike[0].failure.empty());
}

}  // namespace
}  // namespace etalon
