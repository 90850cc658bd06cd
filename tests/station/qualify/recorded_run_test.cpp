// A record read back, analysed again and resumed; and what is refused.
#include "station/qualify/recorded_run.h"

#include <fmt/chrono.h>

#include <ctime>

#include "compare/qualification/judged_quantities.h"
#include "core/file/sha256.h"
#include "core/statistics/random.h"
#include "station/qualify/image_result_cache.h"
#include "station/qualify/run_analysis.h"
#include "station/record/run_json.h"
#include "tests/station/built_program.h"
#include "tests/station/station_of_mocks.h"

namespace etalon {
namespace {

std::map<std::string, std::string> files_of(const std::filesystem::path& folder) {
    std::map<std::string, std::string> files;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
        if (entry.is_regular_file())
            files[entry.path().lexically_relative(folder).string()] = sha256_of_file(entry.path());
    return files;
}

// A run that nobody saw the marker in: quick, as there is nothing to render.
class RecordOfARun : public testing::Test {
protected:
    void SetUp() override {
        mocks.run();
        log = read_text(log_path());
    }

    std::filesystem::path log_path() const { return mocks.record() / log_file; }
    std::string refusal() {
        return config_error_of([&] { mocks.read(); });
    }
    void expect_refused(const std::string& broken_log, const std::string& why) {
        write_text(log_path(), broken_log);
        EXPECT_THAT(refusal(), HasSubstr(why));
        write_text(log_path(), log);
    }
    // The log up to the end of the line that has `text` for the n-th time, from 0.
    std::string log_until(const std::string& text, int n) const {
        std::size_t at = 0;
        for (int i = 0; i <= n; ++i)
            at = log.find(text, at) + 1;
        return log.substr(0, log.find('\n', at) + 1);
    }
    // What a program leaves that was killed after seven poses.
    std::string seven_poses() const { return log_until("\"event\":\"pose\"", 6); }
    void keep_seven_poses() { write_text(log_path(), seven_poses()); }

