// The program `etalon qualify` against the twin over the real protocols, when something ends the
// run early: it stops in time, with its exit code, and keeps what was measured.
#include "station/record/run_record.h"
#include "tests/loopback/quick_run.h"
#include "tests/loopback/tcp_connection.h"

namespace etalon {
namespace {

// A run that has measured a few poses.
class InterruptedRun : public QuickRun {
protected:
    InterruptedRun() : station_(begin(record_)) { wait_for(record_, "pose", 3); }

    int rows_of_poses_csv() const {
        return static_cast<int>(split(read_text(record_ / "poses.csv"), '\n').size()) - 2;
    }
    // The exit code, which must come within this time.
    int exit_code_within(Duration limit) const {
        SteadyClock clock;
        const Instant begin = clock.now();
        const int code = station_->exit_code();
        EXPECT_LT(clock.now() - begin, limit);
        EXPECT_GE(rows_of_poses_csv(), 3);
        return code;
    }

    const std::filesystem::path record_ = folder_ / "run";
    std::unique_ptr<Program> station_;
};

TEST_F(InterruptedRun, EndsWith4AndKeepsTheRecordWhenTheTwinIsKilled) {
    twin_->send(SIGKILL);
    EXPECT_EQ(exit_code_within(10s), 4);
    EXPECT_EQ(run_of(record_)["outcome"], "ERROR");
    EXPECT_TRUE(std::filesystem::exists(record_ / "report.html"));
}

TEST_F(InterruptedRun, EndsWith4WhenTheTwinFreezes) {
    twin_->send(SIGSTOP);
    EXPECT_EQ(exit_code_within(10s), 4);
}

TEST_F(InterruptedRun, StopsTheAxesAndEndsWith130OnInterrupt) {
    station_->send(SIGINT);
    EXPECT_EQ(exit_code_within(5s), 130);
    EXPECT_THAT(read_text(record_ / "events.jsonl"),
                HasSubstr("\"axes stopped\",\"detail\":\"confirmed\""));
    EXPECT_EQ(run_of(record_)["outcome"], "ABORTED");
}

using SilencedRun = QuickRun;

TEST_F(SilencedRun, WithATwinOfItsOwnComesToItsVerdict) {
    twin_->send(SIGTERM);
    twin_->exit_code();
    write_text(folder_ / "twin.yaml", replaced(quick_twin, "port: 0", "port: " + port_));
    for (const auto& [out, lost] : {std::pair("full", "2>/dev/full"), {"closed", "2>&-"}}) {
        const int status = std::system(
            fmt::format(
                "cd '{}' && '{}' qualify station.yaml --twin twin.yaml --out {} >out.txt {}",
                folder_.path().string(), built_program("etalon"), out, lost)
                .c_str());
        EXPECT_EQ(WEXITSTATUS(status), 0) << lost;
        EXPECT_THAT(read_text(folder_ / "out.txt"), StartsWith("verdict PASS\n"));
        EXPECT_EQ(run_of(folder_ / out)["outcome"], "PASS");
    }
}

// ---- certify

// The way to a certificate over the real protocols: a twin with a sensor in its room, a run that
// reads it, and the program `etalon certify`.

class CertifyCommand : public QuickRun {
protected:
    CertifyCommand() {
        start_twin(
            "room: {port: 0, temperature_c: 20.31, swing_k: 0.12, period_s: 1.7, "
            "humidity_percent: 47.3}\n");
        const std::string room = "room 127.0.0.1:";
        room_port_ = trimmed(twin_ready_.substr(twin_ready_.find(room) + room.size()));
        write_station_with_room(room_port_);
        write_text(folder_ / "certificate.yaml",
                   read_text(ETALON_SOURCE_DIR "/examples/every-key/certificate.yaml"));
    }

    void write_station_with_room(const std::string& port) const {
        const std::string by_hand =
            "environment: {temperature_c: [19.9, 20.5], humidity_percent: [40, 52]}";
        const std::string by_sensor =
            "environment:\n  link: {host: 127.0.0.1, port: " + port +
            ", unit: 9, response_timeout_ms: 200}\n"
            "  temperature: {input_register: 0, type: int16, scale: 0.01}\n"
            "  humidity: {input_register: 1, type: uint16, scale: 0.1}";
        write_text(folder_ / "station.yaml",
                   quick_station(port_) + replaced(traced_text, by_hand, by_sensor));
    }

    std::filesystem::path record() const { return folder_ / "record"; }
    int qualify() const {
        Program program("etalon", {"qualify", (folder_ / "station.yaml").string(), "--out",
                                   record().string(), "--operator", "O. Perator"});
        return program.exit_code();
    }
    std::unique_ptr<Program> certify() const {
        return start_program("etalon", {"certify", record().string(), "--form",
                                        (folder_ / "certificate.yaml").string(), "--out",
                                        (folder_ / "certificate").string()});
    }

