// Photographs with a sensor's noise, of cameras that differ from the calibration in one thing:
// truth is the number that was changed. Where it is the lens or the tone, the reference integrator
// made them, and the renderer that is compared has no part in them; its own error (0.8 gray RMS at
// blurred edges with these samples) would be a finding where nothing is wrong.
#include "compare/match/pixel_measurement.h"

#include "tests/compare/match/photographed_run.h"
#include "tests/test.h"

namespace etalon {
namespace {

using test::PhotographedTruth;

ImageAgreement matched(const PhotographedTruth& truth,
                       RenderMethod method = RenderMethod::automatic) {
    const ImageAgreement match = test::photographed(truth, 31, method);
    for (const std::string& finding : match.findings)
        fmt::print("  {}\n", finding);
    return match;
}

double evidence(const ImageAgreement& match, const std::string& error) {
    const auto at = std::ranges::find(match.evidence.errors, error);
    return match.evidence.observed[at - match.evidence.errors.begin()];
}

double expanded(const ImageAgreement& match, const std::string& error) {
    const auto at = std::ranges::find(match.evidence.errors, error) - match.evidence.errors.begin();
    return 3.0 * std::sqrt(match.evidence.covariance(at, at));
}

TEST(PhotoEvidence, MatchWhereTheCameraIsItsCalibration) {
    const ImageAgreement match = matched({});
    EXPECT_THAT(match.findings, IsEmpty());
    EXPECT_EQ(match.photos, 14);
    EXPECT_LT(match.blur_px->expanded_uncertainty, 0.02);
    EXPECT_LT(match.edge_px->expanded_uncertainty, 0.02);
}

TEST(PhotoEvidence, TellAnApertureTwoStopsDown) {
    PhotographedTruth truth;
    truth.camera.lens->f_number = 3.2;
    const ImageAgreement match = matched(truth, RenderMethod::reference);
    ASSERT_EQ(match.findings.size(), 2u);
    EXPECT_THAT(match.findings[0], HasSubstr("sharper"));
    EXPECT_THAT(match.findings[1], StartsWith("the lens is at f/3."));
}

TEST(PhotoEvidence, TellWhereTheLensFocuses) {
    PhotographedTruth truth;
    truth.camera.lens->focus_distance_mm = 640.0;
    const ImageAgreement match = matched(truth, RenderMethod::reference);
    ASSERT_EQ(match.findings.size(), 2u);
    EXPECT_THAT(match.findings[1], StartsWith("the lens focuses at 6"));
    EXPECT_NEAR(evidence(match, "focus distance"), 1.0 / 640.0 - 1.0 / 1100.0,
                expanded(match, "focus distance"));
}

// The curve that the model has, in the camera as a table.
TEST(PhotoEvidence, TellAToneCurve) {
    constexpr double bent = 0.15;
    PhotographedTruth truth;
    truth.camera.sensor->transfer.kind = Transfer::Kind::table;
    for (int i = 0; i <= 200; ++i) {
        const double s = i / 200.0;
        truth.camera.sensor->transfer.table.emplace_back(s, s * (1.0 + bent * (1.0 - s)));
    }
    // Between black and white at 0.8 of full scale the same curve is a flatter one:
    // (s + t s (1 - s)) / (1 + t (1 - 0.8)) with s = 0.8 u is u + t' u (1 - u).
    const double flatter = 0.8 * bent / (1.0 + 0.2 * bent);
    const ImageAgreement match = matched(truth, RenderMethod::reference);
    EXPECT_NEAR(evidence(match, "tone curve"), flatter, expanded(match, "tone curve"));
    EXPECT_TRUE(match.tone_gray->is_shown());
    EXPECT_THAT(match.findings, Contains(HasSubstr("half tones are brighter")));
}

// A power of 0.8: t = 0.5, and leaning besides, which looks like another lens.
TEST(PhotoEvidence, TakeNoToneCurveForALens) {
    PhotographedTruth truth;
    Transfer& curve = truth.camera.sensor->transfer;
    curve.kind = Transfer::Kind::table;
    for (int i = 0; i <= 400; ++i)
        curve.table.emplace_back(i / 400.0, std::pow(i / 400.0, 0.8));
    const ImageAgreement match = matched(truth);
    EXPECT_TRUE(match.tone_gray->is_shown());
    for (const char* error : {"f-number", "focus distance", "blur"})
        EXPECT_LT(std::abs(evidence(match, error)), expanded(match, error)) << error;
    EXPECT_LT(expanded(match, "blur"), 0.3);
}

TEST(PhotoEvidence, TellNoiseBackgroundAndBlack) {
    PhotographedTruth truth;
    truth.camera.sensor->gain_e_per_dn = 10.0;
    truth.camera.sensor->read_noise_e = 2.0;
    const ImageAgreement noise = matched(truth);
    EXPECT_THAT(noise.findings, ElementsAre(HasSubstr("the noise is larger")));
    EXPECT_GT(noise.noise_ratio->value, 0.8);  // twice the shot noise, and rounding
    EXPECT_LT(noise.noise_ratio->value, 1.0);

    truth = {};
    truth.camera.sensor->black_dn = 15.0;
    const ImageAgreement black = matched(truth);
    EXPECT_NEAR(black.black_gray->value, 6.0, black.black_gray->expanded_uncertainty);
    EXPECT_THAT(black.findings, ElementsAre(HasSubstr("black is brighter")));

    const ImageAgreement beside = matched({.background = test::stated_background + 0.1});
    EXPECT_NEAR(beside.background_gray->value, 0.1 * 0.8 * (255.0 - 9.0),
                beside.background_gray->expanded_uncertainty + 0.3);
    EXPECT_THAT(beside.findings, ElementsAre(HasSubstr("is brighter than the")));
}

}  // namespace
}  // namespace etalon
