// What measures black level, noise, tone and shading refuses, and what it says then; values with
// known answers. How often the truth is within U: levels_statistics_test.cpp.

#include <opencv2/imgproc.hpp>

#include "compare/characterise/code_statistics.h"
#include "compare/characterise/illumination_estimate.h"
#include "compare/characterise/photon_transfer.h"
#include "sim/render/renderer.h"
#include "tests/compare/characterise/level_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

template <class Action>
std::string refusal(Action action) {
    return text_of_error<NumericalError>(action);
}

CodeImage codes(int rows, int columns, std::initializer_list<int> values) {
    CodeImage image{cv::Mat(rows, columns, CV_8UC1), 8};
    std::copy(values.begin(), values.end(), image.pixels.begin<std::uint8_t>());
    return image;
}

TEST(CodeStatistics, RoundingIsUniformWithoutNoiseAndGoneWithMuch) {
    // Without noise the error is uniform over a code: 1/sqrt(12). Its harmonics fall as
    // exp(-2 pi^2 sigma^2): at 0.5 DN the first alone counts, 0.00718 / pi / sqrt 2.
    EXPECT_NEAR(rounding_uncertainty_of_mean(0.0), 1.0 / std::sqrt(12.0), 1e-3);
    EXPECT_NEAR(rounding_uncertainty_of_mean(0.5), 0.00719 / M_PI / std::sqrt(2.0), 1e-5);
    EXPECT_LT(rounding_uncertainty_of_mean(1.0), 1e-8);
    EXPECT_LT(rounding_uncertainty_of_variance(1.2), 1e-9);
}

// A second method: rounding many normal deviates about many fractions of a code.
TEST(CodeStatistics, RoundingAgreesWithRoundedDeviates) {
    const double sigma = 0.35;
    double square_of_mean = 0.0;
    constexpr int fractions = 64, deviates = 4000;
    for (int f = 0; f < fractions; ++f) {
        double sum = 0.0;
        RandomStream random(5, 0, static_cast<std::uint64_t>(f));
        for (int i = 0; i < deviates; ++i)
            sum +=
                std::round(f / double(fractions) + sigma * random.normal()) - f / double(fractions);
        square_of_mean += std::pow(sum / deviates, 2) / fractions;
    }
    // The deviates' own scatter is (0.35^2 + 1/12)/4000; what remains is known to
    // 2/sqrt(2 * 64) of itself plus that.
    const double own = (sigma * sigma + 1.0 / 12.0) / deviates;
    EXPECT_NEAR(std::sqrt(square_of_mean - own), rounding_uncertainty_of_mean(sigma), 0.004);
}

TEST(CodeStatistics, FindsWhereAScaleEnds) {
    cv::Mat ramp(50, 200, CV_8UC1);
    for (int x = 0; x < ramp.cols; ++x)
        ramp.col(x) = std::min(30 + x, 190);
    const CodeImage limited{ramp, 8};
    EXPECT_EQ(saturation_code({&limited, 1}), 190);
    const CodeImage free{ramp.colRange(0, 150).clone(), 8};
    EXPECT_EQ(saturation_code({&free, 1}), 255);
    EXPECT_DOUBLE_EQ(share_at_saturation(limited, 190), 40.0 / 200.0);
}

TEST(BlackLevel, OfCodesByHand) {
    // Means 7 and 8 of 4 pixels; each pixel rises by 1: temporal variance 1/2. The drift of 1 DN is
    // over half of the noise.
    const std::vector<CodeImage> drifting{codes(2, 2, {5, 6, 8, 9}), codes(2, 2, {6, 7, 9, 10})};
    EXPECT_THAT(refusal([&] { measure_black_level(drifting); }), HasSubstr("drift by 1 DN"));
    const std::vector<CodeImage> steady{codes(2, 2, {5, 6, 8, 9}), codes(2, 2, {6, 5, 9, 8})};
    const BlackLevel black = measure_black_level(steady);
    EXPECT_DOUBLE_EQ(black.dn, 7.0);
    EXPECT_DOUBLE_EQ(black.temporal_variance_dn2, 0.5);
    EXPECT_DOUBLE_EQ(black.drift_dn, 0.0);
    // Pixels' means 5.5, 5.5, 8.5, 8.5: variance 2.25, less half of the temporal one.
    EXPECT_DOUBLE_EQ(black.fixed_pattern_dn, std::sqrt(2.25 - 0.25));
}

TEST(BlackLevel, RefusesWhatIsNoDarkPhoto) {
    EXPECT_THAT(refusal([] { measure_black_level({}); }), HasSubstr("no dark photos"));
    CameraModel camera = noisy_camera();
    EXPECT_THAT(refusal([&] { measure_black_level(exposed(camera, squares(camera, 0.5), 2, 1)); }),
                HasSubstr("is the lens covered?"));
    camera.sensor->black_dn = 1.0;
    EXPECT_THAT(refusal([&] { measure_black_level(exposed(camera, even(camera, 0.0), 2, 1)); }),
                HasSubstr("at code 0"));
    std::vector<CodeImage> sizes{codes(2, 2, {5, 6, 8, 9}), codes(1, 4, {5, 6, 8, 9})};
    EXPECT_THAT(refusal([&] { measure_black_level(sizes); }), HasSubstr("image 2 has 4 x 1 px"));
}

