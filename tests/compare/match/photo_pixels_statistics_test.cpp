// Photographs with a sensor's noise, of cameras that differ from the calibration in one thing:
// truth is the number that was changed. Where it is the lens or the tone, the reference integrator
// made them, and the renderer that is compared has no part in them; its own error (0.8 gray RMS at
// blurred edges with these samples) would be a finding where nothing is wrong.
#include "compare/match/photo_pixels.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "compare/verdict/pixel_match.h"
#include "sim/render/renderer.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

constexpr double stated_background = 0.55;

CameraModel calibration() {
    CameraModel camera;
    camera.width = 320;
    camera.height = 240;
    camera.intrinsics = {430.0, 432.0, 157.2, 121.7};
    camera.distortion.k1 = -0.11;
    camera.sensor.emplace();
    camera.sensor->pixel_pitch_um = 5.0;
    camera.sensor->black_dn = 9.0;
    camera.sensor->gain_e_per_dn = 40.0;
    camera.sensor->read_noise_e = 8.0;
    camera.lens.emplace();
    camera.lens->f_number = 1.6;
    camera.lens->focus_distance_mm = 1100.0;
    camera.lens->wavelength_nm = 550.0;
    return camera;
}

const Marker& tag() {
    static const Marker marker = parse_marker("apriltag:36h11:7@60mm", "test");
    return marker;
}

// 14 depths from 250 to 510 mm, tilted and turned.
Rigid pose_at(std::size_t i) {
    const double angle = 2.4 * static_cast<double>(i);
    const Eigen::Quaterniond turned =
        rotation_from_vector({0.35 * std::cos(angle), 0.35 * std::sin(angle), 0.0}) *
        rotation_from_vector({0.0, 0.0, 0.7 * static_cast<double>(i)});
    const Eigen::Vector3d middle{9.0 * std::sin(angle), 7.0 * std::cos(angle),
                                 250.0 + 20.0 * static_cast<double>(i)};
    const CellGrid& grid = tag().grid;
    return {turned, middle - turned * grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows())};
}

constexpr std::size_t photos = 14;

PixelMatch matched(const CameraModel& truth, double background,
                   RenderMethod method = RenderMethod::automatic) {
    constexpr double white_level = 0.8;
    const CameraModel camera = calibration();
    const PhotometricDetector detector(camera, tag(), "test", stated_background);
    const Renderer renderer(truth);
    const SensorModel sensor(truth);
    std::vector<PhotoOfMarker> seen;
    for (std::size_t i = 0; i < photos; ++i) {
        CellGrid grid = tag().grid;
        grid.cells = cv::Mat(grid.cells * white_level);
        const RenderedImage image =
            renderer.render({{{grid, pose_at(i)}}, background * white_level},
                            {.method = method, .tolerance_gray = 0.05});
        const CodeImage photo =
            sensor.expose(image.radiance, NoiseKey{31, static_cast<std::uint32_t>(i)});
        seen.push_back(detector.photo_at(gray_of(photo), pose_at(i)));
    }
    const ComparedArea whole = compared_area(tag(), {}, "test");
    const auto measure = [&](const PixelDeviation& deviating, std::span<const std::size_t> which,
                             std::optional<double> noise_scale) {
        const DeviatingCamera there(camera, deviating);
        std::vector<PhotoPixels> all;
        for (const std::size_t i : which)
            all.push_back(there.measure(seen[i], pose_at(i), whole, noise_scale));
        return all;
    };
    std::vector<std::size_t> every(photos);
    std::iota(every.begin(), every.end(), std::size_t{0});
    RunPixels pixels =
        settled_pixels(camera, measure(PixelDeviation::Zero(), every, std::nullopt), measure);
    pixels.findings.resize(photos);
    const PixelMatch match = match_pixels(pixels, camera);
    for (const std::string& finding : match.findings)
        fmt::print("  {}\n", finding);
    return match;
}

double evidence(const PixelMatch& match, const std::string& error) {
    const auto at = std::ranges::find(match.evidence.errors, error);
    return match.evidence.observed[at - match.evidence.errors.begin()];
}

