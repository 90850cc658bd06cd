// `etalon stage` on a simulated stage behind a real server.
#include "station/devices/commands.h"
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

}  // namespace
}  // namespace etalon