std::string photon_refusal(const RepeatedView& view, const CameraModel& camera = noisy_camera()) {
    return refusal(
        [&] { measure_photon_transfer(std::vector<RepeatedView>{view}, camera, std::nullopt); });
}

TEST(PhotonTransfer, NeedsDarkPhotosForTheReadNoiseOnly) {
    const CameraModel camera = noisy_camera();
    const std::vector<RepeatedView> views{exposed(camera, squares(camera, 0.85), 4, 7)};
    const PhotonTransfer photon = measure_photon_transfer(views, camera, std::nullopt);
    EXPECT_FALSE(photon.read_noise_e);
    EXPECT_THAT(photon.read_noise_remark, HasSubstr("no dark photos"));
    EXPECT_NEAR(photon.gain_e_per_dn, 12.0, 4.0 * photon.gain_standard_uncertainty);
    EXPECT_LT(photon.shift_px, 0.01);
}

TEST(PhotonTransfer, TakesOutASmallChangeOfTheLight) {
    const CameraModel camera = noisy_camera();
    const Radiance scene = squares(camera, 0.8);
    RepeatedView view = exposed(camera, scene, 2, 3);
    const RepeatedView brighter = exposed(camera, scene * 1.01, 2, 3, 10);
    view.insert(view.end(), brighter.begin(), brighter.end());
    const PhotonTransfer photon =
        measure_photon_transfer(std::vector<RepeatedView>{view}, camera, std::nullopt);
    // 1 % of 200 DN is 2 DN beside 4 DN of noise: untreated the gain would be a tenth too low.
    EXPECT_NEAR(photon.brightness_drift, 0.01, 0.001);
    EXPECT_NEAR(photon.gain_e_per_dn, 12.0, 4.0 * photon.gain_standard_uncertainty);
}

TEST(PhotonTransfer, RefusesWhatAreNoRepeats) {
    const CameraModel camera = noisy_camera();
    const Radiance scene = squares(camera, 0.8);
    RepeatedView view = exposed(camera, scene, 2, 3);
    EXPECT_THAT(photon_refusal({view[0]}), HasSubstr("two photos at least"));
    const auto with = [&](const Radiance& other) {
        return photon_refusal({view[0], exposed(camera, other, 1, 3, 9).front()});
    };
    EXPECT_THAT(with(scene * 1.05), HasSubstr("brightness drifts by"));
    cv::Mat moved;
    const cv::Mat to_the_right = (cv::Mat_<double>(2, 3) << 1, 0, 40, 0, 1, 0);
    cv::warpAffine(scene, moved, to_the_right, scene.size(), cv::INTER_LINEAR,
                   cv::BORDER_REPLICATE);
    EXPECT_THAT(with(moved), HasSubstr("repeats: "));
    Radiance with_a_hand = scene.clone();
    with_a_hand(cv::Rect(100, 50, 40, 30)) *= 0.6;
    EXPECT_THAT(with(with_a_hand), HasSubstr("changed by more than noise"));
    RepeatedView smoothed = view;
    for (CodeImage& image : smoothed)
        cv::GaussianBlur(image.pixels, image.pixels, {3, 3}, 0.6);
    EXPECT_THAT(photon_refusal(smoothed), HasSubstr("correlated"));
}

TEST(PhotonTransfer, RefusesACurveThatTheCameraFileDoesNotHave) {
    CameraModel camera = noisy_camera();
    camera.sensor->read_noise_e = 6.0;
    camera.sensor->transfer.kind = Transfer::Kind::rec709;
    const RepeatedView view = exposed(camera, squares(camera, 0.8), 4, 3);
    EXPECT_THAT(photon_refusal(view, noisy_camera()), HasSubstr("photon transfer: "));
}

TEST(TransferEstimate, RefusesWhatIsNoExposureSeries) {
    const CameraModel camera = noisy_camera();
    const Radiance scene = squares(camera, 0.8);
    const auto error = [&](const Radiance& picture, const std::vector<double>& times) {
        return refusal([&] {
            estimate_transfer(exposure_series(camera, picture, times), *camera.sensor, 0.0);
        });
    };
    EXPECT_THAT(error(scene, {100, 400, 1000}), HasSubstr("3 different times"));
    EXPECT_THAT(error(scene, {500, 600, 800, 1000}), HasSubstr("over a factor of 2"));
    EXPECT_THAT(error(scene * 0.3, {100, 300, 600, 1000}), HasSubstr("% of full scale"));
    const Radiance texture = scene.mul(image_of(
        scene.size(), [](int x, int y) { return (x / 4 + y / 4) % 2 == 0 ? 0.6f : 1.0f; }));
    EXPECT_THAT(error(texture, {100, 300, 600, 1000}), HasSubstr("0 uniform parts"));
    std::vector<ExposedPhoto> drifting =
        exposure_series(camera, scene, {100, 300, 600, 1000, 1000});
    drifting.back().image = exposed(camera, scene * 1.03, 1, 5, 77).front();
    EXPECT_THAT(refusal([&] { estimate_transfer(drifting, *camera.sensor, 0.0); }),
                HasSubstr("the light is not steady"));
    std::vector<ExposedPhoto> automatic =
        exposure_series(camera, scene, {700, 700, 700, 700, 1000});
    for (std::size_t i = 0; i < automatic.size(); ++i)
        automatic[i].exposure_us = 100.0 * std::pow(2.0, static_cast<double>(i));
    EXPECT_NE(refusal([&] { estimate_transfer(automatic, *camera.sensor, 0.0); }), "no error");
}

