#include "calib/intrinsics/calibration_outliers.h"

#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

std::vector<std::pair<int, int>> found_in(const CornerMask& mask) {
    std::vector<std::pair<int, int>> found;
    for (std::size_t v = 0; v < mask.size(); ++v)
        for (std::size_t i = 0; i < mask[v].size(); ++i)
            if (mask[v][i])
                found.emplace_back(v, i);
    return found;
}

const CalibrationOptions radial_fit{.model = "radial", .leave_one_out = false, .resamples = 0};

CornerMask corners_of(const std::vector<CalibrationView>& views) {
    return find_outlier_corners(views, image_size, {{calibration_model("standard")}});
}

// Six scales: of 756 points with normal errors one exceeds them in 8e-6 of all calibrations.
TEST(OutlierCorners, AreNotFoundInNoise) {
    for (const double noise : {0.02, 0.3, 2.0})
        EXPECT_THAT(found_in(corners_of(synthetic_views(calibration_truth(), 7, noise, 11))),
                    IsEmpty())
            << noise;
}

TEST(OutlierCorners, AreFoundAndNoneBesides) {
    auto views = synthetic_views(calibration_truth(), 7, 0.2, 12);
    views[2].pixels[17] += Eigen::Vector2d(1.9, -0.8);  // ten sigmas
    views[2].pixels[18] += Eigen::Vector2d(-40, 25);    // far off, and next to it
    views[5].pixels[53] += Eigen::Vector2d(0, 9);
    EXPECT_THAT(found_in(corners_of(views)),
                ElementsAre(std::pair(2, 17), std::pair(2, 18), std::pair(5, 53)));
}

TEST(OutlierCorners, TakeTheirViewWithThemWhenTheyAreAQuarterOfIt) {
    auto views = synthetic_views(calibration_truth(), 12, 0.2, 13);
    for (std::size_t i = 0; i < 14; ++i)
        views[4].pixels[i].y() += i % 2 == 0 ? 6.0 : -6.0;
    const auto mask = corners_of(views);
    EXPECT_EQ(found_in(mask).size(), 54u);
    EXPECT_TRUE(mask[4][53]);
}

// Medians: 0.2 of the fit and 0.31 left out, so that 0.6 and 0.93 are the limits.
TEST(OutlierViews, MustBeThreeTimesAsBadInTheFitAndLeftOut) {
    const std::vector<double> fit{0.2, 0.61, 0.59, 0.61, 0.19, 0.2, 0.18};
    const std::vector<double> out{0.3, 0.94, 2.00, 0.92, 0.29, 0.3, 0.31};
    EXPECT_THAT(find_outlier_views(fit, out), ElementsAre(1u));
}

TEST(Outliers, AreNamedCountedAndLeftOut) {
    auto views = synthetic_views(calibration_truth(), 7, 0.2, 14);
    const auto clean = calibrate_camera(views, image_size, radial_fit);
    EXPECT_EQ(clean.points_left_out(), 0u);
    views[3].pixels[20] += Eigen::Vector2d(12, 5);
    const auto found = calibrate_camera(views, image_size, radial_fit);
    EXPECT_EQ(found.points(), 7u * 54u);
    EXPECT_EQ(found.points_left_out(), 1u);
    EXPECT_TRUE(found.views[3].left_out[20]);
    EXPECT_NEAR((found.views[3].residuals_px[20] - Eigen::Vector2d(12, 5)).norm(), 0.0, 1.0);
    // One point of 378 less: the camera moves by a small part of its uncertainty.
    EXPECT_NEAR(found.camera.intrinsics.fx, clean.camera.intrinsics.fx,
                0.5 * clean.deviations[0].stated);
}

TEST(Outliers, OfAWholeViewLeaveTheOthersAsTheyAre) {
    auto views = synthetic_views(calibration_truth(), 11, 0.1, 15);
    auto others = views;
    others.erase(others.begin() + 6);
    std::swap(views[6].pixels, views[2].pixels);
    views[2].pixels = others[2].pixels;  // view 6 claims to see what view 2 sees, bent
    for (std::size_t i = 0; i < 54; ++i)
        views[6].pixels[i] += 1.5 * Eigen::Vector2d(std::sin(0.9 * i), std::cos(1.7 * i));
    const CalibrationOptions options{.model = "radial", .resamples = 0};
    const auto found = calibrate_camera(views, image_size, options);
    EXPECT_FALSE(found.views[6].used());
    EXPECT_EQ(found.points_left_out(), 54u);
    const auto without = calibrate_camera(others, image_size, radial_fit);
    EXPECT_NEAR(found.camera.intrinsics.fx, without.camera.intrinsics.fx, 1e-6);
    EXPECT_NEAR(found.rms_px, without.rms_px, 1e-9);
    EXPECT_GT(found.views[6].rms_px, 1.0);
}

// Before any fit: points in a wrong order would draw it anywhere.
TEST(Outliers, AreViewsThatNoPlaneExplains) {
    const auto good = synthetic_views(calibration_truth(), 11, 0.2, 17);
    auto reversed = good, scattered = good;
    std::reverse(reversed[4].pixels.begin(), reversed[4].pixels.begin() + 27);
    RandomStream random(5, 2);
    for (Eigen::Vector2d& pixel : scattered[7].pixels)
        pixel = {640.0 * random.uniform(), 480.0 * random.uniform()};
    for (const auto& [views, bad] : {std::pair{reversed, 4}, std::pair{scattered, 7}}) {
        const auto found = calibrate_camera(views, image_size, radial_fit);
        EXPECT_FALSE(found.views[bad].used());
        EXPECT_EQ(found.points_left_out(), 54u);
        auto others = good;
        others.erase(others.begin() + bad);
        EXPECT_NEAR(found.camera.intrinsics.fx,
                    calibrate_camera(others, image_size, radial_fit).camera.intrinsics.fx, 1e-6);
    }
}

TEST(Outliers, OfMoreThanATenthAreRefused) {
    auto views = synthetic_views(calibration_truth(), 7, 0.2, 16);
    for (std::size_t i = 0; i < 54; ++i)
        views[1].pixels[i] += 8.0 * Eigen::Vector2d(std::sin(0.9 * i), std::cos(1.7 * i));
    EXPECT_THAT(
        text_of_error<NumericalError>(
            [&] { calibrate_camera(views, image_size, {.model = "radial", .resamples = 0}); }),
        AllOf(HasSubstr("54 of 378 points do not fit the others"), HasSubstr("view 1: 54 of 54")));
}

}  // namespace
}  // namespace etalon
