#include <nlohmann/json.hpp>

#include "station/record/run_events.h"
#include "station/record/run_json.h"
#include "station/record/run_record.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

CodeImage image_of(int value) {
    return {cv::Mat(5, 7, CV_8UC1, cv::Scalar(value)), 8};
}

TEST(ImageWriter, WritesEverythingThatItWasGiven) {
    const TemporaryFolder folder;
    {
        ImageWriter writer;
        for (int i = 0; i < 20; ++i)
            writer.write(folder / fmt::format("{}.png", i), image_of(i));
    }
    for (int i = 0; i < 20; ++i)
        EXPECT_EQ(read_image(folder / fmt::format("{}.png", i)).pixels.at<uchar>(3, 2), i);
}

TEST(ImageWriter, SaysOnceThatAnImageCouldNotBeWritten) {
    const TemporaryFolder folder;
    ImageWriter writer;
    writer.write(folder / "no/such/folder/a.png", image_of(7));
    EXPECT_THROW(writer.flush(), ConfigError);
    EXPECT_NO_THROW(writer.flush());
}

TEST(RunRecord, RefusesAFolderThatHoldsSomething) {
    const TemporaryFolder folder;
    write_text(folder / "something.txt", "precious");
    EXPECT_THROW(RunRecord(folder / "."), ConfigError);
    EXPECT_THROW(RunRecord(folder / "something.txt"), ConfigError);
    EXPECT_FALSE(std::filesystem::exists(folder / "frames"));
    EXPECT_NO_THROW(RunRecord(folder / "new/deep"));
    EXPECT_NO_THROW(require_new_folder(folder / "never"));
}

TEST(RunRecord, HasEachLineOfTheLogOnDiskAtOnce) {
    const TemporaryFolder folder;
    RunRecord record(folder / "run");
    record.log(state_event(1.5, "homed", "all \"axes\"\n"));
    const std::string log = read_text(folder / "run/events.jsonl");
    EXPECT_EQ(std::count(log.begin(), log.end(), '\n'), 1);
    EXPECT_EQ(Json::parse(log)["detail"], "all \"axes\"\n");
    EXPECT_EQ(Json::parse(log)["t"], 1.5);
}

TEST(RunRecord, KnowsTheTimesThatItWrites) {
    EXPECT_EQ(utc_seconds("1970-01-02T00:00:07Z"), 86407.0);
    EXPECT_TRUE(utc_seconds(utc_now()));
    EXPECT_FALSE(utc_seconds("1970-01-02 00:00:07"));
    // 2^31 s after 1970, where 32 bits end, and one later.
    EXPECT_EQ(utc_seconds("2038-01-19T03:14:08Z"), 2147483648.0);
    EXPECT_EQ(utc_seconds("2039-01-20T11:07:05Z"), 2179134425.0);
    // Texts that are taken are in the order of their times.
    for (const char* text : {"2026-3-7T14:05:09Z", "2026-02-30T14:05:09Z", "2026-03-07T14:05:60Z",
                             " 2026-03-07T14:05:09Z", "2026-03-07T14:05:09Zz"})
        EXPECT_FALSE(utc_seconds(text)) << text;
}

TEST(RunRecord, LogsAPoseOnlyWhenItsFramesAreWritten) {
    const TemporaryFolder folder;
    RunRecord record(folder / "run");
    VisitedPose pose;
    pose.index = 3;
    pose.target = {7, -5};
    pose.read_back = {7.001, -5.002};
    pose.read_back_deviation = {0.003, 0.0};
    pose.base_from_carriage.translation = {7.5, -5.5, 0};
    pose.stage_covariance(3, 3) = 25;
    pose.corners = {{1.25, 2.5}};
    record.images().write(folder / "run/frames/0003_0.png", image_of(9));
    record.log_pose(pose, {});
    EXPECT_TRUE(std::filesystem::exists(folder / "run/frames/0003_0.png"));
    const Json event = Json::parse(read_text(folder / "run/events.jsonl"));
    EXPECT_EQ(event["pose"], 3);
    EXPECT_EQ(event["read_back"], Json({7.001, -5.002}));
    EXPECT_EQ(event["read_back_deviation"], Json({0.003, 0.0}));
    EXPECT_EQ(event["base_from_carriage"], Json({0.0, 0.0, 0.0, 7.5, -5.5, 0.0}));
    EXPECT_EQ(event["base_from_carriage_uncertainty"], Json({0.0, 0.0, 0.0, 5.0, 0.0, 0.0}));
    EXPECT_EQ(event["corners"], Json::parse("[[1.25, 2.5]]"));
}

