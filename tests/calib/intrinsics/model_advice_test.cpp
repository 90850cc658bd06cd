#include "calib/intrinsics/model_advice.h"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "tests/calib/synthetic_views.h"

namespace etalon {
namespace {

ModelScore score(const char* name, int parameters, std::vector<double> left_out, double points) {
    ModelScore made;
    made.model = name;
    made.parameters = parameters;
    made.fit = CameraFit{};
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

TEST(ModelAdvice, AdvisesNothingWhereNoViewWasLeftOut) {
    const ModelAdvice advice =
        compare_models({score("a", 4, {}, 50), score("b", 6, {}, 50)}, five_views_of(10));
    EXPECT_FALSE(advice.best);
    EXPECT_FALSE(advice.advised);
}

// OpenCV's own calibration and pose, one view at a time, of single-precision pixels.
double left_out_by_opencv(const std::vector<CalibrationView>& views, std::size_t left_out) {
    std::vector<std::vector<cv::Point3f>> points(views.size());
    std::vector<std::vector<cv::Point2f>> pixels(views.size());
    for (std::size_t v = 0; v < views.size(); ++v)
        for (std::size_t i = 0; i < views[v].pixels.size(); ++i) {
            points[v].emplace_back(views[v].points_mm[i].x(), views[v].points_mm[i].y(), 0);
            pixels[v].emplace_back(views[v].pixels[i].x(), views[v].pixels[i].y());
        }
    auto other_points = points;
    auto other_pixels = pixels;
    other_points.erase(other_points.begin() + left_out);
    other_pixels.erase(other_pixels.begin() + left_out);
    const cv::TermCriteria until(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 200, 1e-15);
    cv::Mat k, d, r, t;
    std::vector<cv::Mat> rotations, translations;
    cv::calibrateCamera(other_points, other_pixels, test::image_size, k, d, rotations, translations,
                        0, until);
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
    const auto views = test::synthetic_views(test::calibration_truth(), 6, 0.3, 4);
    const auto scores = score_models(views, test::image_size, {{calibration_model("standard")}});
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
    CameraModel truth = test::calibration_truth();
    truth.distortion = {.k1 = -0.27, .k2 = 0.09};
    const auto models = std::span(calibration_models()).first(3);
    int right = 0;
    for (int seed = 0; seed < 12; ++seed) {
        const auto views = test::synthetic_views(truth, 7, 0.2, 300 + seed);
        const ModelAdvice advice =
            compare_models(score_models(views, test::image_size, models), views);
        ASSERT_TRUE(advice.advised);
        right += advice.models[*advice.advised].model == "radial";
        EXPECT_NE(advice.models[*advice.advised].model, "pinhole");
    }
    EXPECT_GT(right, 6);
}

TEST(ModelAdvice, SaysWhyAModelHasNoScore) {
    auto views = test::synthetic_views(test::calibration_truth(), 3, 0.2, 4);
    const auto three = score_models(views, test::image_size, {{calibration_model("radial")}});
    EXPECT_TRUE(three[0].fit);
    EXPECT_FALSE(three[0].leave_one_out_rms_px);
    views.assign(5, views[0]);
    const auto alike = score_models(views, test::image_size, {{calibration_model("radial")}});
    EXPECT_FALSE(alike[0].fit);
    EXPECT_FALSE(alike[0].failure.empty());
}

}  // namespace
}  // namespace etalon
