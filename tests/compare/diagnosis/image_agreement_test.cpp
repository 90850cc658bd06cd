// Truth: least-squares equations that are made of a known deviation and normal noise, so that
// estimate and uncertainty are known; no pixels, no renderer.
#include "compare/diagnosis/image_agreement.h"

#include "compare/diagnosis/image_coherence.h"
#include "core/statistics/random.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Focused at 900 mm with f/1.8.
CameraModel camera() {
    return camera_with(640, 480, {800.0, 800.0, 317.0, 243.0}, {}, Sensor{.pixel_pitch_um = 6.0},
                       Lens{1.8, 900.0, 550.0, {}});
}

// By how many deviations (of one photograph's noise) a unit of each deviation shows; f-number,
// focus and blur look alike at one depth and less so at others.
PixelInformation information_at(double depth_mm) {
    const double defocus = 900.0 / depth_mm - 1.0;
    Eigen::Matrix<double, deviation::count, 4> shown;
    shown << -40.0 * defocus * defocus, 1.5, 0.0, 0.0,  //
        -1e5 * defocus, 2.0, 0.0, 0.0,                  //
        300.0, 20.0, 0.0, 0.0,                          //
        0.0, 0.0, 150.0, 20.0,                          //
        0.0, 0.0, 30.0, 120.0;
    return shown * shown.transpose() + 1e-3 * PixelInformation::Identity();
}

// Of a photograph that deviates by `truth`, with the noise that its information says.
PixelDeviation noisy_score(const PixelInformation& information, const PixelDeviation& truth,
                           RandomStream& random) {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes{Eigen::MatrixXd(information)};
    PixelDeviation noise;
    for (double& each : noise)
        each = random.normal();
    return information * truth +
           PixelDeviation(modes.eigenvectors() *
                          modes.eigenvalues().cwiseSqrt().cwiseProduct(noise));
}

// Photographs at 36 depths that deviate by `truth`, with noise. 0.7 gray of 190 is the noise of a
// camera whose pixels scatter by `noise_ratio` of what its file says.
RunEvidence run_with(const PixelDeviation& truth, double noise_ratio = 1.0,
                     double background_gray = 0.0) {
    RunEvidence run;
    run.asked.fill(true);
    for (std::uint32_t i = 0; i < 36; ++i) {
        RandomStream random(11, i);
        PhotoEvidence photo;
        photo.depth_mm = 330.0 + 9.0 * i;
        photo.information = information_at(photo.depth_mm);
        photo.score = noisy_score(photo.information, truth, random);
        photo.pixels = 40;  // so few that a render's tolerance is no part of it
        photo.noise_gray = 0.7;
        photo.squares = photo.pixels * noise_ratio * noise_ratio;
        photo.noise_ratio = noise_ratio + 0.01 * random.normal();
        photo.contrast_gray = 190.0;
        photo.black_gray = 0.2 * random.normal();
        photo.background_by_tone_gray = 47.0;
        photo.background_gray = background_gray + 0.3 * random.normal() +
                                photo.background_by_tone_gray * truth[deviation::tone];
        photo.shading = {0.002 * random.normal(), 0.002 * random.normal()};
        run.photos.push_back(photo);
        run.findings.emplace_back();
    }
    return run;
}

PixelDeviation deviating(int which, double size) {
    PixelDeviation truth = PixelDeviation::Zero();
    truth[which] = size;
    return truth;
}

ImageAgreement match_of(int which, double size) {
    return match_pixels(run_with(deviating(which, size)), camera());
}

TEST(ImageAgreement, FindsNothingWhereNothingDeviates) {
    const ImageAgreement match = match_pixels(run_with(PixelDeviation::Zero()), camera());
    EXPECT_THAT(match.findings, IsEmpty());
    for (const auto& figure :
         {match.residual_gray, match.blur_px, match.tone_gray, match.shading_percent,
          match.noise_ratio, match.edge_px, match.background_gray, match.black_gray}) {
        ASSERT_TRUE(figure);
        EXPECT_FALSE(figure->is_shown()) << figure->value << " " << figure->expanded_uncertainty;
        EXPECT_GT(figure->expanded_uncertainty, 0.0);
    }
    EXPECT_EQ(match.photos, 36);
}

