#include "station/history/run_history.h"

#include <nlohmann/json.hpp>

#include "core/time/clock.h"
#include "station/history/run_index.h"
#include "tests/station/built_program.h"

namespace etalon {
namespace {

using SortedJson = nlohmann::json;

// The run.json of this day of March 2026, with one quantity of this value, as far as the
// history reads it.
SortedJson run_of_day(int day, double value, const std::string& camera = "CAM-7",
                      const std::string& outcome = "PASS") {
    return {{"etalon", "run/1"},
            {"outcome", outcome},
            {"started_utc", fmt::format("2026-03-{:02}T14:05:09Z", day)},
            {"station", "demo"},
            {"marker", "apriltag:36h11:5@80mm"},
            {"limits", "demo-1"},
            {"camera", {{"serial", camera}, {"uri", "genicam:127.0.0.1"}}},
            {"inputs", {{{"role", "calibration"}, {"sha256", std::string(64, 'a')}}}},
            {"measurements",
             {{{"name", "b3_position_field_rms_mm"},
               {"unit", "mm"},
               {"value", value},
               {"expanded_uncertainty", 0.005},
               {"limit", 0.06},
               {"outcome", outcome}}}}};
}

// Deviates by turns: 1, -2, 2, -1 of the last digit.
double wobble(int i) {
    return std::vector<double>{0.001, -0.002, 0.002, -0.001}[static_cast<std::size_t>(i) % 4];
}

class History : public testing::Test {
protected:
    std::filesystem::path add(const std::string& name, const SortedJson& run) const {
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
    const SortedJson json = SortedJson::parse(history_json(runs, charts, {}));
    EXPECT_EQ(json["etalon"], "history/1");
    EXPECT_EQ(json["charts"][0]["runs"].size(), 16u);
    EXPECT_TRUE(json["charts"][0]["runs"][0]["q"].is_null());
    EXPECT_TRUE(json["charts"][0]["drifts"]);
}

TEST_F(History, BeginsANewBaselineWithANewCalibration) {
    add_runs(1, 12, 0.030);
    for (int day = 13; day <= 16; ++day) {
        SortedJson run = run_of_day(day, 0.040 + wobble(day));
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
    write_history_report(runs, {}, {}, folder / "report");  // has no chart any more
    EXPECT_FALSE(std::filesystem::exists(folder / "report/chart-1.svg"));
}

TEST_F(History, KeepsCamerasStationsAndMarkersApart) {
    add_runs(1, 3, 0.030);
    int day = 4;
    for (const char* key : {"station", "marker"}) {
        SortedJson run = run_of_day(day++, 0.030);
        run[key] = "another";
        add(key, run);
    }
    SortedJson run = run_of_day(day, 0.030);
    run["camera"]["serial"] = "";
    add("camera", run);
    const auto charts = chart_history(read());
    EXPECT_EQ(charts.size(), 4u);
    EXPECT_EQ(charts[3].camera, "genicam:127.0.0.1");
}

TEST_F(History, LeavesOutRunsThatMeasuredNothing) {
    add_runs(1, 3, 0.030);
    SortedJson ended = run_of_day(4, 0.0), skipped = run_of_day(5, 0.0);
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
    expect_80_columns(history_text(runs, charts));
    write_history_report(runs, charts, {}, folder / "report");
    const std::string page = read_text(folder / "report/report.html");
    EXPECT_THAT(page, HasSubstr("one false alarm in 373 runs"));
    EXPECT_THAT(page, HasSubstr("CAM-7"));
    expect_readable_page(page);
    EXPECT_THAT(read_text(folder / "report/chart-1.svg"), HasSubstr("<svg"));
    EXPECT_EQ(read_text(folder / "report/history.json"), history_json(runs, charts, {}));
}

// Folders by their names would be the other way round; 32 bits would take 2039 for 1902.
TEST_F(History, GoesByTheDatesOfTheRunsAcross2038) {
    const char* dates[] = {"2037-12-31T23:59:59Z", "2038-01-19T03:14:08Z", "2039-01-20T11:07:05Z"};
    for (int i = 0; i < 3; ++i) {
        SortedJson run = run_of_day(1, 0.03);
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
    for (const auto& [key, value] : std::vector<std::pair<std::string, SortedJson>>{
             {"etalon", "run/2"},
             {"started_utc", "yesterday"},
             {"started_utc", "2026-3-7T14:05:09Z"},
             {"camera", 7},
             {"measurements", SortedJson::array({SortedJson::object()})},
             {"inputs", SortedJson::array()}}) {
        SortedJson broken = run_of_day(1, 0.03);
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
    expect_80_columns(fleet_text(fleet));
}

// ---- run index

class RunIndexTest : public testing::Test {
protected:
    // With two sessions, and a quantity that was not measured.
    static SortedJson run_of(int day, const std::string& camera, const std::string& outcome) {
        SortedJson run = run_of_day(day, 0.01 * day, camera, outcome);
        run["reason"] = outcome == "ERROR" ? "no answer" : "";
        run["sessions"] = {{{"operator", "Anna"}}, {{"operator", "Bert"}}};
        run["measurements"].push_back({{"name", "length_error_mm"},
                                       {"unit", "mm"},
                                       {"value", nullptr},
                                       {"expanded_uncertainty", nullptr},
                                       {"limit", 0.1},
                                       {"outcome", "SKIPPED"}});
        return run;
    }
    void add(int day, const std::string& camera, const std::string& outcome = "PASS") const {
        const auto record = folder_ / fmt::format("run-{:02}", day);
        std::filesystem::create_directories(record);
        write_text(record / "run.json", run_of(day, camera, outcome).dump());
    }
    std::filesystem::path folder() const { return folder_ / "."; }
    std::vector<HistoricRun> read() const {
        const std::filesystem::path folders[] = {folder()};
        return read_history(folders);
    }

    TemporaryFolder folder_;
};

// JSON, so that every field is compared; the folder is written in another way.
std::string text_of_runs(std::vector<HistoricRun> runs) {
    std::string text = history_text(runs, chart_history(runs));
    for (HistoricRun& run : runs) {
        text += fmt::format("{} {} {} {} {} {} {} {} {} {}\n", run.folder.filename().string(),
                            run.started_utc, run.outcome, run.reason, run.operator_name, run.camera,
                            run.station, run.marker, run.limits, run.calibration_sha256);
        for (const HistoricQuantity& one : run.quantities)
            text += fmt::format("{} {} {} {} {} {}\n", one.name, one.unit, one.value.value_or(-1),
                                one.expanded_uncertainty.value_or(-1), one.limit.value_or(-1),
                                one.outcome);
    }
    return text;
}

TEST_F(RunIndexTest, GivesTheRunsThatTheRecordsGive) {
    for (const int day : {7, 3, 9, 5})
        add(day, day == 5 ? "CAM-7" : "CAM-12", day == 9 ? "ERROR" : "PASS");
    RunIndex index(folder());
    EXPECT_EQ(index.update().runs, 4);
    EXPECT_EQ(text_of_runs(index.runs()), text_of_runs(read()));
    EXPECT_EQ(index.runs().back().operator_name, "Bert") << "of the last session";
}

TEST_F(RunIndexTest, ReadsOnlyWhatHasChanged) {
    for (const int day : {1, 2, 3})
        add(day, "CAM-7");
    RunIndex index(folder());
    EXPECT_EQ(index.update().read, 3);
    EXPECT_EQ(index.update().read, 0);
    add(2, "CAM-7", "FAIL");
    add(4, "CAM-7");
    std::filesystem::remove_all(folder_ / "run-01");
    const IndexUpdate update = index.update();
    EXPECT_EQ(update.read, 2);
    EXPECT_EQ(update.gone, 1);
    EXPECT_EQ(update.runs, 3);
    EXPECT_EQ(text_of_runs(index.runs()), text_of_runs(read()));
}

TEST_F(RunIndexTest, FiltersByCameraOutcomeAndNumber) {
    add(1, "CAM-7", "ERROR");
    add(2, "CAM-12", "ABORTED");
    add(3, "CAM-7", "FAIL");
    add(4, "CAM-7");
    RunIndex index(folder());
    index.update();
    EXPECT_EQ(index.runs({"CAM-7"}).size(), 3u);
    EXPECT_EQ(index.runs({"", "demo", "FAIL"}).size(), 1u);
    EXPECT_EQ(index.runs({"' OR 1 --"}).size(), 0u);
    EXPECT_EQ(index.runs({.unfinished = true}).size(), 2u);
    const auto latest = index.runs({.at_most = 2});
    ASSERT_EQ(latest.size(), 2u);
    EXPECT_EQ(latest.back().outcome, "PASS");
}

TEST_F(RunIndexTest, LeavesOutWhatIsNoRunAndSaysSo) {
    add(1, "CAM-7");
    add(2, "CAM-7");
    write_text(folder_ / "run-02" / "run.json", "{\"etalon\": \"run/2\"}");
    RunIndex index(folder());
    const IndexUpdate update = index.update();
    EXPECT_EQ(update.runs, 1);
    ASSERT_EQ(update.refused.size(), 1u);
    EXPECT_THAT(update.refused[0], HasSubstr("run.json"));
}

TEST_F(RunIndexTest, IsMadeAnewWhenItIsDeletedDamagedOrOfAnotherVersion) {
    add(1, "CAM-7");
    { RunIndex(folder()).update(); }
    const auto file = folder_ / run_index_file;
    for (const std::string& damage :
         {std::string(), std::string("no database"), read_text(folder_ / "run-01/run.json")}) {
        std::filesystem::remove(file);
        if (!damage.empty())
            write_text(file, damage);
        RunIndex index(folder());
        EXPECT_EQ(index.update().runs, 1);
    }
}

TEST_F(RunIndexTest, GivesTheCommandTheTableThatTheRecordsGive) {
    for (const int day : {1, 2, 3})
        add(day, "CAM-7");
    const Finished indexed = etalon_with(folder_, "history --index .");
    EXPECT_EQ(indexed.exit_code, 0) << indexed.err;
    EXPECT_EQ(indexed.out, etalon_with(folder_, "history .").out);
    EXPECT_THAT(indexed.err, HasSubstr("3 runs in ./.etalon-index.sqlite, 3 re-read"));
    EXPECT_EQ(etalon_with(folder_, "history --index . .").exit_code, 3);
    expect_one_line_error(etalon_with(folder_, "history"), 3, "DIR: is required, or --index");
}

TEST_F(RunIndexTest, SaysWhereItCannotBe) {
    EXPECT_THAT(config_error_of([&] { RunIndex index(folder_ / "nowhere"); }),
                HasSubstr(run_index_file));
}

TEST_F(RunIndexTest, OnAFullDiskIsADiskError) {
    add(3, "A");
    const FileSizeLimit limit(5000);
    EXPECT_THROW(RunIndex index(folder()), DiskError);
}

}  // namespace
}  // namespace etalon
