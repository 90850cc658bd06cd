// Scripted faults of the simulated stage: each by name, by each kind of trigger.

#include "mocks/stage/simulated_stage.h"
#include "tests/mocks/stage/two_axes.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Kind = StageFault::Kind;
using When = FaultTrigger::When;

// Enabled and homed at 1 s after power-on.
struct FaultyStageRig {
    explicit FaultyStageRig(std::vector<StageFault> faults)
        : stage(two_axes(), {.faults = std::move(faults)}, clock) {
        stage.enable(true);
        stage.home();
        clock.advance(1s);
    }
    void start(double x, double y) { stage.start({x, y}, {100.0, 30.0}); }
    AxisStatus x() { return stage.status()[0]; }
    AxisStatus y() { return stage.status()[1]; }

    VirtualClock clock;
    SimulatedStage stage;
};

// Half a ramp is lost at the start: 100 mm/s * (0.5 s - 25 ms) after half a second.
TEST(StageFaults, AStuckAxisStopsDeadAtItsTime) {
    FaultyStageRig rig({{.kind = Kind::stuck_axis, .at = {When::time_ms, 1500}, .axis = 0}});
    rig.start(200.0, 15.0);
    rig.clock.advance(10s);  // nobody looked in between
    EXPECT_NEAR(rig.x().position, 47.5, 1e-9);
    EXPECT_TRUE(rig.x().moving && rig.stage.is_moving());
    EXPECT_TRUE(rig.y().in_position);
    rig.stage.stop();
    EXPECT_FALSE(rig.x().moving || rig.x().in_position);
}

TEST(StageFaults, AnAxisStuckAsItsMoveStartsDoesNotStart) {
    FaultyStageRig rig({{.kind = Kind::stuck_axis, .at = {When::move, 2}, .axis = 1}});
    rig.start(20.0, 15.0);
    rig.clock.advance(10s);
    EXPECT_TRUE(rig.y().in_position);
    rig.start(7.0, 5.0);
    rig.clock.advance(10s);
    EXPECT_EQ(rig.y().position, 15.0);
    EXPECT_TRUE(rig.y().moving);
    EXPECT_EQ(rig.x().position, 7.0);
}

TEST(StageFaults, FalseInPositionLastsUntilTheNextCommand) {
    FaultyStageRig rig({{.kind = Kind::false_in_position, .at = {When::move, 1}, .axis = 0}});
    rig.start(200.0, 0.0);
    rig.clock.advance(500ms);
    EXPECT_TRUE(rig.x().in_position && !rig.x().moving);
    EXPECT_NEAR(rig.x().position, 47.5, 1e-9);
    EXPECT_TRUE(rig.stage.is_moving());
    rig.stage.stop();
    EXPECT_TRUE(rig.x().moving && !rig.x().in_position);
    rig.clock.advance(1s);
    EXPECT_FALSE(rig.x().moving || rig.x().in_position);
}

// The lie is not held back for the twin's picture, but the picture follows the truth, and an axis
// that rests has it awaited like any other.
TEST(StageFaults, FalseInPositionDoesNotWaitForThePictureWhichShowsWhereTheAxisTrulyIs) {
    FaultyStageRig rig({{.kind = Kind::false_in_position, .at = {When::move, 1}, .axis = 0}});
    std::vector<double> wished;
    bool finished = false;
    rig.stage.hold_in_position_until([&](const std::vector<double>& positions) {
        wished = positions;
        return finished;
    });
    rig.start(200.0, 0.0);
    rig.clock.advance(500ms);
    EXPECT_TRUE(rig.x().in_position);
    ASSERT_EQ(wished.size(), 2u);
    EXPECT_NEAR(wished[0], 47.5, 1e-9);
    rig.clock.advance(10s);
    EXPECT_FALSE(rig.x().in_position);
    EXPECT_NEAR(wished[0], 200.0, 1e-9);
    finished = true;
    EXPECT_TRUE(rig.x().in_position);
}

