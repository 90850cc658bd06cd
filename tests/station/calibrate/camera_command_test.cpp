#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "station/calibrate/commands.h"
#include "tests/station/built_program.h"

namespace etalon {
namespace {

constexpr const char* two_cameras =
    "3 OPENCV 3072 2304 2559.75 2558.5 1536.25 1152.75 -0.2 0.1 0.001 -0.002\n"
    "7 PINHOLE 640 480 500 501 320 241\n";
constexpr const char* folded =
    "etalon: camera/1\nserial: U3V-7\nimage: {width: 641, height: 401}\n"
    "intrinsics: {fx: 700, fy: 710, cx: 320, cy: 200}\ndistortion: {k1: -1}\n"
    "covariance: {order: [cy, k1], lower: [0.25, 0, 0.0625]}\n";

Finished run(int (*command)(const CameraFileArguments&), const CameraFileArguments& arguments) {
    return finished([&] { return command(arguments); });
}

class CameraCommand : public testing::Test {
protected:
    std::filesystem::path written(const std::string& name, const char* text) const {
        std::ofstream(folder_ / name) << text;
        return folder_ / name;
    }

    TemporaryFolder folder_;
};

TEST_F(CameraCommand, ShowsWhatWasReadWithItsStandardDeviations) {
    const auto file = written("camera.yml", folded);
    const Finished text = run(run_camera_show, {.file = file});
    EXPECT_THAT(text.out, HasSubstr("format      etalon\nimage       641 x 401 px\n"));
    EXPECT_THAT(text.out, HasSubstr("cy          200  +- 0.5\n"));
    EXPECT_THAT(text.out, HasSubstr("k1          -1  +- 0.25\n"));
    const auto json = nlohmann::json::parse(run(run_camera_show, {.file = file, .json = true}).out);
    EXPECT_EQ(json["intrinsics"]["fy"], 710);
    EXPECT_EQ(json["distortion"]["k1"], -1);
}

TEST_F(CameraCommand, ConvertsOneOfSeveralCamerasAndItsPixelOrigin) {
    const auto file = written("cameras.txt", two_cameras);
    const auto out = folder_ / "camchain.yaml";
    const Finished converted =
        run(run_camera_convert, {.file = file, .out = out, .select = "3", .to = "kalibr"});
    EXPECT_EQ(converted.out, "camera " + out.string() + "\n");
    EXPECT_EQ(converted.err, "");
    const CameraModel camera = read_camera(out);
    EXPECT_EQ(camera.intrinsics.cx, 1535.75);
    EXPECT_EQ(camera.distortion.p2, -0.002);
    run(run_camera_convert, {.file = out, .out = folder_ / "own.yml", .to = "etalon"});
    EXPECT_EQ(read_camera(folder_ / "own.yml").intrinsics.cy, 1152.25);
}

TEST_F(CameraCommand, SaysWhatItLeavesOut) {
    const Finished converted = run(run_camera_convert, {.file = written("camera.yml", folded),
                                                        .out = folder_ / "c.json",
                                                        .to = "matlab",
                                                        .json = true});
    EXPECT_THAT(converted.err, HasSubstr("left out, having no place there: serial, covariance"));
    EXPECT_EQ(nlohmann::json::parse(converted.out)["left_out"].size(), 2u);
}

TEST_F(CameraCommand, RefusesWhatItCannotDo) {
    const auto own = written("camera.yml", folded), two = written("cameras.txt", two_cameras);
    EXPECT_THROW(run_camera_show({.file = two}), ConfigError);
    EXPECT_THROW(run_camera_show({.file = own, .select = "3"}), ConfigError);
    EXPECT_THROW(run_camera_convert({.file = own, .out = folder_ / "x", .to = "opencl"}),
                 ConfigError);
}

TEST_F(CameraCommand, ChecksWithAnExitCodeAndNeverPrintsNan) {
    const auto own = written("camera.yml", folded);
    const Finished text = run(run_camera_check, {.file = own});
    EXPECT_EQ(text.exit_code, 1);
    EXPECT_THAT(text.out, HasSubstr("FAULT    valid region: the distortion folds"));
    EXPECT_THAT(text.out, HasSubstr("field of view  no ray x "));
    EXPECT_THAT(text.out, Not(HasSubstr("nan")));
    const auto json = nlohmann::json::parse(run(run_camera_check, {.file = own, .json = true}).out);
    EXPECT_TRUE(json["field_of_view_deg"]["horizontal"].is_null());
    EXPECT_GT(json["image_without_ray"], 0.0);
    const auto two = written("cameras.txt", two_cameras);
    EXPECT_EQ(run(run_camera_check, {.file = two, .select = "7"}).exit_code, 0);
}

}  // namespace
}  // namespace etalon
