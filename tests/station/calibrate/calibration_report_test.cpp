// What `etalon calibrate` says of a calibration, from synthetic corners; and what it refuses. On
// photographs it runs as README.md prints it (tests/readme_commands.sh).
#include "station/calibrate/calibration_report.h"

#include <nlohmann/json.hpp>

#include "station/calibrate/commands.h"
#include "tests/calib/synthetic_views.h"
#include "tests/pages.h"

namespace etalon {
namespace {

// Seven photos of 0.2 px noise; one corner of the fourth is 12 px off.
CalibrationRun run_with_an_outlier() {
    CalibrationRun run;
    run.target = "chessboard:9x6@25mm";
    run.camera_file = "camera.yml";
    run.views = test::synthetic_views(test::calibration_truth(), 7, 0.2, 21);
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
    for (const std::string& line : split(tables, '\n'))
        EXPECT_LE(line.size(), 80u) << line;
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
    test::expect_readable_page(page);
    for (const char* part : {"Which model", "its standard deviations", "Two halves", "in pixels"})
        EXPECT_THAT(page, HasSubstr(part));
}

// Ten photos of a bowed board, fitted.
TEST(CalibrationReportOfABoard, TellsTheShapeEverywhere) {
    CalibrationRun run;
    run.camera_file = "camera.yml";
    run.views = test::views_of(test::bow, 10, 0.05, 3);
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

}  // namespace
}  // namespace etalon
