// The 26 chessboard photographs of OpenCV's documentation package, copied flat into
// ETALON_PHOTO_DIR.

#include "calib/files/camera_file.h"
#include "calib/intrinsics/calibrate.h"
#include "calib/intrinsics/camera_consistency.h"
#include "compare/detect/board/chessboard_corners.h"
#include "sim/marker/marker.h"
#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {
namespace {

const std::filesystem::path folder = ETALON_PHOTO_DIR,
                            left_intrinsics = folder / "left_intrinsics.yml";

std::vector<std::filesystem::path> photos(const std::string& side) {
    std::vector<std::filesystem::path> paths;
    for (const int number : {1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14})
        paths.push_back(folder / fmt::format("{}{:02}.jpg", side, number));
    return paths;
}

class CalibrationPhotos : public testing::Test {
protected:
    void SetUp() override {
        for (const char* side : {"left", "right"})
            for (const auto& path : photos(side))
                if (!std::filesystem::exists(path))
                    GTEST_SKIP() << "no " << path;
    }
};

std::vector<CalibrationView> views_of(const std::string& side) {
    const Marker board = parse_marker("chessboard:9x6@25mm", "test");
    std::vector<CalibrationView> views;
    for (const auto& photo : photos(side)) {
        const auto corners = find_chessboard_corners(read_image(photo), 9, 6);
        if (!corners) {
            ADD_FAILURE() << "no board in " << photo;
            continue;
        }
        views.push_back({board.points_mm, corners->pixels});
    }
    return views;
}

// Once for all tests, as the command does it: model advised, everything measured.
const CameraCalibration& calibration(const std::string& side) {
    static std::map<std::string, CameraCalibration> known;
    if (!known.contains(side))
        known[side] = calibrate_camera(views_of(side), {640, 480});
    return known[side];
}

const ModelScore& score(const CameraCalibration& calibration, const std::string& model) {
    return *std::ranges::find(calibration.advice.models, model, &ModelScore::model);
}

// Two cameras of one type in one set: 533 and 537 px, centres 15 px apart.
TEST_F(CalibrationPhotos, OfTheTwoCamerasAreToldApart) {
    std::vector<CalibrationView> both = views_of("left");
    EXPECT_EQ(camera_groups(both, {640, 480}).size(), 1u);
    const auto right = views_of("right");
    EXPECT_EQ(camera_groups(right, {640, 480}).size(), 1u);
    both.insert(both.end(), right.begin(), right.end());
    const auto groups = camera_groups(both, {640, 480});
    ASSERT_EQ(groups.size(), 2u);
    for (const CameraGroup& group : groups) {
        EXPECT_EQ(group.views.size(), 13u);
        EXPECT_EQ(group.views.back() - group.views.front(), 12u);
    }
}

TEST_F(CalibrationPhotos, LeftFitsAndPredictsToATwentiethOfASquare) {
    const CameraCalibration& found = calibration("left");
    EXPECT_EQ(found.points_left_out(), 0u);
    EXPECT_LE(found.rms_px, 0.200);
    EXPECT_LE(*found.leave_one_out_rms_px, 0.203);
    EXPECT_GE(*found.leave_one_out_rms_px, found.rms_px);
    // The package's own calibration, from the same photos with a wider refinement window.
    const auto theirs = read_camera(left_intrinsics);
    EXPECT_NEAR(found.camera.intrinsics.fx, theirs.intrinsics.fx, 5.0);
    EXPECT_NEAR(found.camera.intrinsics.cx, theirs.intrinsics.cx, 3.0);
    EXPECT_NEAR(found.camera.intrinsics.cy, theirs.intrinsics.cy, 3.0);
}

TEST_F(CalibrationPhotos, RightFitsAndPredictsToATwentiethOfASquare) {
    const CameraCalibration& found = calibration("right");
    EXPECT_EQ(found.points_left_out(), 0u);
    EXPECT_LE(found.rms_px, 0.212);
    EXPECT_LE(*found.leave_one_out_rms_px, 0.216);
}

// The standard model is the simplest that predicts; without left06.jpg the prism model folds over
// in it, and the rational one misses it by far: they followed the photos.
TEST_F(CalibrationPhotos, RationalAndPrismModelsAreFoundToOverfit) {
    const CameraCalibration& found = calibration("left");
    EXPECT_EQ(found.model.name, "standard");
    EXPECT_FALSE(found.overfits());
    for (const char* model : {"rational", "prism"}) {
        EXPECT_TRUE(score(found, model).overfits) << model;
        EXPECT_LT(score(found, model).rms_px, 0.1945) << model;
        EXPECT_LT(score(found, model).rms_px, found.rms_px) << model;
    }
    for (const char* model : {"pinhole", "radial", "standard"})
        EXPECT_FALSE(score(found, model).overfits) << model;
    const auto asked =
        calibrate_camera(views_of("left"), {640, 480}, {.model = "prism", .resamples = 0});
    EXPECT_EQ(asked.model.name, "prism");
    EXPECT_TRUE(asked.overfits());
}

// The photographed corners are not independent within a photo: formal deviations are too small, and
// two ways of looking at whole photos agree on by how much, as far as 13 photos tell (20 % each;
// the bootstrap is also moved by k3, which single photos decide).
TEST_F(CalibrationPhotos, DeviationsOverViewsExceedTheFormalOnes) {
    for (const char* side : {"left", "right"})
        for (const ParameterDeviation& deviation : calibration(side).deviations) {
            EXPECT_GT(deviation.cluster_robust, deviation.formal) << deviation.name;
            EXPECT_LT(deviation.cluster_robust, 5 * deviation.formal) << deviation.name;
            ASSERT_TRUE(deviation.bootstrap);
            EXPECT_GT(*deviation.bootstrap, deviation.formal) << deviation.name;
            EXPECT_LT(*deviation.bootstrap, 5 * deviation.formal) << deviation.name;
            EXPECT_GT(*deviation.bootstrap / deviation.cluster_robust, 0.6) << deviation.name;
            EXPECT_LT(*deviation.bootstrap / deviation.cluster_robust, 2.0) << deviation.name;
        }
}

// Two halves that share no photo, where corners were.
TEST_F(CalibrationPhotos, HalvesAgreeAsTheirCovariancesSay) {
    for (const char* side : {"left", "right"}) {
        const CrossValidation& halves = calibration(side).halves.value();
        EXPECT_LT(halves.rms_px, 1.0) << side;
        EXPECT_LT(halves.rms_px, 2.0 * halves.expected_robust_px) << side;
    }
}

// Two cameras photographed one board: nothing else is common to the two fits.
TEST_F(CalibrationPhotos, TwoCamerasFindTheSameShapeOfTheBoard) {
    std::map<std::string, CameraCalibration> fitted;
    for (const char* side : {"left", "right"}) {
        EXPECT_TRUE(calibration(side).flatness->is_distorted());
        fitted[side] = calibrate_camera(views_of(side), {640, 480},
                                        {.model = "standard", .resamples = 0, .fit_board = true});
        EXPECT_LT(*fitted[side].leave_one_out_rms_px,
                  0.8 * *calibration(side).leave_one_out_rms_px);
    }
    const auto& left = fitted["left"].board->points;
    const auto& right = fitted["right"].board->points;
    ASSERT_EQ(left.size(), right.size());
    double differences = 0.0, displacements = 0.0, variances = 0.0;
    for (std::size_t i = 0; i < left.size(); ++i) {
        differences += (left[i].displacement_mm - right[i].displacement_mm).squaredNorm();
        displacements += 0.5 * left[i].displacement_mm.squaredNorm() +
                         0.5 * right[i].displacement_mm.squaredNorm();
        variances += left[i].deviation_mm.squaredNorm() + right[i].deviation_mm.squaredNorm();
    }
    EXPECT_LT(differences, 0.2 * displacements);
    EXPECT_LT(differences, 2.0 * variances);
}

TEST_F(CalibrationPhotos, ThePackagesOwnCalibrationIsRead) {
    if (!std::filesystem::exists(left_intrinsics))
        GTEST_SKIP() << "no " << left_intrinsics;
    const CameraModel camera = read_camera(left_intrinsics);
    EXPECT_EQ(camera.width, 640);
    EXPECT_EQ(camera.height, 480);
    EXPECT_EQ(camera.intrinsics.fx, 5.3591573396163199e+02);
    EXPECT_EQ(camera.intrinsics.cy, 2.3557082909788173e+02);
    EXPECT_EQ(camera.distortion.p1, 1.7831947042852964e-03);
    EXPECT_EQ(camera.distortion.k3, 2.3839153080878486e-01);
}

}  // namespace
}  // namespace etalon
