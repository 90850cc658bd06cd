// Real photographs of a board: with their own calibration they are matches, with one that is wrong
// they are not.

#include "compare/match/photo_findings.h"
#include "tests/compare/board_photos.h"
#include "tests/test.h"

namespace etalon {
namespace {

struct Photos : BoardPhotos {
    using BoardPhotos::BoardPhotos;
    ComparedArea area = compared_area(board, {}, "test");

    // Calls seen(number, photograph's match, camera) for each at the pose of its corners.
    void match(const CameraModel& model, const auto& seen) const {
        const auto camera = std::make_shared<const PhotometricCamera>(model);
        for (std::size_t i = 0; i < images.size(); ++i) {
            const auto pose = estimate_pose(camera->projector(), board.points_mm, views[i].pixels);
            seen(i,
                 match_photo(images[i], board.grid, area, camera, pose.value().camera_from_marker),
                 *camera);
        }
    }

    std::vector<Findings> examined(const CameraModel& model) const {
        std::vector<Findings> findings;
        match(model, [&](std::size_t i, const PhotoMatch& found, const PhotometricCamera& camera) {
            findings.push_back(examine_match(images[i], board, area, camera, found));
        });
        return findings;
    }
};

class RealPhotographs : public testing::TestWithParam<const char*> {
protected:
    void SetUp() override {
        if (!photos_are_there())
            GTEST_SKIP() << "no photographs in " << ETALON_PHOTO_DIR;
    }
};

INSTANTIATE_TEST_SUITE_P(Sides, RealPhotographs, testing::Values("left", "right"),
                         [](const auto& side) { return std::string(side.param); });

// Means of the RMS residual on squares that were not fitted. 7 gray are allowed, JPEG of quality 50
// alone leaves 3. docs/validation.md says what the model's parts buy and what the rest is. The
// corners' poses are as good as the refined ones: a held-out half is not matched better by more
// than a tenth.
TEST_P(RealPhotographs, MatchTheirRenderings) {
    const Photos photos(GetParam());
    double calibrated = 0.0, refined = 0.0;
    photos.match(photos.fit.camera, [&](std::size_t, const PhotoMatch& match, const auto&) {
        EXPECT_LE(match.refined.parameters.size(), 16u);
        calibrated += match.calibrated.scored.rms_gray / 13.0;
        refined += match.refined.scored.rms_gray / 13.0;
    });
    EXPECT_LE(calibrated, 6.5);
    EXPECT_LE(refined, 6.5);
    EXPECT_GE(refined, 3.0);
    EXPECT_NEAR(calibrated, refined, 0.1);
}

// left05.jpg is clipped in 9 % of its light squares, and says so.
TEST_P(RealPhotographs, HaveNoFindingWithTheirOwnCalibration) {
    const Photos photos(GetParam());
    const std::vector<Findings> all = photos.examined(photos.fit.camera);
    for (std::size_t i = 0; i < all.size(); ++i) {
        const bool clipped = photos.names[i] == "left05.jpg";
        ASSERT_EQ(all[i].size(), clipped ? 1u : 0u)
            << photos.names[i] << ": " << all[i].front().sentence;
        if (clipped) {
            EXPECT_EQ(all[i].front().name, "saturated");
        }
    }
}

// k1 0.05 off displaces the image's corners by several px and the boards' by one or two: most
// photographs show it, though each has a pose of its own to make up for it.
TEST(RealPhotographsOfTheLeftCamera, ShowAWrongDistortion) {
    if (!photos_are_there())
        GTEST_SKIP() << "no photographs in " << ETALON_PHOTO_DIR;
    const Photos photos("left");
    CameraModel wrong = photos.fit.camera;
    wrong.distortion.k1 += 0.05;
    int named = 0;
    for (const Findings& findings : photos.examined(wrong))
        named += std::any_of(findings.begin(), findings.end(), [](const Finding& finding) {
            return finding.name == "calibration_mismatch" || finding.name == "skewed";
        });
    EXPECT_GE(named, 7);
}

}  // namespace
}  // namespace etalon
