// What `etalon calibrate` says of a calibration, from synthetic corners; and what it refuses. On
// photographs it runs as README.md prints it (tests/readme_commands.sh).
#include "station/calibrate/calibration_report.h"

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "calib/files/camera_file.h"
#include "sim/marker/marker.h"
#include "sim/render/renderer.h"
#include "station/calibrate/commands.h"
#include "tests/calib/synthetic_views.h"
#include "tests/station/built_program.h"

namespace etalon {
namespace {

using SortedJson = nlohmann::json;

// Seven photos of 0.2 px noise; one corner of the fourth is 12 px off.
CalibrationRun run_with_an_outlier() {
    CalibrationRun run;
    run.target = "chessboard:9x6@25mm";
    run.camera_file = "camera.yml";
    run.views = synthetic_views(calibration_truth(), 7, 0.2, 21);
    run.views[3].pixels[20].x() += 12.0;
    for (int i = 0; i < 7; ++i)
        run.photos.push_back("photos/<a>,b" + std::to_string(i) + ".png");
    run.without_target = {"photos/empty.png"};
    run.calibration = calibrate_camera(run.views, {640, 480}, {.model = "radial", .resamples = 20});
    return run;
}

class CalibrationReport : public testing::Test {
protected:
    static void SetUpTestSuite() { run_ = new CalibrationRun(run_with_an_outlier()); }
    static void TearDownTestSuite() { delete run_; }

