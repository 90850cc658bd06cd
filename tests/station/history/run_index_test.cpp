#include "station/history/run_index.h"

#include "tests/station/built_program.h"
#include "tests/station/history/run_json.h"

namespace etalon {
namespace {

using Json = nlohmann::json;

class RunIndexTest : public testing::Test {
protected:
    // With two sessions, and a quantity that was not measured.
    static Json run_of(int day, const std::string& camera, const std::string& outcome) {
        Json run = run_of_day(day, 0.01 * day, camera, outcome);
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
    EXPECT_THAT(indexed.err, HasSubstr("3 runs in ./.etalon-index.sqlite, 3 read anew"));
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