    StationOfMocks mocks;
    std::string log;
};

TEST_F(RecordOfARun, IsReadBackAsItWasMeasured) {
    StationOfMocks other;
    other.on_camera = [](FakeCamera& camera) { camera.script.assign(1, FrameStatus::corrupt); };
    const QualifyResult was = other.run();
    const RecordedRun read = other.read();
    const QualifyResult& is = read.result;
    EXPECT_TRUE(read.dropped.empty());
    EXPECT_TRUE(read.is_measured());
    EXPECT_EQ(is.outcome, was.outcome);
    EXPECT_EQ(is.started_utc, was.started_utc);
    EXPECT_EQ(is.duration_s, was.duration_s);
    EXPECT_EQ(is.camera.serial, "CAM-7");
    EXPECT_EQ(is.statistics().rejected, 1);
    EXPECT_EQ(is.statistics().delivered, was.statistics().delivered);
    ASSERT_EQ(is.poses.size(), was.poses.size());
    const auto figures = [](const AnalysedPose& pose) {
        return std::tuple(pose.read_back, pose.read_back_uncertainty, pose.approach, pose.settled_s,
                          pose.hold_out, pose.frames[1].exposure_start_s, pose.frames[1].sha256);
    };
    for (std::size_t i = 0; i < is.poses.size(); ++i)
        EXPECT_EQ(figures(is.poses[i]), figures(was.poses[i]));
}

TEST_F(RecordOfARun, DoesNotNeedTheFilesThatItWasMadeFrom) {
    for (const char* file : {"station.yaml", "camera.yml", "limits.yaml"})
        std::filesystem::remove(mocks.folder / file);
    const RecordedRun read = mocks.read();
    EXPECT_EQ(read.result.station.id, "test-station");
    EXPECT_EQ(read.result.station.inputs[1].path, mocks.folder / "camera.yml");
    EXPECT_EQ(read.result.station.inputs[1].copy, "inputs/camera.yml");
}

TEST_F(RecordOfARun, IsRefusedWhenAFileIsNotWhatTheRunUsed) {
    std::ofstream(mocks.record() / "inputs/camera.yml", std::ios::app) << "\n";
    EXPECT_THAT(refusal(), HasSubstr("inputs/camera.yml: is not the calibration file"));
}

TEST_F(RecordOfARun, IsRefusedWhenAFrameIsMissingOrChanged) {
    const auto frame = mocks.record() / "frames/0004_1.png";
    const std::string bytes = read_bytes(frame);
    write_text(frame, bytes + "x");
    EXPECT_THAT(refusal(), HasSubstr("0004_1.png: is not the frame that was taken"));
    std::filesystem::remove(frame);
    EXPECT_THAT(refusal(), HasSubstr("0004_1.png"));
}

TEST_F(RecordOfARun, IsRefusedWhenItsLogCannotBeWhatARunWrote) {
    const auto with = [&](const std::string& what, const std::string& by) {
        return replaced(log, what, by);
    };
    const std::string first = log.substr(0, log.find('\n') + 1);
    expect_refused("", "is empty");
    expect_refused("{}\n" + log, "events.jsonl:1: t: is missing");
    expect_refused(log.substr(first.size()), "the first line");
    expect_refused(first + log, "the first line, and no other");
    expect_refused(with("run-log/1", "run-log/2"), "must be 'run-log/1'");
    expect_refused(with("\"inputs/camera.yml\"", "\"inputs/../../camera.yml\""), "not in inputs/");
    expect_refused(with("\"inputs/camera.yml\"", "\"/etc/passwd\""), "not in inputs/");
    expect_refused(with("frames/0003_1.png", "../0003_1.png"), "must be 'frames/0003_1.png'");
    expect_refused(with("\"status\":\"complete\"", "\"status\":\"perfect\""), "no 'perfect'");
    expect_refused(with("\"read_back\":", "\"read_bark\":"), "read_back: is missing");
    expect_refused(with("\"hold_out\":true,\"commanded\"", "\"hold_out\":false,\"commanded\""),
                   "is not the one of the plan");
    expect_refused(with("\"approach\":[", "\"approach\":[0,"), "is not of all axes");
    expect_refused(with("\"readings\":[[", "\"readings\":[[1e999],["), "is not JSON");
    expect_refused(with("\"readings\":[[", "\"readings\":[[1],["), "must be 4 numbers");
    const std::size_t first_reading = log.find("\"readings\":[[") + 13;
    expect_refused(std::string(log).replace(first_reading,
                                            log.find(',', first_reading) - first_reading, "-1e4"),
                   "readings[0]: is far beyond the travel of axis x");
    expect_refused(with("{\"t\"", "{\"t"), "is not JSON");
    const std::string twice = log_until("\"event\":\"pose\"", 0);
    const std::string pose =
        twice.substr(twice.find("{\"t\"", twice.find("\"event\":\"frame\"") - 40));
    expect_refused(twice + pose, "was visited before");
    expect_refused(twice + pose.substr(pose.rfind("{\"t\"", pose.size() - 3)),
                   "was visited before");
    expect_refused(twice +
                       "{\"t\":9,\"event\":\"climate\",\"temperature_c\":-500,"
                       "\"humidity_percent\":null}\n",
                   "temperature_c: -500 is out of range");
    // Whole lines that are lost, in the middle or all of them.
    const std::string second = log_until("\"event\":\"pose\"", 1);
    const std::string end = log.substr(log.rfind("{\"t\"", log.size() - 3));
    expect_refused(twice + log.substr(second.size()), "is a verdict, and 24 of 25 poses are there");
    expect_refused(log_until("\"event\":\"session\"", 0) + end,
                   "events.jsonl:3: event: is a verdict, and 0 of 25 poses are there");
}

TEST_F(RecordOfARun, IsRefusedWhenItCameToItsEnd) {
    EXPECT_THAT(config_error_of([&] { mocks.resume(); }),
                HasSubstr("came to its end with INCONCLUSIVE"));
    EXPECT_EQ(read_text(log_path()), log);
}

// The program goes on with the record's own calibration and must not seem to have taken another.
TEST_F(RecordOfARun, IsNotResumedByAnotherCalibration) {
    keep_seven_poses();
    write_text(mocks.folder / "other.yml", read_text(mocks.folder / "camera.yml") + "\n");
    for (const auto& [file, why] :
         {std::pair{"other.yml", "other.yml: is not the calibration file that the run was made"},
          std::pair{"none.yml", "none.yml: no such file"}}) {
        const Finished finished = etalon_with(
            mocks.folder,
            fmt::format("qualify --resume {} --calibration {}", mocks.record().string(), file));
        EXPECT_EQ(finished.exit_code, 3) << finished.err;
        EXPECT_THAT(finished.err, HasSubstr(why));
    }
}

TEST_F(RecordOfARun, IsRefusedByAnotherCamera) {
    keep_seven_poses();
    mocks.on_camera = [](FakeCamera& camera) { camera.identity_.serial = "CAM-8"; };
    mocks.moves = 0;
    EXPECT_THAT(config_error_of([&] { mocks.resume(); }),
                HasSubstr("begun with camera CAM-7, but fake: is camera CAM-8"));
    EXPECT_EQ(mocks.moves, 0);
}

// The log's last planned pose, not visited yet, with one more digit before its last number.
TEST_F(RecordOfARun, IsResumedByItsOwnPlanAndRefusedWhereTheAxesMayNotGo) {
    std::string text = seven_poses();
    const auto at = text.find("],\"hold_out\":", text.find('\n') - 40);
    ASSERT_NE(at, std::string::npos);
    std::string smaller = text, larger = text;
    smaller.insert(at, "e-1");
    write_text(log_path(), smaller);
    EXPECT_EQ(mocks.resume().poses.size(), 25u);
    larger.insert(at, "e9");
    write_text(log_path(), larger);
    mocks.moves = 0;
    EXPECT_THAT(config_error_of([&] { mocks.resume(); }),
                HasSubstr("events.jsonl:1: plan.poses[24]"));
    EXPECT_EQ(mocks.moves, 0);
}

// Between two lines of the log a program may have been killed, with the other files as they stood
// when it began.
TEST_F(RecordOfARun, IsReportedFromTheLogAloneWhereItWasKilled) {
    const auto poses_csv = mocks.record() / "poses.csv";
    const std::string header = read_text(poses_csv).substr(0, read_text(poses_csv).find('\n') + 1);
    keep_seven_poses();
    write_text(poses_csv, header);
    const QualifyResult again = analyse_record(mocks.read(), mocks.progress, {});
    EXPECT_EQ(again.outcome, RunOutcome::error);
    EXPECT_EQ(again.reason, unfinished_run);
    EXPECT_EQ(split(read_text(poses_csv), '\n').size(), 1u + 7u + 1u);
    EXPECT_EQ(mocks.run_file()["poses_visited"], 7);
}

TEST_F(RecordOfARun, EndsWhenTheCameraHasOtherSettingsThanBefore) {
    write_text(log_path(), replaced(seven_poses(), "\"exposure_us\":2000", "\"exposure_us\":2001"));
    const QualifyResult result = mocks.resume();
    EXPECT_EQ(result.outcome, RunOutcome::error);
    EXPECT_THAT(result.reason, HasSubstr("take up the settings of the run"));
    EXPECT_EQ(result.poses.size(), 7u);
}

// What a killed program leaves behind: the log ends anywhere. The first two lines are there from
// before the first motion on.
TEST_F(RecordOfARun, IsResumedFromEveryByteWhereItsLogMayEnd) {
    const std::size_t begin = log.find('\n', log.find('\n') + 1) + 1;
    RandomStream random(71, 0);
    for (int i = 0; i < 5; ++i) {
        const std::size_t length =
            begin + static_cast<std::size_t>(random.uniform() *
                                             static_cast<double>(log.rfind("{\"t\"") - begin));
        const std::string cut = log.substr(0, length);
        write_text(log_path(), cut);
        const RecordedRun before = mocks.read();
        const auto visited = static_cast<int>(before.result.poses.size());
        if (cut.back() != '\n') {
            EXPECT_THAT(before.dropped.at(0), HasSubstr("the last line of the log is not whole"));
        }
        const QualifyResult result = mocks.resume();
        EXPECT_EQ(result.outcome, RunOutcome::inconclusive) << result.reason;
        EXPECT_EQ(result.poses.size(), 25u);
        EXPECT_EQ(result.sessions.size(), 2u);
        EXPECT_EQ(result.sessions[0].poses, visited);
        if (visited < 25) {
            EXPECT_EQ(mocks.moves, 25 - visited);
        }
        EXPECT_EQ(mocks.run_file()["sessions"].size(), 2u);
        const RecordedRun after = mocks.read();
        EXPECT_TRUE(after.is_measured());
        EXPECT_EQ(after.result.sessions.size(), 2u);
    }
}

// The system's clock says that the first session was years ago, or is to come.
TEST_F(RecordOfARun, IsResumedAsLateAsItIsWhateverTheSystemsClockWasSetTo) {
    const std::string kept = seven_poses();
    const std::string key = "\"started_utc\":\"";
    const auto at = kept.find(key) + key.size();
    for (const std::string begun : {"2019-03-07T14:05:09Z", "2039-01-20T03:14:07Z"}) {
        write_text(log_path(), std::string(kept).replace(at, begun.size(), begun));
        const double before = mocks.read().end_s;
        const QualifyResult result = mocks.resume();
        ASSERT_EQ(result.sessions.size(), 2u);
        EXPECT_EQ(result.started_utc, begun);
        EXPECT_GE(result.sessions[1].start_s, before);
        EXPECT_LT(result.sessions[1].start_s, before + 60.0);
        EXPECT_GE(result.poses[7].move_start_s, result.poses[6].done_s);
        EXPECT_EQ(result.statistics().delivered, 50);
    }
}

// After a restart of the machine nothing else tells, nor in a log of before `boot` was written:
// five hours ago by the system's clock.
TEST_F(RecordOfARun, IsResumedByTheSystemsClockAfterARestartOfTheMachine) {
    std::string kept = seven_poses();
    const std::time_t then = std::time(nullptr) - 18000;
    const std::string begun = fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(then));
    const std::string key = "\"started_utc\":\"";
    kept.replace(kept.find(key) + key.size(), begun.size(), begun);
    const auto from = kept.find(",\"boot\":"), to = kept.find(",\"version\":", from);
    for (const char* boot : {",\"boot\":\"another\",\"boot_s\":7.5", ""}) {
        std::string log = std::string(kept).replace(from, to - from, boot);
        if (boot[0] == '\0')  // logs without it are older than operators
            log = replaced(log, ",\"operator\":\"\"", "");
        write_text(log_path(), log);
        const QualifyResult result = mocks.resume();
        EXPECT_NEAR(result.sessions[1].start_s, 18000.0, 60.0);
    }
}

// With the marker in the pictures: everything that an analysis computes.
TEST(RecordedRun, IsAnalysedAgainToTheSameBytes) {
    StationOfMocks mocks;
    show_a_true_camera(mocks);
    ASSERT_EQ(mocks.run().outcome, RunOutcome::pass);
    expect_readable_page(read_text(mocks.record() / "report.html"));
    const auto before = files_of(mocks.record());
    // Without what was kept of the pixels: everything is found again.
    for (const char* file : {"run.json", "report.html", "poses.csv", "junit.xml", "pixels.jsonl"})
        std::filesystem::remove(mocks.record() / file);
    std::filesystem::remove_all(mocks.record() / "renders");
    const QualifyResult again = analyse_record(mocks.read(), mocks.progress, {});
    EXPECT_EQ(again.outcome, RunOutcome::pass);
    EXPECT_EQ(files_of(mocks.record()), before);
    EXPECT_GE(before.size(), 3u + 50u + 15u + 6u);
    const auto run = mocks.run_file();
    for (const auto& file : run["attachments"])
        EXPECT_EQ(file["sha256"], before.at(file["path"])) << file;
    EXPECT_EQ(run["attachments"].size(), before.size() - 2);  // but run.json and pixels.jsonl
}

TEST(RecordedRun, TakesWhatTheSameProgramFoundInTheSamePixels) {
    StationOfMocks mocks;
    show_a_true_camera(mocks);
    const QualifyResult result = mocks.run();
    const auto before = files_of(mocks.record());
    const auto path = mocks.record() / "pixels.jsonl";
    const std::string kept = read_text(path);
    const auto known = [&] {
        const KeptPixels pixels(result);
        return std::ranges::count_if(
            result.poses, [&](const VisitedPose& pose) { return pixels.of(pose) != nullptr; });
    };
    EXPECT_EQ(known(), 25);
    analyse_record(mocks.read(), mocks.progress, {});
    EXPECT_EQ(files_of(mocks.record()), before);
    // Not what is of another program or frame, what a disk has changed, or no line.
    const std::string detector = "\"detector_bias_px\":[[";
    for (const std::string& bad :
         {replaced(kept, "\"made_from\":\"", "\"made_from\":\"0"),
          replaced(kept, detector, detector + "1"), replaced(kept, "{", "["), kept.substr(9)}) {
        write_text(path, bad);
        EXPECT_EQ(known(), 24);
    }
    QualifyResult other = result;
    other.poses[3].frames[1].sha256[7] = 'x';
    other.station.inputs[1].sha256[7] = 'x';
    write_text(path, kept);
    EXPECT_EQ(KeptPixels(result).of(other.poses[3]), nullptr);
    EXPECT_EQ(KeptPixels(other).of(result.poses[0]), nullptr);
}

// A run that ended early is reported again, not judged.
TEST(RecordedRun, HasNoVerdictWhenPosesAreMissing) {
    StationOfMocks mocks;
    mocks.stop_before(4);
    mocks.run();
    mocks.stop = {};
    const auto before = files_of(mocks.record());
    const QualifyResult again = analyse_record(mocks.read(), mocks.progress, {});
    EXPECT_EQ(again.outcome, RunOutcome::aborted);
    EXPECT_EQ(files_of(mocks.record()), before);
}

// ---- qualify report

JudgedQuantity judged(const char* name, double value, double u, double limit, Outcome outcome,
                      const std::string& reason = "") {
    JudgedQuantity quantity{name, quantity_kind(name).unit, true, value, u};
    quantity.limit = limit;
    quantity.outcome = outcome;
    quantity.reason = reason;
    quantity.measured = outcome != Outcome::skipped;
    return quantity;
}

// A run without poses whose analysis is what a test makes it.
class QualifyReport : public testing::Test {
protected:
    QualifyReport() {
        result.station = read_station(write_station(folder_, station_text));
        result.outcome = RunOutcome::fail;
        result.analysis.emplace();
    }
    std::string page() {
        write_qualify_report(result, folder_ / "report.html");
        return read_text(folder_ / "report.html");
    }
    // Up to the heading behind the judged quantities.
    std::string judged_section() {
        const std::string all = page();
        const auto begin = all.find("Judged on the hold-out poses");
        return all.substr(begin, all.find("<h2>", begin) - begin);
    }
    Qualification& analysis() { return *result.analysis; }