    static CalibrationRun* run_;
};
CalibrationRun* CalibrationReport::run_ = nullptr;

TEST_F(CalibrationReport, TablesFitATerminalOf80Columns) {
    const std::string tables = calibration_tables(*run_);
    expect_80_columns(tables);
    for (const char* word : {"formal", "cluster", "bootstrap", "pinhole", "tilted", "k2"})
        EXPECT_THAT(tables, HasSubstr(word));
}

TEST_F(CalibrationReport, RemarksNameTheOutlier) {
    EXPECT_THAT(calibration_remarks(*run_),
                Contains(AllOf(HasSubstr("1 of 378 corners"), HasSubstr("1 of <a>,b3.png"))));
}

TEST_F(CalibrationReport, JsonHoldsEveryFigure) {
    const auto json = nlohmann::json::parse(calibration_json(*run_));
    EXPECT_EQ(json["etalon"], "calibration/1");
    EXPECT_EQ(json["model"], "radial");
    EXPECT_EQ(json["corners"], 378);
    EXPECT_EQ(json["corners_left_out"], 1);
    EXPECT_EQ(json["photos_left_out"], 0);
    EXPECT_EQ(json["models"].size(), 6u);
    EXPECT_EQ(json["parameters"].size(), 6u);
    for (const char* way : {"used", "formal", "cluster_robust", "bootstrap"})
        EXPECT_GT(json["parameters"]["fx"]["standard_deviation"][way].get<double>(), 0.0) << way;
    EXPECT_EQ(json["photos"][3]["corners_left_out"], 1);
    EXPECT_EQ(json["photos_without_target"][0], "photos/empty.png");
    EXPECT_TRUE(json["halves"].contains("expected_cluster_robust_px"));
    EXPECT_GT(json["projection_uncertainty"]["after_best_rotation"]["worst_px"].get<double>(), 0.0);
}

TEST_F(CalibrationReport, CornersAreARowEachWithTheirResidual) {
    const TemporaryFolder folder;
    write_corners_csv(folder / "corners.csv", *run_);
    const auto lines = split(read_text(folder / "corners.csv"), '\n');
    ASSERT_EQ(lines.size(), 1u + 378u + 1u);  // and the empty one behind the last line end
    EXPECT_EQ(lines[0], "photo,id,x_mm,y_mm,x_px,y_px,residual_x_px,residual_y_px,left_out");
    const std::string& outlier = lines[1 + 3 * 54 + 20];
    EXPECT_THAT(outlier, StartsWith("\"photos/<a>,b3.png\",20,50,50,"));
    EXPECT_THAT(outlier, EndsWith(",1"));
    EXPECT_NEAR(*parse_number(split(outlier, ',')[7]), 12.0, 1.0);
}

TEST_F(CalibrationReport, PageStandsAloneAndEscapesNames) {
    const std::string page = calibration_html(*run_);
    EXPECT_THAT(page, AllOf(HasSubstr("&lt;a&gt;,b3.png"), Not(HasSubstr("<a>,b"))));
    EXPECT_THAT(page, AllOf(Not(HasSubstr("http://")), Not(HasSubstr("https://")),
                            Not(HasSubstr("<script"))));
    EXPECT_THAT(page, AllOf(Not(HasSubstr("nan")), Not(HasSubstr("inf "))));
    expect_readable_page(page);
    for (const char* part : {"Which model", "its standard deviations", "Two halves", "in pixels"})
        EXPECT_THAT(page, HasSubstr(part));
}

// Ten photos of a bowed board, fitted.
TEST(CalibrationReportOfABoard, TellsTheShapeEverywhere) {
    CalibrationRun run;
    run.camera_file = "camera.yml";
    run.views = views_of(bow, 10, 0.05, 3);
    run.photos.assign(10, "a.png");
    run.calibration = calibrate_camera(
        run.views, {640, 480},
        {.model = "standard", .leave_one_out = false, .resamples = 0, .fit_board = true});
    EXPECT_THAT(calibration_remarks(run),
                testing::IsSupersetOf({HasSubstr("moves with the board, not with the image"),
                                       HasSubstr("Board: displaced by 0.1")}));
    const auto json = nlohmann::json::parse(calibration_json(run));
    EXPECT_EQ(json["board_flatness"]["distorted"], true);
    EXPECT_EQ(json["board"]["points"].size(), 54u);
    EXPECT_NEAR(json["board"]["curvature_xx_xy_yy_per_mm"][0].get<double>(), 8e-5, 2e-5);
    EXPECT_THAT(calibration_html(run), AllOf(HasSubstr("s shape</h2>"), Not(HasSubstr("nan"))));

    const TemporaryFolder folder;
    write_board_csv(folder / "board.csv", *run.calibration.board);
    const auto lines = split(read_text(folder / "board.csv"), '\n');
    ASSERT_EQ(lines.size(), 1u + 54u + 1u);
    EXPECT_EQ(lines[0], "id,x_mm,y_mm,dx_mm,dy_mm,dz_mm,dx_sd_mm,dy_sd_mm,dz_sd_mm");
    EXPECT_THAT(lines[11], StartsWith("10,25,25,"));
}

TEST(CalibrationWords, AValueHasTwoDigitsOfItsDeviation) {
    EXPECT_EQ(with_uncertainty(532.8271, 0.62), "532.83");
    EXPECT_EQ(with_uncertainty(532.8271, 6.2), "532.8");
    EXPECT_EQ(with_uncertainty(532.8271, 620.0), "533");
    EXPECT_EQ(with_uncertainty(-0.00013571, 0.00024), "-0.00014");
    EXPECT_EQ(with_uncertainty(0.5, 0.0), "0.5");
}

std::string message_of(const CalibrateArguments& arguments) {
    return text_of_error<Error>([&] { run_calibrate(arguments); });
}

TEST(CalibrateCommand, RefusesWhatItCannotUse) {
    CalibrateArguments arguments;
    EXPECT_EQ(message_of(arguments), "PHOTOS: no photograph given");
    arguments.photos = {"a.png"};
    EXPECT_THAT(message_of(arguments), HasSubstr("--target"));
    arguments.target = "chessboard:9x6";
    EXPECT_THAT(message_of(arguments), HasSubstr("--target"));
    arguments.target = "chessboard:9x6@25mm";
    arguments.model = "fisheye";
    EXPECT_THAT(message_of(arguments),
                AllOf(HasSubstr("fisheye"), HasSubstr("standard"), HasSubstr("tilted")));
    arguments.model = "auto";
    EXPECT_THAT(message_of(arguments), HasSubstr("a.png"));
}

// ---- camera command

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

// ---- telecentric command

// `etalon calibrate` and `camera check` of a telecentric lens as a user meets them: from rendered
// photographs of a chessboard to a camera file, with no guess.

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
    const SortedJson report = SortedJson::parse(read_text(folder / "report/calibration.json"));
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
    const SortedJson parameters = SortedJson::parse(done.out)["parameters"];
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
