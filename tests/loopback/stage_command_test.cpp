// `etalon stage` on a simulated stage behind a real server.
#include "mocks/stage/room_sensor_server.h"
#include "station/devices/commands.h"
#include "station/qualify/runner.h"
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

}  // namespace
}  // namespace etalon
