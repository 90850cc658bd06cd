// `etalon stage` on a simulated stage behind a real server.
#include <atomic>
#include <future>

#include "mocks/stage/room_sensor_server.h"
#include "station/devices/commands.h"
#include "station/qualify/runner.h"
#include "tests/loopback/program.h"
#include "tests/loopback/stage_rig.h"
#include "tests/station/built_program.h"

namespace etalon {
namespace {

const char* const tacit = R"(etalon: stage-profile/1
name: tacit
extends: generic
signals: {homed: unavailable}
sequences:
  home: [{set: home}, {wait: [not moving], within_ms: 60000, for_ms: 100}, {clear: home}]
  move: [{require: [enabled, not moving]}, {write: target}, {set: start}, {wait: done}]
)";

class StageCommand : public testing::Test {
protected:
    StageCommand() {
        arguments.station = folder.path() / "station.yaml";
        arguments.yes = true;
        write_text(arguments.station,
                   station_of(rig, "  forbidden: [{name: lens, x: [300, 400]}]\n"));
    }

    // The exit code; what was printed is in `printed`.
    int run(int (*command)(const StageArguments&), std::vector<std::string> targets = {}) {
        arguments.targets = std::move(targets);
        const Finished done = finished([&] { return command(arguments); });
        printed = done.out;
        return done.exit_code;
    }

    bool tells(const std::string& part) const { return printed.find(part) != std::string::npos; }

    TemporaryFolder folder;
    StageRig rig;
    StageArguments arguments;
    std::string printed;
};

TEST_F(StageCommand, HomesMovesJogsAndStops) {
    EXPECT_EQ(run(run_stage_status), 0);
    EXPECT_TRUE(tells("off, not homed")) << printed;
    EXPECT_EQ(run(run_stage_home), 0);
    EXPECT_EQ(run(run_stage_move, {"x=12.5"}), 0);
    EXPECT_TRUE(tells("12.5000 mm   enabled, homed, in position")) << printed;
    EXPECT_EQ(run(run_stage_jog, {"x=-0.5", "rz=3"}), 0);
    EXPECT_TRUE(tells("12.0000 mm") && tells("3.0000 deg")) << printed;
    EXPECT_NEAR(rig.simulation.true_positions()[0], 12.0, 1e-4);
    EXPECT_EQ(run(run_stage_stop), 0);
    EXPECT_FALSE(rig.simulation.is_moving());
}

TEST_F(StageCommand, MovesNothingThatIsNotHomed) {
    EXPECT_THROW(run(run_stage_move, {"x=12.5"}), DeviceError);
    EXPECT_THROW(run(run_stage_jog, {"x=1"}), DeviceError);
    EXPECT_TRUE(rig.server->writes().empty());
}

// Without the controller's word it takes the operator's: --homed.
TEST_F(StageCommand, MovesAxesThatDoNotTellOnTheOperatorsWord) {
    const std::string profile = (folder.path() / "tacit.yaml").string();
    write_text(profile, tacit);
    write_text(arguments.station, station_of(rig, "  profile: " + profile + "\n"));
    EXPECT_EQ(run(run_stage_home), 0);
    EXPECT_THROW(run(run_stage_move, {"x=12.5"}), DeviceError);
    EXPECT_EQ(rig.count_writes(start_bit), 0);
    arguments.homed = true;
    EXPECT_EQ(run(run_stage_move, {"x=12.5"}), 0);
    EXPECT_NEAR(rig.simulation.true_positions()[0], 12.5, 1e-4);
}

TEST_F(StageCommand, KeepsToTheStationsRules) {
    run(run_stage_home);
    EXPECT_THROW(run(run_stage_move, {"x=350"}), ConfigError);
    EXPECT_THROW(run(run_stage_move, {"x=500"}), ConfigError);  // the lens is in the way
    EXPECT_THROW(run(run_stage_move, {"x=-8"}), ConfigError);
    EXPECT_EQ(rig.count_writes(start_bit), 0);
}

TEST_F(StageCommand, AsksBeforeHoming) {
    arguments.yes = false;  // and no terminal to ask on
    EXPECT_ANY_THROW(run(run_stage_home));
    EXPECT_TRUE(rig.server->writes().empty());
}

TEST_F(StageCommand, TracesWhatItReadsAndWritesNothing) {
    arguments.polls = 3;
    EXPECT_EQ(run(run_stage_trace), 0);
    EXPECT_EQ(std::ranges::count(printed, '\n'), 3);
    EXPECT_TRUE(tells("unit 1: read registers 0..7 = 0000 0000")) << printed;
    EXPECT_TRUE(rig.server->writes().empty());
}

// ---- room sensor

// The sensor of the twin as a station names it.
RoomSensor sensor_at(int port) {
    return {
        .link = {.address = TcpAddress{"127.0.0.1", port}, .unit = 7, .response_timeout = 200ms},
        .temperature_c = {.scale = 0.01, .possible = {-40.0, 85.0}},
        .humidity_percent = SensorRegister{
            .address = 1, .type = NumberType::uint16, .scale = 0.1, .possible = {0.0, 100.0}}};
}

std::string failure(const std::function<ClimateReading()>& read) {
    return device_error_of([&] { read(); });
}

// A quarter of the period after the start the sine is at its top.
TEST(RoomSensor, ReadsWhatTheRoomIs) {
    VirtualClock room_time;
    const RoomSensorServer server({-3.25, 0.5, 60.0, 47.3}, room_time);
    SteadyClock clock;
    const auto read = room_sensor(sensor_at(server.port()), clock);
    EXPECT_NEAR(read().temperature_c, -3.25, 0.005001);
    room_time.wait_for(15s, {});
    const ClimateReading reading = read();
    EXPECT_NEAR(reading.temperature_c, -2.75, 0.005001);
    EXPECT_NEAR(reading.humidity_percent.value(), 47.3, 1e-9);
}

TEST(RoomSensor, SaysWhichSensorDoesNotAnswer) {
    VirtualClock room_time;
    RoomSensorServer server({}, room_time);
    SteadyClock clock;
    const auto read = room_sensor(sensor_at(server.port()), clock);
    EXPECT_EQ(failure(read), "no error");
    server.fall_silent();
    EXPECT_THAT(failure(read), HasSubstr("room sensor 127.0.0.1"));
}

TEST(RoomSensor, DoesNotBelieveWhatNoRoomHas) {
    VirtualClock room_time;
    const RoomSensorServer server({.temperature_c = 120.0}, room_time);
    SteadyClock clock;
    EXPECT_THAT(failure(room_sensor(sensor_at(server.port()), clock)),
                HasSubstr("read register 0: 120 is not"));
}

TEST(RoomSensor, IsRefusedByADeviceThatHasNoSuchRegister) {
    VirtualClock room_time;
    const RoomSensorServer server({}, room_time);
    SteadyClock clock;
    RoomSensor wrong = sensor_at(server.port());
    wrong.temperature_c.address = 2;
    EXPECT_THAT(failure(room_sensor(wrong, clock)), HasSubstr("read register 2"));
}

// ---- killed program

// What becomes of a motion when the program that commanded it is killed or told to end: the real
// `etalon stage move` against a controller behind a real server.

constexpr int interrupted = 130;  // the program's exit code

const std::string without_watchdog = R"(etalon: stage-profile/1
name: forgetful
extends: generic
watchdog: ~
)";