    QualifyResult result;

private:
    TemporaryFolder folder_;
};

TEST_F(QualifyReport, LeadsWithVerdictThenCauseThenWhatToDo) {
    analysis().quantities = {judged(quantity::position_rms, 0.021, 0.037, 0.16, Outcome::pass),
                             judged(quantity::position_max, 0.71, 0.09, 0.45, Outcome::fail)};
    analysis().reasons = {"b3_position_field_max_mm is too large", "the stage <b>moved"};
    analysis().causes.emplace();
    analysis().causes->ranked = {
        {{{{"k1", "k4"}, -0.0301, 0.00065, "", {"calibrate the camera again: k1", "again: k4"}}},
         0.97}};
    const std::string text = page();
    std::size_t at = 0;
    for (const char* part :
         {"verdict bad\"", "<strong>FAIL</strong>",
          "Position bias, largest value of the field in the volume: 0.71 mm, U = 0.09 mm (k = 2.00)"
          "; the limit is 0.45 mm.",
          "Most probable cause", "k1 ~ k4: -0.03010 ± 0.00065 (U, k = 2). Probability 97 %.",
          "What to do", "Calibrate the camera again: k1, or again: k4.", "Why it is not PASS",
          "The stage &lt;b&gt;moved.", "Judged on the hold-out poses"}) {
        const std::size_t found = text.find(part, at);
        ASSERT_NE(found, std::string::npos) << part;
        at = found;
    }
    EXPECT_THAT(text, Not(HasSubstr("b3_position_field_max_mm is")));
    expect_readable_page(text);
}

// The sum of many explanations' probabilities, by its rounding.
TEST_F(QualifyReport, NoProbabilityInRunJsonIsOverOne) {
    analysis().causes.emplace();
    analysis().causes->ranked = {{{{{"k1"}, 0.0, 0.0, "", {}}}, 1.0000000000002227}};
    analysis().causes->no_error = 1.0000000000000002;
    const auto causes = nlohmann::json::parse(run_json(result)).at("causes");
    EXPECT_EQ(causes.at("ranked").at(0).at("probability"), 1.0);
    EXPECT_EQ(causes.at("no_error"), 1.0);
}

TEST_F(QualifyReport, SaysOnceWhatToDoForAllErrorsOfAKind) {
    analysis().causes.emplace();
    Cause cause{{{{"k3", "k6"},
                  0.0413,
                  0.0046,
                  "",
                  {"calibrate the camera again: k3", "calibrate the camera again: k6"}},
                 {{"p1"}, 6e-4, 2e-5, "", {"calibrate the camera again: p1"}},
                 {{"blur"}, 0.1, 0.02, "px^2", {"look for vibration"}}},
                0.97};
    for (const char* name : {"s1", "s2", "s3", "s4"})
        cause.instead.push_back({name, "half pixel", "blur"});
    analysis().causes->ranked = {cause};
    EXPECT_THAT(
        page(),
        AllOf(HasSubstr("<li>Or in place of these: s1 and half pixel and blur; s2 and half pixel "
                        "and blur; one of 2 other sets. Probability 97 %.</li>"),
              HasSubstr("<li>Calibrate the camera again: k3 or k6, p1.</li>"
                        "<li>Look for vibration.</li>")));
}

TEST_F(QualifyReport, SetsTheOutcomeBesideTheNameAndNotesBelowTheTable) {
    analysis().quantities = {
        judged(quantity::position_max, 0.3, 0.2, 0.45, Outcome::inconclusive, "U is too large"),
        judged(quantity::lack_of_fit_rms, 0.0, 0.0, 0.1, Outcome::skipped, "no repeats")};
    const std::string section = judged_section();
    EXPECT_THAT(
        section,
        HasSubstr("<td data-label=\"quantity\">Position bias, largest value of the field in "
                  "the volume</td><td class=\"tone unsure\" "
                  "data-label=\"outcome\">INCONCLUSIVE</td>"));
    const auto end = section.find("</table>");
    for (const char* note : {"U is too large.", "no repeats."}) {
        EXPECT_GT(section.find(note), end) << note;
        EXPECT_NE(section.find(note), std::string::npos) << note;
    }
}

TEST_F(QualifyReport, SaysThatAFieldLostInNoiseIsBelowItsUncertainty) {
    result.outcome = RunOutcome::pass;
    analysis().quantities = {judged(quantity::position_rms, 0.0, 0.037, 0.16, Outcome::pass)};
    EXPECT_THAT(page(), AllOf(HasSubstr("over the volume: below 0.037 mm; the limit is 0.16 mm."),
                              HasSubstr("data-label=\"value\">below 0.037</td>")));
}

TEST_F(QualifyReport, ExplainsTheBiasesWhereTheyAreFirstUsed) {
    const std::string text = page();
    for (const char* bias : {"B1", "B2", "B3", "B4"}) {
        const std::regex explained(std::string("<dt>") + bias + "[^<]*</dt><dd>[A-Z][^<]+\\.</dd>");
        EXPECT_TRUE(std::regex_search(text, explained)) << bias;
        EXPECT_EQ(text.find(bias), text.find(std::string("<dt>") + bias) + 4) << bias;
    }
}

TEST_F(QualifyReport, SaysOnTopWhyNothingCouldBeJudged) {
    result.outcome = RunOutcome::inconclusive;
    analysis().reasons = {"white is at the end of the scale"};
    analysis().causes.emplace();
    analysis().causes->ranked = {{{{{"overexposed"}, 0.0, 0.0, "", {"expose less"}}}, 1.0}};
    analysis().quantities = {
        judged(quantity::position_rms, 0.0, 0.0, 0.16, Outcome::skipped, "overexposed")};
    const std::string text = page();
    EXPECT_THAT(text, HasSubstr("<p>overexposed. Probability 100 %.</p>"));
    EXPECT_LT(text.find("White is at the end of the scale."), text.find("<table"));
    result.analysis.reset();
    result.reason = "stage: alarm 12";
    result.outcome = RunOutcome::error;
    EXPECT_THAT(page(), HasSubstr("<strong>ERROR</strong><p>stage: alarm 12</p>"));
}

}  // namespace
}  // namespace etalon