double expanded(const PixelMatch& match, const std::string& error) {
    const auto at = std::ranges::find(match.evidence.errors, error) - match.evidence.errors.begin();
    return 3.0 * std::sqrt(match.evidence.covariance(at, at));
}

TEST(PhotoPixels, MatchWhereTheCameraIsItsCalibration) {
    const PixelMatch match = matched(calibration(), stated_background);
    EXPECT_THAT(match.findings, testing::IsEmpty());
    EXPECT_EQ(match.photos, static_cast<int>(photos));
    EXPECT_LT(match.blur_px->expanded_uncertainty, 0.02);
    EXPECT_LT(match.edge_px->expanded_uncertainty, 0.02);
}

TEST(PhotoPixels, TellAnApertureTwoStopsDown) {
    CameraModel truth = calibration();
    truth.lens->f_number = 3.2;
    const PixelMatch match = matched(truth, stated_background, RenderMethod::reference);
    ASSERT_EQ(match.findings.size(), 2u);
    EXPECT_THAT(match.findings[0], testing::HasSubstr("sharper"));
    EXPECT_THAT(match.findings[1], testing::StartsWith("the lens is at f/3."));
}

TEST(PhotoPixels, TellWhereTheLensFocuses) {
    CameraModel truth = calibration();
    truth.lens->focus_distance_mm = 640.0;
    const PixelMatch match = matched(truth, stated_background, RenderMethod::reference);
    ASSERT_EQ(match.findings.size(), 2u);
    EXPECT_THAT(match.findings[1], testing::StartsWith("the lens focuses at 6"));
    EXPECT_NEAR(evidence(match, "focus distance"), 1.0 / 640.0 - 1.0 / 1100.0,
                expanded(match, "focus distance"));
}

// The curve that the model has, in the camera as a table.
TEST(PhotoPixels, TellAToneCurve) {
    constexpr double bent = 0.15;
    CameraModel truth = calibration();
    truth.sensor->transfer.kind = Transfer::Kind::table;
    for (int i = 0; i <= 200; ++i) {
        const double s = i / 200.0;
        truth.sensor->transfer.table.emplace_back(s, s * (1.0 + bent * (1.0 - s)));
    }
    // Between black and white at 0.8 of full scale the same curve is a flatter one:
    // (s + t s (1 - s)) / (1 + t (1 - 0.8)) with s = 0.8 u is u + t' u (1 - u).
    const double flatter = 0.8 * bent / (1.0 + 0.2 * bent);
    const PixelMatch match = matched(truth, stated_background, RenderMethod::reference);
    EXPECT_NEAR(evidence(match, "tone curve"), flatter, expanded(match, "tone curve"));
    EXPECT_TRUE(match.tone_gray->is_shown());
    EXPECT_THAT(match.findings, testing::Contains(testing::HasSubstr("half tones are brighter")));
}

TEST(PhotoPixels, TellNoiseBackgroundAndBlack) {
    CameraModel truth = calibration();
    truth.sensor->gain_e_per_dn = 10.0;
    truth.sensor->read_noise_e = 2.0;
    const PixelMatch noise = matched(truth, stated_background);
    EXPECT_THAT(noise.findings, testing::ElementsAre(testing::HasSubstr("the noise is larger")));
    EXPECT_GT(noise.noise_ratio->value, 0.8);  // twice the shot noise, and rounding
    EXPECT_LT(noise.noise_ratio->value, 1.0);

    truth = calibration();
    truth.sensor->black_dn = 15.0;
    const PixelMatch black = matched(truth, stated_background);
    EXPECT_NEAR(black.black_gray->value, 6.0, black.black_gray->expanded_uncertainty);
    EXPECT_THAT(black.findings, testing::ElementsAre(testing::HasSubstr("black is brighter")));

    const PixelMatch beside = matched(calibration(), stated_background + 0.1);
    EXPECT_NEAR(beside.background_gray->value, 0.1 * 0.8 * (255.0 - 9.0),
                beside.background_gray->expanded_uncertainty + 0.3);
    EXPECT_THAT(beside.findings, testing::ElementsAre(testing::HasSubstr("is brighter than the")));
}

}  // namespace
}  // namespace etalon