class KilledProgram : public testing::Test {
protected:
    // The controller of this profile, its axes homed, and the station's file.
    void start_rig(const std::string& profile) {
        rig = std::make_unique<StageRig>(2s, Wire::tcp, named_stage_profile(profile));
        rig->connect_and_home();
        write_text(station(), station_of(*rig, "  profile: " + profile + "\n"));
        rig->server->set_script([this](const ModbusRequest& request) { return watch(request); });
    }

    std::string forgetful_profile() const {
        write_text(folder / "forgetful.yaml", without_watchdog);
        return (folder / "forgetful.yaml").string();
    }

    std::filesystem::path station() const { return folder / "station.yaml"; }
    std::vector<std::string> move_to(const std::string& x) const {
        return {"stage", "move", station().string(), "x=" + x};
    }

    bool is_under_way() {
        return under_way_.get_future().wait_for(20s) == std::future_status::ready;
    }

    // Until nothing moves, but not longer than `limit`.
    Duration time_until_rest(Duration limit) {
        const Instant begin = rig->clock.now();
        while (rig->simulation.is_moving() && rig->clock.now() - begin < limit)
            rig->clock.wait_for(2ms, {});
        return rig->clock.now() - begin;
    }

    // Told to stop, and seen to rest in three polls, before the program was gone.
    void expect_stopped_and_confirmed() {
        EXPECT_FALSE(rig->simulation.is_moving());
        EXPECT_LT(rig->simulation.true_positions()[0], 600.0);
        EXPECT_EQ(rig->simulation.status()[0].alarm, 0) << "not by the watchdog";
        EXPECT_GE(polls_at_rest_, 3);
    }