    std::string room_port_;
};

// The sine's deviation is 0.12 / sqrt(2) where the poses meet it everywhere.
TEST_F(CertifyCommand, CertifiesARunWhoseRoomWasMeasured) {
    ASSERT_EQ(qualify(), 0);
    EXPECT_EQ(count(record(), "climate"), quick_poses);
    const Json run = run_of(record());
    const Json temperature = run["environment"]["temperature_c"];
    EXPECT_NEAR(temperature["mean"].get<double>(), 20.31, 0.1);
    EXPECT_NEAR(temperature["deviation"].get<double>(), 0.12 / std::sqrt(2.0), 0.04);
    EXPECT_EQ(run["environment"]["humidity_percent"]["mean"], 47.3);
    const auto certifying = certify();
    EXPECT_EQ(certifying->exit_code(), 0);
    const std::string page = read_text(folder_ / "certificate/certificate.html");
    EXPECT_THAT(page, HasSubstr("PASS: the camera conforms"));
    EXPECT_THAT(page, HasSubstr("O. Perator"));
    EXPECT_THAT(page, HasSubstr(" of 24 readings"));
    EXPECT_THAT(read_text(folder_ / "certificate/dcc.xml"), HasSubstr("\\degreecelsius"));
    EXPECT_EQ(run_of(record()), run);  // analysed again: the same figures
}

TEST_F(CertifyCommand, GoesOnWithoutASensorAndThenRefusesToCertify) {
    write_station_with_room("1");  // nobody is there
    EXPECT_EQ(qualify(), 0);
    EXPECT_EQ(count(record(), "climate lost"), 1);
    EXPECT_EQ(count(record(), "pose"), quick_poses);
    const auto refused = certify();
    const std::string said = refused->rest();
    EXPECT_EQ(refused->exit_code(), 3);
    EXPECT_THAT(said, HasSubstr("\nmissing the temperature during the whole run: room sensor"));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "certificate"));
}

// ---- clocks

// Clocks that lie, and a program that stands still: `etalon qualify` against the twin ends with its
// verdict or with a clear error.

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

// ---- demo

// `etalon demo`: the twin goes whenever and however the run goes. What the run itself gives is
// shown by ./demo.sh in continuous integration.

constexpr int stage_port = 1502;  // of the demo's twin

class Demo : public testing::Test {
protected:
    std::string record() const { return (folder_ / "record").string(); }
    TemporaryFolder folder_;
};

TEST_F(Demo, EndsTheTwinWhenTheRunCannotBegin) {
    std::filesystem::create_directory(record());
    write_text(record() + "/precious.txt", "mine");
    Program demo("etalon", {"demo", "--out", record()});
    EXPECT_THAT(demo.line(), StartsWith("twin ready: stage 127.0.0.1:1502, camera"));
    EXPECT_THAT(demo.rest(), HasSubstr(record()));
    EXPECT_EQ(demo.exit_code(), 3);
    EXPECT_FALSE(TcpConnection(stage_port).is_open());
}

TEST_F(Demo, EndsTheTwinAfterASignalAndKeepsTheRecord) {
    for (const int signal : {SIGINT, SIGTERM}) {
        std::filesystem::remove_all(record());
        Program demo("etalon", {"demo", "--out", record()});
        EXPECT_THAT(demo.line(), StartsWith("twin ready"));
        const std::string begun = demo.line();
        EXPECT_TRUE(TcpConnection(stage_port).is_open()) << begun;
        demo.send(signal);
        demo.rest();
        EXPECT_EQ(demo.exit_code(), 130);
        EXPECT_TRUE(std::filesystem::exists(record() + "/events.jsonl"));
        EXPECT_FALSE(TcpConnection(stage_port).is_open());
    }
}

TEST_F(Demo, TakesTheTwinAlongWhenItIsKilled) {
    Program demo("etalon", {"demo", "--out", record()});
    EXPECT_THAT(demo.line(), StartsWith("twin ready"));
    TcpConnection stage(stage_port);
    ASSERT_TRUE(stage.is_open());
    demo.send(SIGKILL);
    EXPECT_TRUE(stage.is_closed_within(std::chrono::minutes(1)));
}

TEST_F(Demo, PassesArgumentsToTheTwinAndEndsWithItsExitCode) {
    Program demo("etalon", {"demo", "--out", record(), "--", "--sed", "3"});
    EXPECT_THAT(demo.rest(), HasSubstr("--sed"));
    EXPECT_EQ(demo.exit_code(), 3);
    EXPECT_FALSE(std::filesystem::exists(record()));
}

}  // namespace
}  // namespace etalon
