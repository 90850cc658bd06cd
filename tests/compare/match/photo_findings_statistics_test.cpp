// Photographs with a fault each, of a tag and of a chessboard, at two poses and with two noise
// seeds: none is a match, and the finding has the right name. Photographs without a fault are
// matches. The smallest faults that are found: tests/evidence/match_outcome_limits.cpp,
// docs/match-outcome.md.
#include "compare/match/photo_findings.h"

#include "tests/compare/match/adversarial_photos.h"
#include "tests/compare/match/photographed_run.h"
#include "tests/test.h"

namespace etalon {
namespace {

std::shared_ptr<const PhotometricCamera> calibrated() {
    static const auto camera = std::make_shared<const PhotometricCamera>(calibrated_camera());
    return camera;
}

std::string names(const Findings& findings) {
    std::string list;
    for (const Finding& finding : findings)
        list += finding.name + " ";
    return list;
}

using Photographer = std::function<CodeImage(const TrueScene&, int seed)>;

CodeImage plain(const TrueScene& scene, int seed) {
    return exposed(radiance_of(scene), seed);
}

// Eight gray more than the camera has.
CodeImage with_noise(const TrueScene& scene, int seed) {
    CodeImage photo = plain(scene, seed);
    RandomStream random(5, 2);
    cv::add(photo.pixels, normal_noise(photo.pixels.size(), 8.0, random), photo.pixels,
            cv::noArray(), CV_8U);
    return photo;
}

Photographer before_the_sensor(std::function<Radiance(const TrueScene&)> radiance) {
    return [=](const TrueScene& scene, int seed) { return exposed(radiance(scene), seed); };
}

Photographer with_radiance(std::function<Radiance(const Radiance&)> change) {
    return before_the_sensor([=](const TrueScene& scene) { return change(radiance_of(scene)); });
}

Photographer behind_the_sensor(std::function<CodeImage(const CodeImage&)> change) {
    return [=](const TrueScene& scene, int seed) { return change(plain(scene, seed)); };
}

Photographer compressed(int quality) {
    return behind_the_sensor(
        [=](const CodeImage& photo) { return test::compressed(photo, quality); });
}

struct Harmless {
    std::string name;
    Photographer photo;
};

const std::vector<Harmless> harmless{
    {"APhotographWithoutFault", plain},
    {"UnevenLight",
     before_the_sensor([](const TrueScene& scene) { return unevenly_lit(scene, 0.5); })},
    {"Noise", with_noise},
    {"JpegAtQuality50", compressed(50)},
};

// At the pose that corners with errors by the seed give.
Findings found_in(const CodeImage& photo, const TrueScene& scene, int seed,
                  const std::shared_ptr<const PhotometricCamera>& camera = calibrated()) {
    return examined(photo, scene, found_pose(scene, camera->model(), seed), camera);
}

class MatchOf : public testing::TestWithParam<Harmless> {};

TEST_P(MatchOf, IsAMatch) {
    for (const auto scenes : {tag_scene, board_scene})
        for (int pose = 0; pose < 2; ++pose) {
            const TrueScene scene = scenes(pose);
            const Findings findings = found_in(GetParam().photo(scene, 3), scene, 3);
            EXPECT_TRUE(is_matched(findings)) << names(findings);
        }
}

INSTANTIATE_TEST_SUITE_P(MatchOutcome, MatchOf, testing::ValuesIn(harmless),
                         [](const auto& one) { return one.param.name; });

// The truth from brute-force sampling: no renderer of ours made this photograph.
TEST(MatchOutcome, OfAPhotographByTheReferenceIntegratorIsAMatch) {
    const TrueScene scene = tag_scene(0);
    const Findings findings = found_in(exposed(reference_radiance_of(scene), 4), scene, 4);
    EXPECT_TRUE(is_matched(findings)) << names(findings);
}

// A camera whose file knows lens and noise: the blur is not fitted, and a larger one is a finding.
TEST(MatchOutcome, NamesABlurThatIsNotTheCamerasOwn) {
    const auto camera = std::make_shared<const PhotometricCamera>(true_camera());
    for (const bool board : {false, true}) {
        const TrueScene scene = board ? board_scene(0) : tag_scene(0);
        Radiance radiance = radiance_of(scene);
        Findings findings = found_in(exposed(radiance, 5), scene, 5, camera);
        EXPECT_TRUE(is_matched(findings)) << names(findings);
        cv::GaussianBlur(radiance, radiance, {0, 0}, 0.8);
        findings = found_in(exposed(radiance, 5), scene, 5, camera);
        ASSERT_FALSE(is_matched(findings));
        EXPECT_EQ(findings.front().name, "blur_differs") << names(findings);
        EXPECT_GT(findings.front().value, 0.0);
    }
}

using Scenes = std::vector<TrueScene (*)(int pose)>;

const Scenes tags{tag_scene}, boards{board_scene}, wide_board{wide_board_scene},
    both{tag_scene, board_scene};

struct Fault {
    std::string name;
    std::set<std::string> findings;  // every photograph has one of them
    Scenes scenes;
    Photographer photo;
    CameraModel camera = calibrated_camera();  // what the calibration says
};

// Photographs of what else hangs there: another marker, or the marker's own cells changed.
Photographer of_another(const std::string& spec) {
    return [=](TrueScene scene, int seed) {
        scene.shown = parse_marker(spec, "test").grid;
        return plain(scene, seed);
    };
}

Photographer with_cells(std::function<void(const cv::Mat& cells, cv::Mat& shown)> change) {
    return [=](TrueScene scene, int seed) {
        change(scene.marker.grid.cells, scene.shown.cells);
        return plain(scene, seed);
    };
}

Photographer turned(int code) {
    return with_cells(
        [=](const cv::Mat& cells, cv::Mat& shown) { cv::rotate(cells, shown, code); });
}

Photographer covered(double reflectance) {
    return before_the_sensor(
        [=](const TrueScene& scene) { return occluded(scene, 1.5 * cell_px(scene), reflectance); });
}

Photographer sharpened(double amount) {
    return behind_the_sensor(
        [=](const CodeImage& photo) { return test::sharpened(photo, amount, 1.2); });
}

CameraModel with_other_distortion() {
    CameraModel wrong = calibrated_camera();
    wrong.distortion.k1 += 0.05;
    return wrong;
}

CameraModel with_another_focal_length() {
    CameraModel wrong = calibrated_camera();
    wrong.intrinsics.zoom(1.05);
    return wrong;
}

const std::vector<Fault> faults{
    {"BlackCover", {"occluded"}, both, covered(0.1)},
    {"GrayCover", {"occluded"}, both, covered(0.4)},
    {"WhiteCover", {"occluded"}, both, covered(0.8)},
    {"Glare", {"glare"}, both, before_the_sensor([](const TrueScene& scene) {
         return with_glare(scene, 0.8 * cell_px(scene), 3.0);
     })},
    {"MotionBlur",
     {"motion_blur"},
     both,
     [](const TrueScene& scene, int seed) { return exposed(moved(scene, 5.0), seed); }},
    {"RowsReadWhileTheMarkerMoves", {"skewed"}, both, before_the_sensor([](const TrueScene& scene) {
         return rolled(scene, 3.0);
     })},
    {"AnotherId", {"wrong_marker"}, tags, of_another("apriltag:36h11:17@50mm")},
    {"AnotherFamily",
     {"wrong_marker", "marker_not_there"},
     tags,
     of_another("aruco:6X6_50:3@50mm")},
    {"AnotherBoard", {"marker_not_there"}, boards, of_another("chessboard:12x9@18mm")},
    {"UpsideDown", {"upside_down"}, tags, turned(cv::ROTATE_180)},
    // Half a turn of a board with an odd number of corners each way more than even exchanges light
    // and dark, and so does its negative: one group.
    {"BoardUpsideDown", {"negative"}, boards, turned(cv::ROTATE_180)},
    {"Turned", {"turned"}, tags, turned(cv::ROTATE_90_CLOCKWISE)},
    {"Mirrored", {"mirrored"}, tags, with_cells([](const cv::Mat& cells, cv::Mat& shown) {
         cv::flip(cells, shown, 1);
     })},
    {"Negative", {"negative"}, both, behind_the_sensor(negative)},
    {"LittleSharpening", {"sharpened"}, both, sharpened(0.5)},
    {"Sharpening", {"sharpened"}, both, sharpened(1.0)},
    {"MuchSharpening", {"sharpened"}, both, sharpened(2.0)},
    {"OtherDistortion", {"calibration_mismatch"}, wide_board, plain, with_other_distortion()},
    {"AnotherFocalLength", {"calibration_mismatch"}, boards, plain, with_another_focal_length()},
    {"Saturation", {"saturated"}, both, with_radiance([](const Radiance& radiance) -> Radiance {
         return 2.0 * radiance;
     })},
    {"LowContrast", {"low_contrast"}, both, with_radiance([](const Radiance& radiance) -> Radiance {
         return 0.3 + 0.08 * radiance;
     })},
    {"NoMarker",
     {"marker_not_there"},
     both,
     before_the_sensor(
         [](const TrueScene& scene) -> Radiance { return 0.5 + 0.0 * radiance_of(scene); })},
    {"OutOfFocus", {"out_of_focus"}, both, before_the_sensor([](const TrueScene& scene) {
         Radiance blurred;
         cv::GaussianBlur(radiance_of(scene), blurred, {0, 0}, 5.0);
         return blurred;
     })},
    {"StrongCompression", {"compressed"}, both, compressed(10)},
};

class FaultOf : public testing::TestWithParam<Fault> {};

// Two poses and two seeds of each target.
TEST_P(FaultOf, IsNamed) {
    const auto camera = std::make_shared<const PhotometricCamera>(GetParam().camera);
    for (const auto scenes : GetParam().scenes)
        for (const int pose : {0, 1})
            for (const int seed : {1, 2}) {
                const TrueScene scene = scenes(pose);
                const Findings findings =
                    found_in(GetParam().photo(scene, seed), scene, seed, camera);
                EXPECT_TRUE(std::ranges::any_of(findings,
                                                [](const Finding& finding) {
                                                    return GetParam().findings.contains(
                                                        finding.name);
                                                }))
                    << scene.marker.spec << " at pose " << pose << ": " << names(findings);
                for (const Finding& finding : findings)
                    EXPECT_TRUE(std::isfinite(finding.value) && !finding.sentence.empty());
            }
}

INSTANTIATE_TEST_SUITE_P(MatchOutcome, FaultOf, testing::ValuesIn(faults),
                         [](const auto& fault) { return fault.param.name; });

TEST(MatchOutcome, NamesAMarkerThatReachesOutOfTheImage) {
    for (const bool board : {false, true}) {
        TrueScene scene = board ? board_scene(0) : tag_scene(0);
        scene.camera_from_marker.translation.x() += board ? 90.0 : 50.0;
        const Findings findings =
            examined(exposed(radiance_of(scene), 1), scene, scene.camera_from_marker, calibrated());
        ASSERT_FALSE(is_matched(findings));
        EXPECT_EQ(findings.front().name, "not_in_image") << names(findings);
    }
}

// 200 photographs without a fault, each at a pose of its own. At the stated rate of 1 % two of them
// would have a finding; with these seeds none has.
TEST(MatchOutcome, HasFewFalseFindings) {
    for (int n = 0; n < 200; ++n) {
        const TrueScene scene = n % 2 == 0 ? tag_scene(2 + n) : board_scene(2 + n);
        const Findings findings = found_in(plain(scene, n), scene, n);
        EXPECT_TRUE(is_matched(findings)) << n << ": " << names(findings);
    }
}

// ---- pixel measurement

// Photographs with a sensor's noise, of cameras that differ from the calibration in one thing:
// truth is the number that was changed. Where it is the lens or the tone, the reference integrator
// made them, and the renderer that is compared has no part in them; its own error (0.8 gray RMS at
// blurred edges with these samples) would be a finding where nothing is wrong.

ImageAgreement matched(const PhotographedTruth& truth,
                       RenderMethod method = RenderMethod::automatic) {
    const ImageAgreement match = photographed(truth, 31, method);
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

    const ImageAgreement beside = matched({.background = stated_background + 0.1});
    EXPECT_NEAR(beside.background_gray->value, 0.1 * 0.8 * (255.0 - 9.0),
                beside.background_gray->expanded_uncertainty + 0.3);
    EXPECT_THAT(beside.findings, ElementsAre(HasSubstr("is brighter than the")));
}

}  // namespace
}  // namespace etalon