// Counts are lost: the move ends beside its target, later ones are off by as much without saying
// so, until homed.
TEST(StageFaults, AnEncoderJumpStaysUntilHomed) {
    FaultyStageRig rig(
        {{.kind = Kind::encoder_jump, .at = {When::time_ms, 1500}, .axis = 0, .size = 0.25}});
    rig.start(200.0, 0.0);
    rig.clock.advance(499ms);
    const double before = rig.x().position;
    rig.clock.advance(1ms);
    EXPECT_NEAR(rig.x().position - before, 0.25 + 0.1, 1e-9);
    rig.clock.advance(10s);
    EXPECT_NEAR(rig.x().position, 200.25, 1e-9);
    EXPECT_NEAR(rig.stage.true_positions()[0], 200.0, 1e-9);
    EXPECT_FALSE(rig.x().moving || rig.x().in_position);
    rig.start(50.0, 0.0);
    rig.clock.advance(10s);
    EXPECT_TRUE(rig.x().in_position);
    EXPECT_NEAR(rig.x().position, 50.0, 1e-9);
    EXPECT_NEAR(rig.stage.true_positions()[0], 49.75, 1e-9);
    rig.stage.home();
    rig.clock.advance(10s);
    rig.start(50.0, 0.0);
    rig.clock.advance(10s);
    EXPECT_NEAR(rig.stage.true_positions()[0], 50.0, 1e-9);
}

TEST(StageFaults, ALimitSwitchBrakesWithAnAlarmUntilReset) {
    FaultyStageRig rig({{.kind = Kind::limit_hit, .at = {When::time_ms, 1500}, .axis = 1}});
    rig.start(200.0, 40.0);
    rig.clock.advance(10s);
    EXPECT_TRUE(rig.y().limit && !rig.x().limit);
    EXPECT_EQ(rig.x().alarm, StageAlarm::limit);
    EXPECT_NEAR(rig.x().position, 47.5 + 2.5, 1e-9);  // v^2 / 2a further
    EXPECT_FALSE(rig.stage.is_moving());
    rig.stage.reset();
    EXPECT_FALSE(rig.y().limit || rig.y().alarm != 0);
    EXPECT_TRUE(rig.y().homed);
}

TEST(StageFaults, AnEmergencyStopStaysWhatEverIsCommanded) {
    FaultyStageRig rig({{.kind = Kind::emergency_stop, .at = {When::time_ms, 1500}}});
    rig.start(200.0, 40.0);
    rig.clock.advance(600ms);
    for (const AxisStatus& axis : rig.stage.status()) {
        EXPECT_TRUE(axis.emergency_stop);
        EXPECT_FALSE(axis.enabled || axis.homed || axis.moving || axis.ready);
        EXPECT_EQ(axis.alarm, StageAlarm::emergency_stop);
    }
    rig.stage.reset();
    rig.stage.enable(true);
    rig.stage.home();
    EXPECT_FALSE(rig.x().enabled || rig.stage.is_moving());
    EXPECT_EQ(rig.x().alarm, StageAlarm::emergency_stop);
    rig.stage.press_emergency_stop(false);
    EXPECT_EQ(rig.x().alarm, StageAlarm::emergency_stop);
    rig.stage.reset();
    rig.stage.enable(true);
    rig.stage.home();
    rig.clock.advance(10s);
    EXPECT_TRUE(rig.x().homed && rig.x().enabled && rig.x().alarm == 0);
}

TEST(StageFaults, HappenWithARequestOrAWriteToARegister) {
    FaultyStageRig rig({{.kind = Kind::alarm, .at = {When::request, 3}, .axis = 0, .code = 21},
                        {.kind = Kind::alarm, .at = {When::write_to, 200}, .axis = 1, .code = 22}});
    rig.stage.notice_request(0, 0);
    rig.stage.notice_request(100, 100);  // up to 199
    EXPECT_EQ(rig.x().alarm, 0);
    rig.stage.notice_request(0, 0);
    EXPECT_EQ(rig.x().alarm, 21);
    rig.stage.reset();
    rig.stage.notice_request(199, 2);
    EXPECT_EQ(rig.x().alarm, 22);
    rig.stage.reset();
    rig.stage.notice_request(200, 1);  // only once
    EXPECT_EQ(rig.x().alarm, 0);
}

TEST(StageFaults, HappenInTheOrderOfTheirTimes) {
    FaultyStageRig rig({{.kind = Kind::alarm, .at = {When::time_ms, 1700}, .code = 32},
                        {.kind = Kind::alarm, .at = {When::time_ms, 1500}, .code = 31}});
    rig.start(200.0, 40.0);
    rig.clock.advance(10s);
    EXPECT_EQ(rig.x().alarm, 31);
    EXPECT_NEAR(rig.x().position, 50.0, 1e-9);
}

}  // namespace
}  // namespace etalon
