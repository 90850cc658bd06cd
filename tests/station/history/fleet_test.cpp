#include "station/history/run_history.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "core/time/clock.h"

namespace etalon {
namespace {

using testing::HasSubstr;

HistoricRun run_on(const std::string& day, const std::string& outcome, double value,
                   const std::string& camera = "CAM-7") {
    HistoricRun run;
    run.started_utc = day + "T14:05:09Z";
    run.outcome = outcome;
    run.camera = camera;
    run.station = "demo";
    run.marker = "apriltag:36h11:5@80mm";
    run.calibration_sha256 = "a";
    run.due_after_days = 90;
    run.quantities = {{"b3_position_field_rms_mm", "mm", value, 0.005, 0.06, outcome}};
    return run;
}

std::vector<CameraState> states(const std::vector<HistoricRun>& runs, const std::string& today) {
    return fleet_of(runs, chart_history(runs), today);
}

TEST(Fleet, SaysWhenACameraIsDueAgain) {
    std::vector<HistoricRun> runs = {run_on("2026-01-01", "PASS", 0.03),
                                     run_on("2026-02-01", "PASS", 0.03),
                                     run_on("2026-03-01", "FAIL", 0.09)};
    const auto before = states(runs, "2026-05-01");  // 90 days after 2026-02-01: May 2nd
    ASSERT_EQ(before.size(), 1u);
    EXPECT_EQ(before[0].due, "2026-05-02");
    EXPECT_FALSE(before[0].is_due);
    EXPECT_EQ(before[0].last_outcome, "FAIL");
    EXPECT_EQ(before[0].runs, 3);
    EXPECT_TRUE(states(runs, "2026-05-02")[0].is_due);
    EXPECT_THAT(fleet_text(states(runs, "2026-05-02")), HasSubstr("2026-05-02 DUE"));
}

TEST(Fleet, SaysOfACameraThatNeverPassedThatItIsDue) {
    const std::vector<HistoricRun> runs = {run_on("2026-01-01", "INCONCLUSIVE", 0.058)};
    const auto fleet = states(runs, "2026-01-01");
    EXPECT_TRUE(fleet[0].is_due);
    EXPECT_EQ(fleet[0].due, "");
    EXPECT_THAT(fleet_text(fleet), HasSubstr("now"));
}

TEST(Fleet, DoesNotKnowWhenACameraIsDueWhoseLimitsDoNotSay) {
    std::vector<HistoricRun> runs = {run_on("2026-01-01", "PASS", 0.03)};
    runs[0].due_after_days.reset();
    EXPECT_FALSE(states(runs, "2099-01-01")[0].is_due);
    EXPECT_EQ(states(runs, "2099-01-01")[0].due, "");
}

TEST(Fleet, CountsRunsWithAVerdictOnlyAndKeepsCamerasApart) {
    const std::vector<HistoricRun> runs = {
        run_on("2026-01-01", "PASS", 0.03, "B"), run_on("2026-01-02", "ERROR", 0.03, "A"),
        run_on("2026-01-03", "PASS", 0.03, "A"), run_on("2026-01-04", "ABORTED", 0.03, "C")};
    const auto fleet = states(runs, "2026-01-05");
    ASSERT_EQ(fleet.size(), 2u);
    EXPECT_EQ(fleet[0].camera, "A");
    EXPECT_EQ(fleet[0].runs, 1);
    EXPECT_EQ(fleet[0].last_utc, "2026-01-03T14:05:09Z");
    EXPECT_EQ(fleet[1].camera, "B");
}

// 0.001 mm a month from the first run on: 0.012 mm a year. The control chart sees nothing yet.
std::vector<HistoricRun> creeping(int count) {
    std::vector<HistoricRun> runs;
    const long first = *days_of_date("2026-01-01");
    for (int i = 0; i < count; ++i)
        runs.push_back(run_on(date_of_days(first + 30 * i), "PASS",
                              0.030 + 0.001 * i + (i % 2 == 0 ? 0.0004 : -0.0004)));
    return runs;
}

TEST(Fleet, FindsACameraThatCreeps) {
    const std::vector<HistoricRun> runs = creeping(9);
    const auto fleet = states(runs, "2026-10-01");
    ASSERT_EQ(fleet[0].trends.size(), 1u);
    EXPECT_TRUE(fleet[0].trends[0].is_shown);
    EXPECT_TRUE(fleet[0].drifts());
    EXPECT_NEAR(fleet[0].trends[0].trend.per_year.value(), 0.012175, 0.002);
    EXPECT_THAT(fleet_text(fleet), HasSubstr("b3_position_field_rms_mm: +0.012"));
    const auto json = nlohmann::json::parse(fleet_json(fleet));
    EXPECT_TRUE(json["cameras"][0]["trends"][0]["trend"]);
    EXPECT_TRUE(json["cameras"][0]["drifts"]);
    EXPECT_THAT(json["method"].get<std::string>(), HasSubstr("1 % probability"));
}

TEST(Fleet, JudgesOnlyTheRunsSinceTheLatestCalibration) {
    std::vector<HistoricRun> runs = creeping(12);
    for (std::size_t i = 8; i < runs.size(); ++i)
        runs[i].calibration_sha256 = "b";
    const auto fleet = states(runs, "2026-12-31");
    EXPECT_EQ(fleet[0].trends[0].trend.runs, 4);
    EXPECT_FALSE(fleet[0].trends[0].is_judged);
    EXPECT_FALSE(fleet[0].drifts());
}

TEST(Fleet, FitsEightyColumns) {
    std::vector<HistoricRun> runs = creeping(9);
    for (HistoricRun& run : runs)
        run.outcome = "INCONCLUSIVE";
    std::vector<CameraState> fleet = states(runs, "2026-10-01");
    fleet[0].alarms = {"b3_position_field_rms_mm"};
    EXPECT_THAT(fleet_text(fleet), HasSubstr("DUE ALARM TREND"));
    for (const std::string& line : split(fleet_text(fleet), '\n'))
        EXPECT_LE(line.size(), 80u) << line;
}

}  // namespace
}  // namespace etalon
