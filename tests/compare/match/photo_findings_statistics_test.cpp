// Photographs with a fault each, of a tag and of a chessboard, at two poses and with two noise
// seeds: none is a match, and the finding has the right name. Photographs without a fault are
// matches. The smallest faults that are found: tests/evidence/match_outcome_limits.cpp,
// docs/match-outcome.md.
#include "compare/match/photo_findings.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <set>

#include "core/statistics/random.h"
#include "tests/compare/match/adversarial_photos.h"

namespace etalon {
namespace {

using test::TrueScene;

std::shared_ptr<const PhotometricCamera> calibrated() {
    static const auto camera = std::make_shared<const PhotometricCamera>(test::calibrated_camera());
    return camera;
}

// As `etalon compare` does it.
Findings examined(const CodeImage& photo, const TrueScene& scene, const Rigid& pose,
                  const std::shared_ptr<const PhotometricCamera>& camera) {
    const ComparedArea area = compared_area(scene.marker, {}, "test");
    const Findings before = examine_marker(photo, scene.marker, area, camera->projector(), pose);
    if (is_refused(before))
        return before;
    return examine_match(photo, scene.marker, area, *camera,
                         match_photo(photo, scene.marker.grid, area, camera, pose));
}

std::string names(const Findings& findings) {
    std::string list;
    for (const Finding& finding : findings)
        list += finding.name + " ";
    return list;
}

using Photographer = std::function<CodeImage(const TrueScene&, int seed)>;

using Scenes = TrueScene (*)(int pose);

// Four photographs of a target; every one must have a finding with one of these names.
void expect_found(const std::set<std::string>& expected, const Photographer& photo, Scenes scenes,
                  const CameraModel& camera_file = test::calibrated_camera()) {
    const auto camera = std::make_shared<const PhotometricCamera>(camera_file);
    for (int pose = 0; pose < 2; ++pose)
        for (int seed = 1; seed <= 2; ++seed) {
            const TrueScene scene = scenes(pose);
            const Findings findings = examined(photo(scene, seed), scene,
                                               test::found_pose(scene, camera_file, seed), camera);
            EXPECT_FALSE(is_matched(findings));
            EXPECT_TRUE(std::any_of(
                findings.begin(), findings.end(),
                [&](const Finding& finding) { return expected.count(finding.name) > 0; }))
                << scene.marker.spec << " at pose " << pose << ": " << names(findings);
            for (const Finding& finding : findings)
                EXPECT_TRUE(std::isfinite(finding.value) && !finding.sentence.empty());
        }
}

void expect_found_on_both(const std::set<std::string>& expected, const Photographer& photo) {
    expect_found(expected, photo, test::tag_scene);
    expect_found(expected, photo, test::board_scene);
}

void expect_match_on_both(const Photographer& photo) {
    for (const bool board : {false, true})
        for (int pose = 0; pose < 2; ++pose) {
            const TrueScene scene = board ? test::board_scene(pose) : test::tag_scene(pose);
            const Findings findings =
                examined(photo(scene, 3), scene, test::found_pose(scene, calibrated()->model(), 3),
                         calibrated());
            EXPECT_TRUE(is_matched(findings)) << names(findings);
        }
}

TEST(MatchOutcome, OfAPhotographWithoutFaultIsAMatch) {
    expect_match_on_both([](const TrueScene& scene, int seed) {
        return test::exposed(test::radiance_of(scene), seed);
    });
}

TEST(MatchOutcome, OfUnevenLightIsAMatch) {
    expect_match_on_both([](const TrueScene& scene, int seed) {
        return test::exposed(test::unevenly_lit(scene, 0.5), seed);
    });
}

// Eight gray more than the camera has.
TEST(MatchOutcome, OfNoiseIsAMatch) {
    expect_match_on_both([](const TrueScene& scene, int seed) {
        CodeImage photo = test::exposed(test::radiance_of(scene), seed);
        cv::Mat noise(photo.pixels.size(), CV_16SC1);
        RandomStream random(5, 2);
        for (short& value : cv::Mat_<short>(noise))
            value = static_cast<short>(std::lround(8.0 * random.normal()));
        cv::add(photo.pixels, noise, photo.pixels, cv::noArray(), CV_8U);
        return photo;
    });
}

TEST(MatchOutcome, OfJpegAtQuality50IsAMatch) {
    expect_match_on_both([](const TrueScene& scene, int seed) {
        return test::compressed(test::exposed(test::radiance_of(scene), seed), 50);
    });
}

// The truth from brute-force sampling: no renderer of ours made this photograph.
TEST(MatchOutcome, OfAPhotographByTheReferenceIntegratorIsAMatch) {
    const TrueScene scene = test::tag_scene(0);
    const Findings findings =
        examined(test::exposed(test::reference_radiance_of(scene), 4), scene,
                 test::found_pose(scene, calibrated()->model(), 4), calibrated());
    EXPECT_TRUE(is_matched(findings)) << names(findings);
}

// A camera whose file knows lens and noise: the blur is not fitted, and a larger one is a finding.
TEST(MatchOutcome, NamesABlurThatIsNotTheCamerasOwn) {
    const auto camera = std::make_shared<const PhotometricCamera>(test::true_camera());
    for (const bool board : {false, true}) {
        const TrueScene scene = board ? test::board_scene(0) : test::tag_scene(0);
        const Rigid pose = test::found_pose(scene, camera->model(), 5);
        const Radiance sharp = test::radiance_of(scene);
        EXPECT_TRUE(is_matched(examined(test::exposed(sharp, 5), scene, pose, camera)))
            << names(examined(test::exposed(sharp, 5), scene, pose, camera));
        cv::Mat blurred;
        cv::GaussianBlur(sharp, blurred, {0, 0}, 0.8);
        const Findings findings = examined(test::exposed(blurred, 5), scene, pose, camera);
        ASSERT_FALSE(is_matched(findings));
        EXPECT_EQ(findings.front().name, "blur_differs") << names(findings);
        EXPECT_GT(findings.front().value, 0.0);
    }
}

TEST(MatchOutcome, NamesWhatCoversTheMarker) {
    for (const double reflectance : {0.1, 0.4, 0.8})
        expect_found_on_both({"occluded"}, [&](const TrueScene& scene, int seed) {
            return test::exposed(test::occluded(scene, 1.5 * test::cell_px(scene), reflectance),
                                 seed);
        });
}

TEST(MatchOutcome, NamesGlare) {
    expect_found_on_both({"glare"}, [](const TrueScene& scene, int seed) {
        return test::exposed(test::with_glare(scene, 0.8 * test::cell_px(scene), 3.0), seed);
    });
}

TEST(MatchOutcome, NamesMotionBlur) {
    expect_found_on_both({"motion_blur"}, [](const TrueScene& scene, int seed) {
        return test::exposed(test::moved(scene, 5.0), seed);
    });
}

TEST(MatchOutcome, NamesTheIdThatIsThereInstead) {
    expect_found(
        {"wrong_marker"},
        [](TrueScene scene, int seed) {
            scene.shown = parse_marker("apriltag:36h11:17@50mm", "test").grid;
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::tag_scene);
}

TEST(MatchOutcome, SeesThatAnotherFamilysTagIsNotThisOne) {
    expect_found(
        {"wrong_marker", "marker_not_there"},
        [](TrueScene scene, int seed) {
            scene.shown = parse_marker("aruco:6X6_50:3@50mm", "test").grid;
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::tag_scene);
}

TEST(MatchOutcome, SeesThatAnotherBoardIsNotThisOne) {
    expect_found(
        {"marker_not_there"},
        [](TrueScene scene, int seed) {
            scene.shown = parse_marker("chessboard:12x9@18mm", "test").grid;
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::board_scene);
}

TEST(MatchOutcome, NamesAMarkerUpsideDown) {
    expect_found(
        {"upside_down"},
        [](TrueScene scene, int seed) {
            cv::rotate(scene.marker.grid.cells, scene.shown.cells, cv::ROTATE_180);
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::tag_scene);
}

// Half a turn of a board with an odd number of corners each way more than even exchanges light and
// dark, and so does its negative: one group.
TEST(MatchOutcome, NamesABoardUpsideDownTogetherWithItsNegative) {
    expect_found(
        {"negative"},
        [](TrueScene scene, int seed) {
            cv::rotate(scene.marker.grid.cells, scene.shown.cells, cv::ROTATE_180);
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::board_scene);
}

TEST(MatchOutcome, NamesATurnAndAMirrorImage) {
    expect_found(
        {"turned"},
        [](TrueScene scene, int seed) {
            cv::rotate(scene.marker.grid.cells, scene.shown.cells, cv::ROTATE_90_CLOCKWISE);
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::tag_scene);
    expect_found(
        {"mirrored"},
        [](TrueScene scene, int seed) {
            cv::flip(scene.marker.grid.cells, scene.shown.cells, 1);
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::tag_scene);
}

TEST(MatchOutcome, NamesANegative) {
    expect_found_on_both({"negative"}, [](const TrueScene& scene, int seed) {
        return test::negative(test::exposed(test::radiance_of(scene), seed));
    });
}

TEST(MatchOutcome, NamesRowsThatAreReadWhileTheMarkerMoves) {
    expect_found_on_both({"skewed"}, [](const TrueScene& scene, int seed) {
        return test::exposed(test::rolled(scene, 3.0), seed);
    });
}

TEST(MatchOutcome, NamesSharpening) {
    for (const double amount : {0.5, 1.0, 2.0})
        expect_found_on_both({"sharpened"}, [&](const TrueScene& scene, int seed) {
            return test::sharpened(test::exposed(test::radiance_of(scene), seed), amount, 1.2);
        });
}

TEST(MatchOutcome, NamesACalibrationWithOtherDistortion) {
    CameraModel wrong = test::calibrated_camera();
    wrong.distortion.k1 += 0.05;
    expect_found(
        {"calibration_mismatch"},
        [](const TrueScene& scene, int seed) {
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::wide_board_scene, wrong);
}

TEST(MatchOutcome, NamesACalibrationWithAnotherFocalLength) {
    CameraModel wrong = test::calibrated_camera();
    wrong.intrinsics.fx *= 1.05;
    wrong.intrinsics.fy *= 1.05;
    expect_found(
        {"calibration_mismatch"},
        [](const TrueScene& scene, int seed) {
            return test::exposed(test::radiance_of(scene), seed);
        },
        test::board_scene, wrong);
}

TEST(MatchOutcome, RefusesWhatIsSaturatedOrWithoutContrast) {
    expect_found_on_both({"saturated"}, [](const TrueScene& scene, int seed) {
        return test::exposed(2.0 * test::radiance_of(scene), seed);
    });
    expect_found_on_both({"low_contrast"}, [](const TrueScene& scene, int seed) {
        return test::exposed(0.3 + 0.08 * test::radiance_of(scene), seed);
    });
    expect_found_on_both({"marker_not_there"}, [](const TrueScene& scene, int seed) {
        return test::exposed(Radiance(0.5 + 0.0 * test::radiance_of(scene)), seed);
    });
}

TEST(MatchOutcome, RefusesWhatIsOutOfFocusBeyondUse) {
    expect_found_on_both({"out_of_focus"}, [](const TrueScene& scene, int seed) {
        cv::Mat radiance;
        cv::GaussianBlur(test::radiance_of(scene), radiance, {0, 0}, 5.0);
        return test::exposed(radiance, seed);
    });
}

TEST(MatchOutcome, NamesAMarkerThatReachesOutOfTheImage) {
    for (const bool board : {false, true}) {
        TrueScene scene = board ? test::board_scene(0) : test::tag_scene(0);
        scene.camera_from_marker.translation.x() += board ? 90.0 : 50.0;
        const Findings findings = examined(test::exposed(test::radiance_of(scene), 1), scene,
                                           scene.camera_from_marker, calibrated());
        ASSERT_FALSE(is_matched(findings));
        EXPECT_EQ(findings.front().name, "not_in_image") << names(findings);
    }
}

TEST(MatchOutcome, NamesStrongCompression) {
    expect_found_on_both({"compressed"}, [](const TrueScene& scene, int seed) {
        return test::compressed(test::exposed(test::radiance_of(scene), seed), 10);
    });
}

// 200 photographs without a fault, each at a pose of its own. At the stated rate of 1 % two false
// findings are expected and more than seven come up once in 700 such tests.
TEST(MatchOutcome, HasFewFalseFindings) {
    int wrong = 0;
    for (int n = 0; n < 200; ++n) {
        const TrueScene scene = n % 2 == 0 ? test::tag_scene(2 + n) : test::board_scene(2 + n);
        const Findings findings =
            examined(test::exposed(test::radiance_of(scene), n), scene,
                     test::found_pose(scene, calibrated()->model(), n), calibrated());
        wrong += is_matched(findings) ? 0 : 1;
        EXPECT_TRUE(is_matched(findings)) << n << ": " << names(findings);
    }
    std::printf("%d of 200 photographs without a fault have a finding\n", wrong);
    EXPECT_LE(wrong, 7);
}

}  // namespace
}  // namespace etalon