// A run of one pose, which ended early.
class RunTexts : public testing::Test {
protected:
    RunTexts() {
        result.station = read_station(write_station(folder));
        result.plan = make_plan(result.station.plan, result.station.stage.axes, {});
        result.started_utc = "2026-03-07T14:05:09Z";
        result.software = software_versions();
        AnalysedPose pose{VisitedPose{result.plan.poses.front()}};
        pose.target = {7, -5, 3, 0.5};
        pose.read_back = {7.25, -5, 3, 0.5};
        pose.read_back_deviation = {0.125, 0, 0, 0};
        pose.approach = {1, -1, 0, 1};
        result.poses = {pose};
    }
    Json run() const { return Json::parse(run_json(result)); }

    TemporaryFolder folder;
    QualifyResult result;
};

TEST_F(RunTexts, SaysWhatWasAskedWithWhatAndHowItEnded) {
    result.reason = "stage 127.0.0.1:1599: read: timed out \xff";  // not UTF-8: must not throw
    const Json run = this->run();
    EXPECT_EQ(run["etalon"], "run/1");
    EXPECT_EQ(run["outcome"], "ERROR");
    EXPECT_THAT(run["reason"].get<std::string>(), HasSubstr("timed out"));
    EXPECT_EQ(run["inputs"].size(), 3u);
    EXPECT_EQ(run["limits"], "test-limits-5");
    EXPECT_EQ(run["plan"]["hold_out"], 15);
    EXPECT_NEAR(run["plan"]["volume"]["rz"][1].get<double>(), 175.0, 1e-9);
    EXPECT_NEAR(run["stage"]["axes"][3]["travel"][0].get<double>(), -190.0, 1e-9);
    EXPECT_EQ(run["camera"]["calibrated_serial"], "CAM-7");
    EXPECT_FALSE(run["software"]["OpenCV"].get<std::string>().empty());
    EXPECT_FALSE(run.contains("measurements"));
}

TEST_F(RunTexts, GivesEachQuantityItsUnitLimitUncertaintyAndOutcome) {
    Qualification& analysis = result.analysis.emplace();
    analysis.quantities = {{.name = "b3_position_field_rms_mm",
                            .unit = "mm",
                            .measured = true,
                            .value = 0.07,
                            .expanded_uncertainty = 0.02,
                            .limit = 0.3,
                            .outcome = Outcome::pass},
                           {.name = "b3_position_field_max_mm",
                            .unit = "mm",
                            .limit = 0.9,
                            .reason = "too few poses"}};
    ErrorSignature unseen;
    unseen.name = "constant pose offset";
    unseen.detectable_size = std::numeric_limits<double>::infinity();
    analysis.signatures = {unseen};
    const Json run = this->run();
    const Json& first = run["measurements"][0];
    EXPECT_EQ(first["value"], 0.07);
    EXPECT_EQ(first["expanded_uncertainty"], 0.02);
    EXPECT_EQ(first["limit"], 0.3);
    EXPECT_EQ(first["outcome"], "PASS");
    EXPECT_TRUE(run["measurements"][1]["value"].is_null());
    EXPECT_TRUE(run["gauge_report"][0]["detectable_size"].is_null());
}

// The deviation is for a corner of 1 px; the residuals say 0.2 px.
TEST_F(RunTexts, SaysWhatTheRegistrationCouldHardlySee) {
    Registration& seen = result.analysis.emplace().registration.emplace().registration;
    seen.motion = "turns about one axis, base z";
    seen.reduced_squares = 0.04;
    PoorlyConstrainedDirection& weak = seen.weak.emplace_back();
    weak.name = "rotation about base x between X and Y";
    weak.direction = Vector12d::Unit(3);
    weak.deviation = 0.35;
    weak.worth_poses = 0.7;
    const Json registration = run()["registration"];
    EXPECT_EQ(registration["motion"], "turns about one axis, base z");
    ASSERT_EQ(registration["badly_determined"].size(), 1u);
    const Json& found = registration["badly_determined"][0];
    EXPECT_EQ(found["name"], weak.name);
    EXPECT_EQ(found["direction"][3], 1.0);
    EXPECT_NEAR(found["deviation"].get<double>(), 0.2 * 0.35, 1e-15);
    EXPECT_EQ(found["unit"], "rad");
    EXPECT_EQ(found["worth_photographs"], 0.7);
}

