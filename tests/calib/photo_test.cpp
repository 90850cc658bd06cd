// The 26 chessboard photographs of OpenCV's documentation package, copied flat into
// ETALON_PHOTO_DIR.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "calib/calibrate.h"
#include "calib/camera_file.h"
#include "compare/chessboard_corners.h"
#include "sim/marker.h"

namespace etalon {
namespace {

std::vector<std::filesystem::path> photos(const std::string& side) {
    std::vector<std::filesystem::path> paths;
    for (const int number : {1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14})
        paths.push_back(std::filesystem::path(ETALON_PHOTO_DIR) /
                        fmt::format("{}{:02}.jpg", side, number));
    return paths;
}

bool have(const std::vector<std::filesystem::path>& paths) {
    return std::all_of(paths.begin(), paths.end(),
                       [](const auto& path) { return std::filesystem::exists(path); });
}

CameraCalibration calibrate(const std::string& side) {
    const Marker board = parse_marker("chessboard:9x6@25mm", "test");
    std::vector<CalibrationView> views;
    for (const auto& photo : photos(side)) {
        const auto corners = find_chessboard_corners(read_image(photo), 9, 6);
        if (!corners) {
            ADD_FAILURE() << "no board in " << photo;
            continue;
        }
        EXPECT_EQ(corners->refinement_half_window_px, 5);
        views.push_back({board.points_mm, corners->pixels});
    }
    return calibrate_camera(views, {640, 480});
}

TEST(CalibrationPhotos, LeftFitsAndPredictsToATwentiethOfASquare) {
    if (!have(photos("left")))
        GTEST_SKIP() << "no photographs in " << ETALON_PHOTO_DIR;
    const CameraCalibration calibration = calibrate("left");
    EXPECT_LE(calibration.rms_px, 0.200);
    EXPECT_LE(*calibration.leave_one_out_rms_px, 0.203);
    EXPECT_GE(*calibration.leave_one_out_rms_px, calibration.rms_px);
    // The package's own calibration, from the same photos with a wider refinement window.
    const auto theirs =
        read_camera(std::filesystem::path(ETALON_PHOTO_DIR) / "left_intrinsics.yml");
    EXPECT_NEAR(calibration.camera.intrinsics.fx, theirs.intrinsics.fx, 5.0);
    EXPECT_NEAR(calibration.camera.intrinsics.cx, theirs.intrinsics.cx, 3.0);
    EXPECT_NEAR(calibration.camera.intrinsics.cy, theirs.intrinsics.cy, 3.0);
}

TEST(CalibrationPhotos, RightFitsAndPredictsToATwentiethOfASquare) {
    if (!have(photos("right")))
        GTEST_SKIP() << "no photographs in " << ETALON_PHOTO_DIR;
    const CameraCalibration calibration = calibrate("right");
    EXPECT_LE(calibration.rms_px, 0.212);
    EXPECT_LE(*calibration.leave_one_out_rms_px, 0.216);
}

// The photographed corners are not independent within a photo: formal deviations are too small.
TEST(CalibrationPhotos, DeviationsOverViewsExceedTheFormalOnes) {
    if (!have(photos("left")))
        GTEST_SKIP() << "no photographs in " << ETALON_PHOTO_DIR;
    for (const ParameterDeviation& deviation : calibrate("left").deviations) {
        EXPECT_GT(*deviation.jackknife, deviation.formal) << deviation.name;
        EXPECT_LT(*deviation.jackknife, 5 * deviation.formal) << deviation.name;
    }
}

TEST(CalibrationPhotos, ThePackagesOwnCalibrationIsRead) {
    const auto path = std::filesystem::path(ETALON_PHOTO_DIR) / "left_intrinsics.yml";
    if (!std::filesystem::exists(path))
        GTEST_SKIP() << "no " << path;
    const CameraModel camera = read_camera(path);
    EXPECT_EQ(camera.width, 640);
    EXPECT_EQ(camera.height, 480);
    EXPECT_EQ(camera.intrinsics.fx, 5.3591573396163199e+02);
    EXPECT_EQ(camera.intrinsics.cy, 2.3557082909788173e+02);
    EXPECT_EQ(camera.distortion.p1, 1.7831947042852964e-03);
    EXPECT_EQ(camera.distortion.k3, 2.3839153080878486e-01);
}

}  // namespace
}  // namespace etalon
