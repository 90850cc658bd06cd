#include "station/history/run_history.h"

#include "core/time/clock.h"
#include "tests/pages.h"
#include "tests/station/history/run_json.h"

namespace etalon {
namespace {

using Json = nlohmann::json;

// Deviates by turns: 1, -2, 2, -1 of the last digit.
double wobble(int i) {
    return std::vector<double>{0.001, -0.002, 0.002, -0.001}[static_cast<std::size_t>(i) % 4];
}

class History : public testing::Test {
protected:
    std::filesystem::path add(const std::string& name, const Json& run) const {
        std::filesystem::create_directories(folder / name);
        write_text(folder / name / "run.json", run.dump());
        return folder / name;
    }
    void add_runs(int first, int last, double value) const {
        for (int day = first; day <= last; ++day)
            add(fmt::format("run-{:02}", day), run_of_day(day, value + wobble(day)));
    }
    std::vector<HistoricRun> read() const {
        const std::vector<std::filesystem::path> folders = {folder / "."};
        return read_history(folders);
    }
    std::string refusal(const std::vector<std::filesystem::path>& folders) const {
        return config_error_of([&] { read_history(folders); });
    }
    TemporaryFolder folder;
};

TEST_F(History, RaisesTheAlarmWhenAQuantityDrifts) {
    add_runs(1, 12, 0.030);
    EXPECT_FALSE(chart_history(read())[0].drifts());
    add_runs(13, 16, 0.040);
    const auto runs = read();
    const auto charts = chart_history(runs);
    ASSERT_EQ(charts.size(), 1u);
    EXPECT_EQ(charts[0].camera, "CAM-7");
    EXPECT_TRUE(charts[0].drifts());
    const Json json = Json::parse(history_json(runs, charts, {}));
    EXPECT_EQ(json["etalon"], "history/1");
    EXPECT_EQ(json["charts"][0]["runs"].size(), 16u);
    EXPECT_TRUE(json["charts"][0]["runs"][0]["q"].is_null());
    EXPECT_TRUE(json["charts"][0]["drifts"]);
}

TEST_F(History, BeginsANewBaselineWithANewCalibration) {
    add_runs(1, 12, 0.030);
    for (int day = 13; day <= 16; ++day) {
        Json run = run_of_day(day, 0.040 + wobble(day));
        run["inputs"][0]["sha256"] = std::string(64, 'b');
        add(fmt::format("run-{}", day), run);
    }
    const auto runs = read();
    const auto charts = chart_history(runs);
    EXPECT_FALSE(charts[0].drifts());
    EXPECT_EQ(charts[0].runs[11].baseline, 1);
    EXPECT_EQ(charts[0].runs[12].baseline, 2);
    EXPECT_FALSE(charts[0].runs[13].chart.q);
    EXPECT_THAT(history_text(runs, charts), HasSubstr("calibration bbbbbbbbbbbb: a new baseline"));
    write_history_report(runs, charts, {}, folder / "report");
    const std::string chart = read_text(folder / "report/chart-1.svg");
    EXPECT_THAT(chart, HasSubstr("new calibration"));
    EXPECT_THAT(chart, HasSubstr("2026-03-13T14:05:09Z, PASS, calibration bbbbbbbbbbbb"));
    EXPECT_THAT(chart, Not(HasSubstr("calibration aaaaaaaaaaaa")));
}

TEST_F(History, KeepsCamerasStationsAndMarkersApart) {
    add_runs(1, 3, 0.030);
    int day = 4;
    for (const char* key : {"station", "marker"}) {
        Json run = run_of_day(day++, 0.030);
        run[key] = "another";
        add(key, run);
    }
    Json run = run_of_day(day, 0.030);
    run["camera"]["serial"] = "";
    add("camera", run);
    const auto charts = chart_history(read());
    EXPECT_EQ(charts.size(), 4u);
    EXPECT_EQ(charts[3].camera, "genicam:127.0.0.1");
}

TEST_F(History, LeavesOutRunsThatMeasuredNothing) {
    add_runs(1, 3, 0.030);
    Json ended = run_of_day(4, 0.0), skipped = run_of_day(5, 0.0);
    ended.erase("measurements");
    ended["outcome"] = "ERROR";
    skipped["measurements"][0]["value"] = nullptr;
    skipped["measurements"][0]["outcome"] = "SKIPPED";
    add("ended", ended);
    add("skipped", skipped);
    const auto runs = read();
    EXPECT_EQ(runs.size(), 5u);
    EXPECT_EQ(chart_history(runs)[0].runs.size(), 3u);
}

TEST_F(History, FitsEightyColumnsAndWritesAReport) {
    add_runs(1, 16, -123.456e-7);
    const auto runs = read();
    const auto charts = chart_history(runs);
    for (const std::string& line : split(history_text(runs, charts), '\n'))
        EXPECT_LE(line.size(), 80u) << line;
    write_history_report(runs, charts, {}, folder / "report");
    const std::string page = read_text(folder / "report/report.html");
    EXPECT_THAT(page, HasSubstr("one false alarm in 373 runs"));
    EXPECT_THAT(page, HasSubstr("CAM-7"));
    test::expect_readable_page(page);
    EXPECT_THAT(read_text(folder / "report/chart-1.svg"), HasSubstr("<svg"));
    EXPECT_EQ(read_text(folder / "report/history.json"), history_json(runs, charts, {}));
}

// Folders by their names would be the other way round; 32 bits would take 2039 for 1902.
TEST_F(History, GoesByTheDatesOfTheRunsAcross2038) {
    const char* dates[] = {"2037-12-31T23:59:59Z", "2038-01-19T03:14:08Z", "2039-01-20T11:07:05Z"};
    for (int i = 0; i < 3; ++i) {
        Json run = run_of_day(1, 0.03);
        run["started_utc"] = dates[i];
        add(fmt::format("run-{}", 9 - i), run);
    }
    const auto runs = read();
    ASSERT_EQ(runs.size(), 3u);
    for (std::size_t i = 0; i < 3; ++i)
        EXPECT_EQ(runs[i].started_utc, dates[i]);
}

TEST_F(History, RefusesWhatIsNoRecord) {
    EXPECT_THAT(refusal({folder / "."}), HasSubstr("holds no record"));
    EXPECT_THAT(refusal({folder / "nothing"}), HasSubstr("holds no record"));
    const auto record = add("run", run_of_day(1, 0.03));
    EXPECT_THAT(refusal({record, record}), HasSubstr("is the same run as"));
    for (const auto& [key, value] :
         std::vector<std::pair<std::string, Json>>{{"etalon", "run/2"},
                                                   {"started_utc", "yesterday"},
                                                   {"started_utc", "2026-3-7T14:05:09Z"},
                                                   {"camera", 7},
                                                   {"measurements", Json::array({Json::object()})},
                                                   {"inputs", Json::array()}}) {
        Json broken = run_of_day(1, 0.03);
        broken[key] = value;
        add("run", broken);
        EXPECT_THAT(refusal({record}), HasSubstr(key));
    }
    write_text(record / "run.json", "{\"etalon\": \"run/1\"");
    EXPECT_THAT(refusal({record}), HasSubstr("run.json: is not JSON"));
}

HistoricRun run_on(const std::string& day, const std::string& outcome, double value,
                   const std::string& camera = "CAM-7") {
    return {.started_utc = day + "T14:05:09Z",
            .outcome = outcome,
            .camera = camera,
            .station = "demo",
            .marker = "apriltag:36h11:5@80mm",
            .calibration_sha256 = "a",
            .due_after_days = 90,
            .quantities = {{"b3_position_field_rms_mm", "mm", value, 0.005, 0.06, outcome}}};
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