TEST_F(RunTexts, HaveAsManyFieldsInEachRowOfPosesCsvAsInItsHeader) {
    for (const bool analysed : {false, true}) {
        if (analysed) {
            result.analysis.emplace();
            result.poses[0].bias.b3 = PoseError{{0.5, 0.25, 0.125}, {0.001, 0.002, 0.003}};
        }
        const auto lines = split(poses_csv(result), '\n');
        ASSERT_EQ(lines.size(), 3u);
        const auto header = split(lines[0], ','), row = split(lines[1], ',');
        ASSERT_EQ(header.size(), row.size());
        const auto column = [&](const std::string& name) {
            const auto found = std::find(header.begin(), header.end(), name);
            return found == header.end() ? "no such column"
                                         : row.at(static_cast<std::size_t>(found - header.begin()));
        };
        EXPECT_EQ(column("read_back_x_mm"), "7.25");
        EXPECT_EQ(column("deviation_x_mm"), "0.125");
        EXPECT_NEAR(std::stod(column("commanded_rz_deg")), 28.64788976, 1e-6);  // 0.5 rad
        EXPECT_EQ(column("approach_y"), "-1");
        EXPECT_EQ(column("b3_y_mm"), analysed ? "0.25" : "");
        EXPECT_EQ(column("b3_rz_mrad"), analysed ? "3" : "");
    }
}

TEST(BootTime, RisesAndKnowsItsBoot) {
    const BootTime before = boot_time(), after = boot_time();
    EXPECT_FALSE(before.boot.empty());
    EXPECT_GT(before.seconds, 0.0);
    EXPECT_GE(seconds_between(before, after).value(), 0.0);
    EXPECT_LT(seconds_between(before, after).value(), 60.0);
}

TEST(BootTime, IsComparedWithinOneBootAlone) {
    EXPECT_EQ(seconds_between({"a", 70.0}, {"a", 3675.5}), 3605.5);
    EXPECT_FALSE(seconds_between({"a", 70.0}, {"b", 3675.5}));
    EXPECT_FALSE(seconds_between({"", 70.0}, {"", 3675.5}));
}

QualifyResult result_with(RunOutcome outcome, const std::vector<JudgedQuantity>& quantities) {
    QualifyResult result;
    result.station.id = "demo & co";
    result.camera.serial = "CAM-7";
    result.started_utc = "2026-03-07T14:05:09Z";
    result.outcome = outcome;
    result.analysis.emplace();
    result.analysis->quantities = quantities;
    result.analysis->reasons = {"one is <not> seen"};
    return result;
}

JudgedQuantity quantity(const std::string& name, Outcome outcome) {
    return {.name = name,
            .unit = "mm",
            .value = 0.07,
            .expanded_uncertainty = 0.02,
            .limit = 0.3,
            .outcome = outcome};
}

TEST(Junit, HasATestCaseForEachQuantityAndOneForTheVerdict) {
    const std::string xml = junit_xml(
        result_with(RunOutcome::inconclusive,
                    {quantity("a", Outcome::pass), quantity("b", Outcome::fail),
                     quantity("c", Outcome::inconclusive), quantity("d", Outcome::not_observable),
                     quantity("e", Outcome::skipped)}));
    EXPECT_THAT(xml, HasSubstr("tests=\"6\" failures=\"1\" errors=\"2\" skipped=\"2\""));
    EXPECT_THAT(xml, HasSubstr("name=\"a\" time=\"0\"><system-out>0.07 mm with U = 0.02 mm"));
    EXPECT_THAT(xml, HasSubstr("<failure type=\"FAIL\""));
    EXPECT_THAT(xml, HasSubstr("<error type=\"INCONCLUSIVE\" message=\"0.07 mm"));
    EXPECT_THAT(xml, HasSubstr("<skipped message=\"NOT_OBSERVABLE: 0.07 mm"));
    EXPECT_THAT(xml, HasSubstr("name=\"verdict\" time=\"0\"><error type=\"INCONCLUSIVE\" "
                               "message=\"one is &lt;not&gt; seen\">"));
    EXPECT_THAT(xml, HasSubstr("classname=\"etalon.demo &amp; co\""));
}

// Green only where the verdict is PASS.
TEST(Junit, IsRedWhereTheVerdictIsNotPass) {
    for (const auto& [outcome, red] : std::vector<std::pair<RunOutcome, std::string>>{
             {RunOutcome::pass, "failures=\"0\" errors=\"0\""},
             {RunOutcome::fail, "failures=\"1\" errors=\"0\""},
             {RunOutcome::inconclusive, "failures=\"0\" errors=\"1\""},
             {RunOutcome::error, "failures=\"0\" errors=\"1\""},
             {RunOutcome::aborted, "failures=\"0\" errors=\"1\""}})
        EXPECT_THAT(junit_xml(result_with(outcome, {})), HasSubstr(red)) << name(outcome);
}

TEST(Junit, HoldsNothingThatXmlHasNoPlaceFor) {
    QualifyResult result = result_with(RunOutcome::error, {});
    result.analysis.reset();
    result.reason = "timed out \xff\x01\n</testsuite>";
    EXPECT_THAT(junit_xml(result), HasSubstr("message=\"timed out ?? &lt;/testsuite&gt;\""));
}

}  // namespace
}  // namespace etalon