TEST(ImageAgreement, SaysWhereTheLensFocuses) {
    const ImageAgreement match = match_of(deviation::inverse_focus, 1.0 / 700.0 - 1.0 / 900.0);
    ASSERT_EQ(match.findings.size(), 2u);
    EXPECT_THAT(match.findings[0], HasSubstr("the photographs are sharper"));
    EXPECT_THAT(
        match.findings[1],
        testing::ContainsRegex(
            "^the lens focuses at (69|70)[0-9]\\.?[0-9]* \\+- [0-9.]+ mm, its file says 900 mm$"));
}

TEST(ImageAgreement, SaysWhichApertureTheLensHas) {
    const ImageAgreement match = match_of(deviation::f_number, std::log(2.5 / 1.8));
    ASSERT_EQ(match.findings.size(), 2u);
    EXPECT_THAT(match.findings[1], HasSubstr("the lens is at f/2."));
    EXPECT_THAT(match.findings[1], HasSubstr("its file says f/1.8"));
}

// The middle tone of 190 gray of contrast is lifted by a quarter of tone x contrast. What is beside
// the marker is lifted, too: no word about the background.
TEST(ImageAgreement, GivesToneInGrayAndEdgesInPixels) {
    const ImageAgreement tone = match_of(deviation::tone, 0.06);
    EXPECT_NEAR(tone.tone_gray->value, 0.25 * 190.0 * 0.06, tone.tone_gray->expanded_uncertainty);
    EXPECT_TRUE(tone.tone_gray->is_shown());
    EXPECT_THAT(tone.findings, ElementsAre(HasSubstr("half tones are brighter")));
    const ImageAgreement edge = match_of(deviation::print_gain, -0.07);
    EXPECT_NEAR(edge.edge_px->value, -0.07, edge.edge_px->expanded_uncertainty);
    EXPECT_THAT(edge.findings, ElementsAre(HasSubstr("dark parts are narrower")));
}

TEST(ImageAgreement, TellsNoiseAndBackgroundByTheMeanOverThePhotographs) {
    const ImageAgreement noise = match_pixels(run_with(PixelDeviation::Zero(), 1.8), camera());
    EXPECT_NEAR(noise.noise_ratio->value, 0.8, noise.noise_ratio->expanded_uncertainty);
    EXPECT_NEAR(noise.residual_gray->value, 0.7 * 0.8, 1e-9);
    EXPECT_THAT(noise.findings, ElementsAre(HasSubstr("the noise is larger")));
    const ImageAgreement beside =
        match_pixels(run_with(PixelDeviation::Zero(), 1.0, -4.0), camera());
    EXPECT_NEAR(beside.background_gray->value, -4.0, beside.background_gray->expanded_uncertainty);
    EXPECT_THAT(beside.findings, ElementsAre(HasSubstr("beside the marker is darker")));
}

// U holds k = 3 of the estimate's deviation: of 60 runs none should be outside, and values should
// fill it: their RMS is a third of U (to 9 % for 60; three of these either way).
TEST(ImageAgreement, HasAnUncertaintyThatIsTheScatter) {
    double squares = 0.0;
    constexpr int runs = 60;
    for (int i = 0; i < runs; ++i) {
        RunEvidence run = run_with(deviating(deviation::print_gain, 0.02));
        for (std::uint32_t p = 0; p < run.photos.size(); ++p) {
            RandomStream random(100 + static_cast<std::uint64_t>(i), p);
            PhotoEvidence& photo = run.photos[p];
            photo.score =
                noisy_score(photo.information, deviating(deviation::print_gain, 0.02), random);
        }
        const PixelFigure edge = *match_pixels(run, camera()).edge_px;
        squares += std::pow((edge.value - 0.02) / edge.expanded_uncertainty, 2) / runs;
    }
    EXPECT_GT(std::sqrt(squares), 0.5 / 3.0);
    EXPECT_LT(std::sqrt(squares), 1.27 / 3.0);
}

