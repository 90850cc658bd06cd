// `etalon calibrate` and `camera check` of a telecentric lens as a user meets them: from rendered
// photographs of a chessboard to a camera file, with no guess.
#include <opencv2/imgcodecs.hpp>

#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "sim/marker/marker.h"
#include "sim/render/renderer.h"
#include "tests/station/built_program.h"

namespace etalon {
namespace {

using Json = nlohmann::json;

// 22 mm x 17 mm; 2.5 px of distortion in the corners.
CameraModel lens() {
    return {.width = 400,
            .height = 300,
            .projection = {.kind = Projection::telecentric},
            .intrinsics = {18.2, 17.9, 208.0, 141.0},
            .distortion = {.k1 = -6.3e-5}};
}

// The first one is flat on.
Rigid pose_of(int photo) {
    const double turn = 2.4 * photo, tilt = photo == 0 ? 0.0 : 0.35 + 0.1 * std::sin(3 * turn);
    const Eigen::Quaterniond rotation =
        rotation_from_vector({tilt * std::cos(turn), tilt * std::sin(turn), 0}) *
        rotation_from_vector({0, 0, 0.15 * std::sin(5 * turn)});
    const Eigen::Vector3d place(1.1 * (photo % 3 - 1) - 0.4, 1.0 * (photo / 3 - 1) + 0.5, 60.0);
    return {rotation, place - rotation * Eigen::Vector3d(7.2, 4.5, 0)};
}

void write_photos(const TemporaryFolder& folder) {
    const Marker board = parse_marker("chessboard:9x6@1.8mm", "test");
    const Renderer renderer(lens());
    const SensorModel sensor(lens());
    for (int photo = 0; photo < 8; ++photo)
        cv::imwrite(
            (folder / fmt::format("{}.png", photo)).string(),
            sensor.expose(renderer.render({{{board.grid, pose_of(photo)}}, 1.0}).radiance).pixels);
}

TEST(TelecentricCommand, CalibratesFromPhotosAlone) {
    const TemporaryFolder folder;
    write_photos(folder);
    const Finished done =
        etalon_with(folder,
                    "calibrate --model telecentric_radial --target chessboard:9x6@1.8mm "
                    "'*.png' --out camera.yml --report report");
    ASSERT_EQ(done.exit_code, 0) << done.err;
    EXPECT_THAT(done.out, HasSubstr("model telecentric_radial"));
    EXPECT_THAT(done.err, HasSubstr("mirror image"));
    const CameraModel found = read_camera(folder / "camera.yml");
    EXPECT_EQ(found.projection.kind, Projection::telecentric);
    EXPECT_NEAR(found.intrinsics.fx, 18.2, 2e-3);
    EXPECT_NEAR(found.intrinsics.fy, 17.9, 2e-3);
    EXPECT_NEAR(found.intrinsics.cx, 208.0, 1.0);
    EXPECT_NEAR(found.intrinsics.cy, 141.0, 1.0);
    EXPECT_NEAR(found.distortion.k1, -6.3e-5, 5e-7);
    const Json report = Json::parse(read_text(folder / "report/calibration.json"));
    EXPECT_EQ(report["advised_model"], "telecentric_radial");
    EXPECT_LT(report["rms_px"], 0.02);
    EXPECT_EQ(report["corners_left_out"], 0);
    EXPECT_THAT(read_text(folder / "report/report.html"), HasSubstr("fx, fy in px per mm"));

    const Finished check = etalon_with(folder, "camera check camera.yml");
    EXPECT_EQ(check.exit_code, 0) << check.err;
    EXPECT_THAT(check.out, HasSubstr("field of view  22.15 x 16.84 mm, diagonal"));
}

TEST(TelecentricCommand, HoldsTheCentreAndSaysSo) {
    const TemporaryFolder folder;
    write_photos(folder);
    const Finished done = etalon_with(folder,
                                      "calibrate --model telecentric --json --target "
                                      "chessboard:9x6@1.8mm '*.png' --out camera.yml");
    ASSERT_EQ(done.exit_code, 0) << done.err;
    EXPECT_THAT(done.err, HasSubstr("cx = 199.5 is held: has no effect"));
    const Json parameters = Json::parse(done.out)["parameters"];
    EXPECT_EQ(parameters["cx"]["value"], 199.5);
    EXPECT_EQ(parameters["cy"]["held"], "has no effect without distortion");
    EXPECT_FALSE(parameters["cx"].contains("standard_deviation"));
    EXPECT_EQ(read_camera(folder / "camera.yml").covariance->order,
              (std::vector<std::string>{"fx", "fy"}));
}

TEST(TelecentricCommand, RefusesWhatALensWithoutAPointOfViewCannotHave) {
    const TemporaryFolder folder;
    const std::string command =
        "calibrate --model telecentric --target chessboard:9x6@1.8mm x.png --out camera.yml ";
    expect_one_line_error(etalon_with(folder, command + "--fit-board"), 3, "--fit-board: does not");
    expect_one_line_error(etalon_with(folder, command + "--refine photometric"), 3,
                          "--refine: does not");
}

}  // namespace
}  // namespace etalon