TEST(TransferEstimate, FindsWhereTheCameraLimitsItsScale) {
    const CameraModel camera = noisy_camera();
    std::vector<ExposedPhoto> photos =
        exposure_series(camera, squares(camera, 1.0), {60, 120, 250, 500, 700, 850, 1200});
    for (ExposedPhoto& photo : photos)
        cv::min(photo.image.pixels, 235, photo.image.pixels);
    const TransferEstimate estimate = estimate_transfer(photos, *camera.sensor, 0.0);
    EXPECT_EQ(estimate.saturation_code, 235);
    EXPECT_LE(estimate.highest_code, (235 - 9.3) / (255 - 9.3));
}

TEST(IlluminationEstimate, RefusesWhatIsNoFlatField) {
    const CameraModel camera = noisy_camera();
    const auto error = [&](const Radiance& radiance) {
        return refusal(
            [&] { flat_patches(exposed(camera, radiance, 1, 3).front(), camera, 0, "flat.png"); });
    };
    EXPECT_EQ(error(even(camera, 0.7)), "no error");
    EXPECT_THAT(error(even(camera, 1.0)), HasSubstr("flat.png: 5"));  // half are at full scale
    EXPECT_THAT(error(even(camera, 1.0)), HasSubstr("are saturated"));
    Radiance lamp = even(camera, 0.02);
    lamp.colRange(0, 160) = 0.8f;
    EXPECT_THAT(error(lamp), HasSubstr("no photo of a uniform field"));
    std::vector<WhitePatch> middle;
    for (const WhitePatch& patch :
         flat_patches(exposed(camera, even(camera, 0.7), 1, 3).front(), camera, 0, "flat.png"))
        if ((patch.centre_px - Eigen::Vector2d(160, 120)).norm() < 80.0)
            middle.push_back(patch);
    EXPECT_THAT(refusal([&] { estimate_illumination(middle, camera); }),
                HasSubstr("of the way to the image's corners"));
    EXPECT_THAT(refusal([&] { estimate_illumination({}, camera); }),
                HasSubstr("0 even white parts"));
}

// A board that covers the image, in five places, under light that comes from another side each
// time.
std::vector<WhitePatch> white_squares(const CameraModel& camera) {
    const Marker board = parse_marker("chessboard:9x7@10mm", "test");
    const Renderer renderer(camera);
    const SensorModel sensor(camera);
    const Projector projector(camera);
    std::vector<WhitePatch> patches;
    for (int i = 0; i < 5; ++i) {
        PlacedMarker placed{board.grid, rigid_from_vector({0.02 * i, -0.03, 0.01, -43.0 + 3 * i,
                                                           -33.0 + 2 * i, 122.0})};
        placed.grid.cells = cv::Mat(0.1 + 0.6 * board.grid.cells);  // a picture of its own
        Radiance radiance = renderer.render({{placed}, 0.3}).radiance;
        for (int x = 0; x < radiance.cols; ++x)
            radiance.col(x) *= 1.0 + 0.05 * (i - 2) * x / radiance.cols;
        const CodeImage photo = sensor.expose(radiance, NoiseKey{3, static_cast<std::uint32_t>(i)});
        const auto more =
            white_cell_patches(photo, projector, board.grid, placed.camera_from_marker, i);
        patches.insert(patches.end(), more.begin(), more.end());
    }
    return patches;
}

TEST(IlluminationEstimate, OfATargetsWhiteSquares) {
    CameraModel camera = noisy_camera();
    camera.sensor->illumination = {Illumination::Kind::polynomial, {-0.3, 0.05, -0.05}};
    const std::vector<WhitePatch> patches = white_squares(camera);
    // Inner white squares: half of 8 x 6, those that lie in the image, in five photographs.
    EXPECT_GT(patches.size(), 80u);
    EXPECT_LE(patches.size(), 5u * 40u);
    const IlluminationEstimate estimate = estimate_illumination(patches, camera);
    EXPECT_EQ(estimate.photos, 5);
    const double corner = illumination_radius_squared(camera, {-0.5, 239.5});
    const double truth = polynomial_illumination(camera.sensor->illumination.polynomial, corner);
    // One value, 3.5 standard uncertainties: wrong once in 2000.
    EXPECT_NEAR(estimate.at_corner, truth, 3.5 * estimate.at_corner_standard_uncertainty);
    EXPECT_LT(estimate.at_corner_standard_uncertainty, 0.02);
    EXPECT_LT(estimate.reduced_chi_square, 2.0);
}

}  // namespace
}  // namespace etalon