// A render may be 0.1 gray of 255 off where an edge's growth by 1 px changes 0.2 of full scale: all
// photographs may have that in common, however many there are.
TEST(ImageAgreement, IsNotSurerThanTheRendersAre) {
    RunEvidence run = run_with(PixelDeviation::Zero());
    for (PhotoEvidence& photo : run.photos) {
        photo.information *= 1e6;
        photo.score *= 1e3;
    }
    const double sure = match_pixels(run, camera()).edge_px->expanded_uncertainty;
    for (PhotoEvidence& photo : run.photos)
        photo.largest_change[deviation::print_gain] = 0.2;
    const double floor = 3.0 * 0.1 / 255.0 / 0.2;
    EXPECT_LT(sure, 0.1 * floor);
    EXPECT_NEAR(match_pixels(run, camera()).edge_px->expanded_uncertainty, std::hypot(sure, floor),
                1e-9);
}

// The noise may be 10 % off what is stated. The scores that this adds move growth by 0.1 x 0.3 px.
TEST(ImageAgreement, IsNotSurerThanTheStatedNoise) {
    RunEvidence run = run_with(PixelDeviation::Zero());
    const double sure = match_pixels(run, camera()).edge_px->expanded_uncertainty;
    for (PhotoEvidence& photo : run.photos)
        photo.score_by_log_noise = photo.information.col(deviation::print_gain) * 0.3;
    EXPECT_NEAR(match_pixels(run, camera()).edge_px->expanded_uncertainty,
                std::hypot(sure, 3.0 * 0.1 * 0.3), 1e-3);
}

TEST(ImageAgreement, CountsWhatSinglePhotographsShow) {
    RunEvidence run = run_with(PixelDeviation::Zero());
    run.findings[3] = {{"glare", "a reflection"}};
    EXPECT_THAT(match_pixels(run, camera()).findings, IsEmpty());  // 1 of 36
    run.findings[7] = run.findings[20] = run.findings[3];
    EXPECT_THAT(match_pixels(run, camera()).findings,
                ElementsAre("3 of 36 photographs: a reflection"));
    run.findings[1] = run.findings[2] = {{"saturated", "expose less"}};
    const ImageAgreement match = match_pixels(run, camera());
    EXPECT_TRUE(match.is_overexposed);
    EXPECT_FALSE(match.noise_ratio);
}

TEST(ImageAgreement, LeavesOutWhatTheCalibrationDoesNotSay) {
    CameraModel plain = camera();
    plain.lens.reset();
    RunEvidence run = run_with(PixelDeviation::Zero());
    run.asked = {false, false, false, false, true};
    for (PhotoEvidence& photo : run.photos) {
        const double growth = photo.information(deviation::print_gain, deviation::print_gain);
        photo.information.setZero();
        photo.information(deviation::print_gain, deviation::print_gain) = growth;
        photo.noise_ratio.reset();
        photo.black_gray.reset();
    }
    const ImageAgreement match = match_pixels(run, plain);
    EXPECT_FALSE(match.blur_px || match.tone_gray || match.noise_ratio || match.residual_gray ||
                 match.black_gray);
    EXPECT_TRUE(match.edge_px);
    run.photos.resize(min_compared_photos - 1);
    EXPECT_FALSE(match_pixels(run, plain).edge_px);
}

TEST(ImageAgreement, SaysNothingOfWhatNoPhotographTells) {
    RunEvidence run = run_with(PixelDeviation::Zero());
    for (PhotoEvidence& photo : run.photos) {
        photo.information.setZero();
        photo.score.setZero();
        photo.pixels = 0;
        photo.noise_gray = photo.squares = 0.0;
        photo.noise_ratio.reset();
    }
    const ImageAgreement match = match_pixels(run, camera());
    EXPECT_THAT(match.findings, IsEmpty());
    EXPECT_FALSE(match.residual_gray);
    EXPECT_EQ(match.blur_px->value, 0.0);
    EXPECT_TRUE(std::isfinite(match.blur_px->expanded_uncertainty));
    EXPECT_EQ(match.edge_px->expanded_uncertainty, 3.0);  // what is known beforehand
}

