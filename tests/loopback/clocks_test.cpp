// Clocks that lie, and a program that stands still: `etalon qualify` against the twin ends with its
// verdict or with a clear error.

#include "station/record/run_record.h"
#include "tests/loopback/quick_run.h"

namespace etalon {
namespace {

// Debian's libfaketime; empty where it is not installed.
std::string faking_library() {
    for (const auto& folder : std::filesystem::directory_iterator("/usr/lib"))
        if (const auto library = folder.path() / "faketime/libfaketimeMT.so.1"; exists(library))
            return library.string();
    return "";
}

class Clocks : public QuickRun {
protected:
    // A program whose system clock reads what set_clock() said last. The monotonic one is the
    // kernel's.
    std::vector<std::string> with_set_clock() const {
        return {"LD_PRELOAD=" + faking_library(),
                "FAKETIME_TIMESTAMP_FILE=" + clock_file().string(), "FAKETIME_NO_CACHE=1",
                "FAKETIME_DONT_FAKE_MONOTONIC=1", "DONT_FAKE_MONOTONIC=1"};
    }
    void set_clock(const std::string& time) const { write_text(clock_file(), time + "\n"); }
    std::filesystem::path clock_file() const { return folder_ / "clock"; }

    // Within a minute: one that waits for a time of the system's clock may wait for a day.
    void expect_passed(Program& program) const {
        wait_until([&] { return program.has_ended(); });
        ASSERT_TRUE(program.has_ended());
        const std::string text = program.rest();
        EXPECT_EQ(program.exit_code(), 0) << text;
        const Json run = run_of(record_);
        EXPECT_EQ(run["outcome"], "PASS") << run["reason"];
        EXPECT_EQ(run["poses_visited"], quick_poses);
        EXPECT_LT(run["duration_s"].get<double>(), 600.0);
    }

    // By the system's clock, off by what it was set back or forth.
    double begun_ago_s() const {
        return utc_seconds(utc_now()).value() -
               utc_seconds(run_of(record_)["started_utc"].get<std::string>()).value();
    }

    void freeze(Program& program, Duration time) const {
        program.send(SIGSTOP);
        SteadyClock().wait_for(time, {});
        program.send(SIGCONT);
    }

    const std::filesystem::path record_ = folder_ / "record";
};

TEST_F(Clocks, TheSystemsClockMayBeSetBackAndForthInTheMiddleOfARun) {
    if (faking_library().empty())
        GTEST_SKIP() << "needs libfaketime";
    set_clock("+0");
    const auto program = begin(record_, with_set_clock());
    wait_for(record_, "pose", 4);
    set_clock("-3600");
    wait_for(record_, "pose", 9);
    set_clock("+86400");
    wait_for(record_, "pose", 14);
    set_clock("-86400");
    expect_passed(*program);
    EXPECT_NEAR(begun_ago_s(), 0.0, 600.0);
    double before = 0.0;
    for (const std::string& line : split(read_text(record_ / "events.jsonl"), '\n')) {
        if (line.find("\"event\":\"pose\"") == std::string::npos)
            continue;
        const double t = Json::parse(line)["t"];
        EXPECT_GT(t, before);
        EXPECT_LT(t, before + 300.0);
        before = t;
    }
}

// Later than 2^31 s, and the program's clock goes on from there; read again by one of today.
TEST_F(Clocks, ARunOf2039IsWrittenAndReadAgain) {
    if (faking_library().empty())
        GTEST_SKIP() << "needs libfaketime";
    set_clock("@2039-01-20 11:07:05");
    std::vector<std::string> environment = with_set_clock();
    environment.push_back("TZ=UTC");
    expect_passed(*begin(record_, environment));
    EXPECT_THAT(run_of(record_)["started_utc"], HasSubstr("2039-01-20T11:"));
    const Json before = run_of(record_);
    Program report("etalon", {"report", record_.string()});
    expect_passed(report);
    EXPECT_EQ(run_of(record_)["measurements"], before["measurements"]);
    EXPECT_EQ(run_of(record_)["started_utc"], before["started_utc"]);
    Program history("etalon", {"history", record_.string(), "--out", (folder_ / "h").string()});
    EXPECT_THAT(history.rest(), HasSubstr("2039-01-20T11:"));
    EXPECT_EQ(history.exit_code(), 0);
}

TEST_F(Clocks, ATimeZoneWithoutRulesIsOfNoAccount) {
    for (const char* zone : {"TZ=/nonexistent", "TZ=Garbage/Zone"}) {
        std::filesystem::remove_all(record_);
        expect_passed(*begin(record_, {zone}));
        EXPECT_NEAR(begun_ago_s(), 0.0, 600.0) << zone;
    }
}

// What a suspended machine is to its devices. The stage's watchdog (1.5 s) runs out in mid-motion:
// at 4 mm/s the way to the first pose takes some seconds.
TEST_F(Clocks, AProgramThatWasFrozenInMidMotionEndsWithTheWatchdogsAlarm) {
    std::string slow = read_text(folder_ / "station.yaml");
    for (int axis = 0; axis < 3; ++axis)
        slow = replaced(slow, "speed: 2000,", "speed: 4,");
    write_text(folder_ / "station.yaml", slow);
    const auto program = begin(record_);
    wait_for(record_, "stage homed", 1);
    for (int time = 0; time < 2;
         ++time) {  // on a busy machine the first may come before the motion
        SteadyClock().wait_for(300ms, {});
        freeze(*program, 2s);
    }
    const std::string text = program->rest();
    EXPECT_EQ(program->exit_code(), 4) << text;
    EXPECT_EQ(run_of(record_)["outcome"], "ERROR");
    EXPECT_THAT(run_of(record_)["reason"], HasSubstr("alarm 3 (watchdog expired while moving)"));
    EXPECT_EQ(run_of(record_)["poses_visited"], 0);
}

// The camera's heartbeat (3 s) runs out while the axes rest: it is taken again.
TEST_F(Clocks, AProgramThatWasFrozenBesideItsCameraTakesItAgain) {
    const auto program = begin(record_);
    wait_until([&] { return exists(record_ / "frames/0007_0.png"); });
    freeze(*program, 4s);
    expect_passed(*program);
    EXPECT_GE(count(record_, "camera reconnected"), 1);
}

}  // namespace
}  // namespace etalon