    TemporaryFolder folder;
    std::unique_ptr<StageRig> rig;

private:
    // On the server's thread.
    ModbusReaction watch(const ModbusRequest& request) {
        if (!told_ && rig->is_beyond(20.0)) {
            told_ = true;
            under_way_.set_value();
        }
        stopped_ = stopped_ || gives(request, stop_bit);
        if (stopped_ && request.address == 0 && !rig->simulation.is_moving())
            ++polls_at_rest_;
        return {};
    }

    std::promise<void> under_way_;
    bool told_ = false, stopped_ = false;
    std::atomic<int> polls_at_rest_ = 0;
};

TEST_F(KilledProgram, LeavesTheAxesToTheWatchdogWhichStopsThem) {
    start_rig("generic");
    Program program("etalon", move_to("690"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(SIGKILL);
    EXPECT_EQ(program.exit_code(), -1);
    EXPECT_TRUE(rig->simulation.is_moving());
    // 1500 ms after it was last written, looked at every 10 ms; ramps of 50 ms; a busy machine.
    const Duration took = time_until_rest(5s);
    EXPECT_LT(took, 1500ms + 10ms + 50ms + 500ms);
    EXPECT_EQ(rig->simulation.status()[0].alarm, StageAlarm::watchdog);
    EXPECT_LT(rig->simulation.true_positions()[0], 600.0);
    fmt::print("killed in mid move: at rest {:.0f} ms later, {:.0f} mm before the target\n",
               std::chrono::duration<double, std::milli>(took).count(),
               690.0 - rig->simulation.true_positions()[0]);
}

TEST_F(KilledProgram, IsOutlivedByAMotionWithoutAWatchdogAndTheCheckSaysSo) {
    const std::string profile = forgetful_profile();
    start_rig(profile);
    Program program("etalon", move_to("400"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(SIGKILL);
    program.exit_code();
    time_until_rest(5s);
    EXPECT_NEAR(rig->simulation.true_positions()[0], 400.0, 1e-3) << "all the way";
    EXPECT_EQ(rig->simulation.status()[0].alarm, 0);

    Program check("etalon", {"stage", "check", profile});
    const std::string text = check.rest();
    EXPECT_NE(text.find("watchdog: none: axes that move go on when this program is killed"),
              std::string::npos)
        << text;
    EXPECT_EQ(check.exit_code(), 0);
}

// As a suspended machine is to its controller: nobody writes its watchdog.
TEST_F(KilledProgram, ThatWasOnlyFrozenFindsItsAxesStoppedAndSaysSo) {
    start_rig("generic");
    Program program("etalon", move_to("690"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(SIGSTOP);
    time_until_rest(5s);
    EXPECT_EQ(rig->simulation.status()[0].alarm, StageAlarm::watchdog);
    program.send(SIGCONT);
    const std::string text = program.rest();
    EXPECT_NE(text.find("alarm 3 (watchdog expired while moving)"), std::string::npos) << text;
    EXPECT_EQ(program.exit_code(), 4);
    EXPECT_LT(rig->simulation.true_positions()[0], 600.0);
}

TEST_F(KilledProgram, ThatWasOnlyFrozenFindsItsAxesAtTheTargetWithoutAWatchdog) {
    start_rig(forgetful_profile());
    Program program("etalon", move_to("400"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(SIGSTOP);
    time_until_rest(5s);
    program.send(SIGCONT);
    const std::string text = program.rest();
    EXPECT_NE(text.find("400.0000 mm"), std::string::npos) << text;
    EXPECT_EQ(program.exit_code(), 0);
}

class ToldToEnd : public KilledProgram, public testing::WithParamInterface<int> {};

TEST_P(ToldToEnd, StopsTheAxesAndHasItConfirmedBeforeItEnds) {
    start_rig("generic");
    Program program("etalon", move_to("690"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(GetParam());
    EXPECT_EQ(program.exit_code(), interrupted);
    expect_stopped_and_confirmed();
}

INSTANTIATE_TEST_SUITE_P(Signals, ToldToEnd, testing::Values(SIGTERM, SIGINT, SIGQUIT, SIGHUP),
                         [](const auto& signal) {
                             return std::string("Sig") + sigabbrev_np(signal.param);
                         });

TEST_F(KilledProgram, StopsTheAxesAndHasItConfirmedWhenItsTerminalIsClosed) {
    start_rig("generic");
    const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    ASSERT_TRUE(grantpt(terminal) == 0 && unlockpt(terminal) == 0);
    Program program("etalon", move_to("690"), ptsname(terminal));
    ASSERT_TRUE(is_under_way());
    close(terminal);
    EXPECT_EQ(program.exit_code(), interrupted);
    expect_stopped_and_confirmed();
}

}  // namespace
}  // namespace etalon