TEST(ImageAgreement, GivesEvidenceByTheNamesOfCauses) {
    const ImageAgreement match = match_of(deviation::print_gain, 0.05);
    EXPECT_THAT(match.evidence.errors,
                ElementsAre("f-number", "focus distance", "blur", "tone curve", "edge shrink",
                            "noise", "background", "black level"));
    const Eigen::Index shrink = 4;
    EXPECT_NEAR(match.evidence.observed[shrink], -match.edge_px->value, 1e-12);
    EXPECT_NEAR(3.0 * std::sqrt(match.evidence.covariance(shrink, shrink)),
                match.edge_px->expanded_uncertainty, 1e-12);
    EXPECT_EQ(match_of(deviation::tone, 0.4).evidence.errors.size(),
              5u);  // levels and noise go with the tone
}

// ---- image coherence

// Four corners of each pose over an image of 512 x 384; `left_at` beside noise of 1, and as much as
// `common` of each pose in all its corners.
template <class LeftAt>
std::vector<PoseResiduals> poses_with(std::uint64_t seed, double common, const LeftAt& left_at) {
    std::vector<PoseResiduals> poses;
    for (std::uint64_t i = 0; i < 70; ++i) {
        RandomStream random(seed, 1, i);
        PoseResiduals pose{Eigen::VectorXd(8), Eigen::VectorXd(8)};
        const double x = 450.0 * random.uniform(), y = 320.0 * random.uniform();
        const Eigen::Vector2d shift = common * Eigen::Vector2d{random.normal(), random.normal()};
        for (Eigen::Index k = 0; k < 4; ++k) {
            const Eigen::Vector2d place(x + (k % 2) * 61.0, y + (k / 2) * 57.0);
            pose.place_px.segment<2>(2 * k) = place;
            pose.left.segment<2>(2 * k) =
                shift + Eigen::Vector2d{random.normal(), random.normal()} + left_at(place);
        }
        poses.push_back(pose);
    }
    return poses;
}

Eigen::Vector2d nothing(const Eigen::Vector2d&) {
    return Eigen::Vector2d::Zero();
}

TEST(ImageCoherence, SeesWhatDependsOnThePlaceAlone) {
    const auto ripple = [](const Eigen::Vector2d& place) {
        return Eigen::Vector2d(3.0 * std::sin(place.x() / 11.0), 3.0 * std::sin(place.y() / 11.0));
    };
    const ImageCoherence found = image_coherence(poses_with(1, 0.0, ripple), 512, 384);
    EXPECT_GT(found.deviations, 1.3 * coherence_deviations);
    // 9 of 9 + 2, less by what it changes within a bin of 27 px: sinc(27 / 22)^2.
    EXPECT_NEAR(found.share, 9.0 / 11.0 * std::pow(std::sin(27.0 / 22.0) / (27.0 / 22.0), 2), 0.15);
    EXPECT_NEAR(found.bin_px, 640.0 / 24.0, 1e-9);
}

// Poses that scatter as a whole: their corners agree with each other, poses do not.
TEST(ImageCoherence, TakesNoScatterOfPosesForADistortion) {
    for (const double common : {0.0, 5.0}) {
        int found = 0;
        for (std::uint64_t seed = 1; seed <= 200; ++seed)
            found += image_coherence(poses_with(seed, common, nothing), 512, 384).deviations >
                             coherence_deviations
                         ? 1
                         : 0;
        EXPECT_LE(found, 2) << common;  // of 0.2 that 0.1 % make, 3 come in 1 test of 1000
    }
}

TEST(ImageCoherence, RefusesWhatDoesNotAgree) {
    std::vector<PoseResiduals> poses = poses_with(1, 0.0, nothing);
    poses[3].left.conservativeResize(6);
    EXPECT_THROW(image_coherence(poses, 512, 384), NumericalError);
    poses = poses_with(1, 0.0, nothing);
    poses[3].left[0] = NAN;
    EXPECT_THROW(image_coherence(poses, 512, 384), NumericalError);
}

}  // namespace
}  // namespace etalon
