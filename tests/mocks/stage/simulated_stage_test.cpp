#include "mocks/stage/simulated_stage.h"

#include "mocks/stage/simulated_axis.h"
#include "stage/motion/modbus_stage.h"
#include "tests/fakes/memory_transport.h"
#include "tests/fakes/test_axes.h"
#include "tests/test.h"

namespace etalon {
namespace {

struct StageRig {
    explicit StageRig(SimulatedStageOptions options = {}) : stage(two_axes(), options, clock) {}

    void enable_and_home() {
        stage.enable(true);
        stage.home();
        clock.advance(1s);
    }
    void start(double x, double y) { stage.start({x, y}, {100.0, 30.0}); }
    void move(double x, double y) {
        start(x, y);
        clock.advance(20s);
    }
    AxisStatus x() { return stage.status()[0]; }
    AxisStatus y() { return stage.status()[1]; }

    VirtualClock clock;
    SimulatedStage stage;
};

// Enabled and homed at 1 s after power-on.
struct HomedRig : StageRig {
    explicit HomedRig(const SimulatedStageOptions& options = {}) : StageRig(options) {
        enable_and_home();
    }
};

TEST(SimulatedStage, MovesEachAxisAtItsSpeed) {
    HomedRig rig;
    rig.start(200.0, 15.0);
    rig.clock.advance(500ms);
    auto status = rig.stage.status();
    // Half a ramp of 50 ms is lost at the start.
    EXPECT_NEAR(status[0].position, 100.0 * (0.5 - 0.025), 1e-9);
    EXPECT_NEAR(status[1].position, 30.0 * (0.5 - 0.025), 1e-9);
    EXPECT_TRUE(status[0].moving);
    EXPECT_FALSE(status[0].in_position);
    rig.clock.advance(60ms);  // y: 0.5 s + one ramp
    status = rig.stage.status();
    EXPECT_EQ(status[1].position, 15.0);
    EXPECT_TRUE(status[1].in_position);
    EXPECT_TRUE(status[0].moving);
    rig.clock.advance(2s);
    EXPECT_EQ(rig.x().position, 200.0);
    EXPECT_FALSE(rig.stage.is_moving());
}

TEST(SimulatedStage, HomingTakesTimeAndEndsAtZero) {
    StageRig rig({.homing = 700ms, .power_on_position = {11.0, -13.0}});
    rig.stage.enable(true);
    EXPECT_FALSE(rig.x().homed);
    rig.stage.home();
    rig.clock.advance(699ms);
    EXPECT_FALSE(rig.x().homed);
    EXPECT_TRUE(rig.x().moving);
    rig.clock.advance(2ms);
    for (const AxisStatus& axis : rig.stage.status()) {
        EXPECT_TRUE(axis.homed && !axis.moving && axis.in_position);
        EXPECT_EQ(axis.position, 0.0);
    }
}

TEST(SimulatedStage, HomingThatIsStoppedDoesNotCount) {
    StageRig rig;
    rig.stage.enable(true);
    rig.stage.home();
    rig.clock.advance(50ms);
    rig.stage.stop();
    rig.clock.advance(5s);
    EXPECT_FALSE(rig.x().homed);
}

TEST(SimulatedStage, StopBrakesAtOnce) {
    HomedRig rig;
    rig.start(200.0, 0.0);
    rig.clock.advance(500ms);
    rig.stage.stop();
    EXPECT_TRUE(rig.stage.is_moving());
    rig.clock.advance(51ms);
    EXPECT_FALSE(rig.stage.is_moving());
    // 47.5 mm so far, then v^2 / 2a = 100^2 / 4000 = 2.5 mm.
    EXPECT_NEAR(rig.x().position, 50.0, 1e-9);
    EXPECT_FALSE(rig.x().in_position);
}

TEST(SimulatedStage, IsTrulyWhereScaleAndBacklashPutIt) {
    HomedRig rig({.errors = {{.scale = 0.002, .backlash = 0.03}, {.scale = -0.001}}});
    rig.move(100.0, 50.0);
    EXPECT_NEAR(rig.stage.true_positions()[0], 100.2, 1e-9);
    EXPECT_NEAR(rig.stage.true_positions()[1], 49.95, 1e-9);
    rig.move(40.0, 50.0);  // x from above
    EXPECT_NEAR(rig.stage.true_positions()[0], 40.08 + 0.03, 1e-9);
    EXPECT_EQ(rig.x().position, 40.0);
}

TEST(SimulatedStage, NeverJumpsWhenTheErrorsChange) {
    HomedRig rig({.errors = {{.scale = 0.0, .repeatability = 0.5, .backlash = 0.3}, {}}});
    rig.move(100.0, 0.0);
    const double before = rig.stage.true_positions()[0];
    rig.start(60.0, 0.0);
    EXPECT_NEAR(rig.stage.true_positions()[0], before, 1e-9);
    rig.clock.advance(200ms);
    const double midway = rig.stage.true_positions()[0];
    rig.stage.stop();
    EXPECT_NEAR(rig.stage.true_positions()[0], midway, 1e-9);
}

// The standard deviation of n = 400 draws has a relative standard error of 1 / sqrt(2 n) = 3.5 %,
// their mean one of sigma / sqrt(n) = 5 %: four of each.
TEST(SimulatedStage, RepeatsWithTheDeclaredStandardDeviation) {
    HomedRig rig({.errors = {{.repeatability = 0.007}, {}}, .seed = 5});
    double sum = 0.0, squares = 0.0;
    for (int i = 0; i < 400; ++i) {
        rig.move(i % 2 == 0 ? 50.0 : 30.0, 0.0);
        const double error = rig.stage.true_positions()[0] - (i % 2 == 0 ? 50.0 : 30.0);
        sum += error;
        squares += error * error;
    }
    EXPECT_NEAR(sum / 400, 0.0, 4 * 0.007 * 0.05);
    EXPECT_NEAR(std::sqrt(squares / 400), 0.007, 4 * 0.007 * 0.035);
}

TEST(SimulatedStage, TheSameSeedGivesTheSameErrors) {
    SimulatedStageOptions options{.errors = {{.repeatability = 0.007}, {.repeatability = 0.005}},
                                  .seed = 11};
    StageRig one(options), same(options);
    options.seed = 12;
    StageRig other(options);
    for (StageRig* rig : {&one, &same, &other}) {
        rig->enable_and_home();
        rig->move(7.0, 5.0);
    }
    EXPECT_EQ(one.stage.true_positions(), same.stage.true_positions());
    EXPECT_NE(one.stage.true_positions(), other.stage.true_positions());
}

TEST(SimulatedStage, RefusesWhatAControllerRefuses) {
    const auto alarm_after = [](auto act) {
        StageRig rig;
        act(rig);
        EXPECT_FALSE(rig.stage.true_positions()[0] != 0.0);
        return rig.x().alarm;
    };
    const auto start = [](StageRig& rig, double x, double speed) {
        rig.stage.start({x, 0.0}, {speed, 30.0});
    };
    EXPECT_EQ(alarm_after([&](StageRig& rig) { start(rig, 7.0, 100.0); }), StageAlarm::not_ready);
    EXPECT_EQ(alarm_after([&](StageRig& rig) { rig.stage.home(); }), StageAlarm::not_ready);
    const auto alarm_once_homed = [&](double x, double speed) {
        return alarm_after([&](StageRig& rig) {
            rig.enable_and_home();
            start(rig, x, speed);
        });
    };
    EXPECT_EQ(alarm_once_homed(501.0, 100.0), StageAlarm::outside_travel);
    EXPECT_EQ(alarm_once_homed(7.0, 200.0), StageAlarm::outside_travel);
    EXPECT_EQ(alarm_once_homed(7.0, 100.0), StageAlarm::none);
}

TEST(SimulatedStage, AnAlarmBrakesAndStaysUntilReset) {
    HomedRig rig;
    rig.start(200.0, 0.0);
    rig.clock.advance(500ms);
    rig.stage.raise_alarm(17);
    rig.clock.advance(51ms);
    EXPECT_FALSE(rig.stage.is_moving());
    EXPECT_EQ(rig.y().alarm, 17);
    rig.start(7.0, 0.0);
    EXPECT_FALSE(rig.stage.is_moving());
    EXPECT_EQ(rig.y().alarm, 17);
    rig.stage.reset();
    EXPECT_EQ(rig.y().alarm, 0);
    rig.start(7.0, 0.0);
    EXPECT_TRUE(rig.stage.is_moving());
}

TEST(SimulatedStage, AJammedAxisClaimsToMoveUntilStopped) {
    HomedRig rig;
    rig.start(200.0, 7.0);
    rig.clock.advance(500ms);
    rig.stage.jam(0);
    rig.clock.advance(20s);
    const auto status = rig.stage.status();
    EXPECT_TRUE(status[0].moving);
    EXPECT_NEAR(status[0].position, 47.5, 1e-9);
    EXPECT_TRUE(status[1].in_position);
    rig.stage.stop();
    EXPECT_FALSE(rig.stage.is_moving());
    rig.start(200.0, 7.0);
    rig.clock.advance(20s);
    EXPECT_TRUE(rig.stage.is_moving());
    rig.stage.stop();
    rig.stage.jam(0, false);
    rig.move(200.0, 7.0);
    EXPECT_EQ(rig.x().position, 200.0);
}

// A ramp of 50 ms whose acceleration builds up in 20 ms: 0.5 s at 30 mm/s and 70 ms of ramp.
TEST(SimulatedStage, MovesByAnSCurveWhenTheJerkIsLimited) {
    HomedRig rig({.jerk = 20ms});
    rig.start(0.0, 15.0);
    rig.clock.advance(20ms);  // j t^3 / 6 = 600 mm/s^2 / 20 ms * (20 ms)^3 / 6
    EXPECT_NEAR(rig.y().position, 600.0 * 0.02 * 0.02 / 6.0, 1e-12);
    rig.clock.advance(549ms);
    EXPECT_TRUE(rig.y().moving);
    rig.clock.advance(2ms);
    EXPECT_TRUE(rig.y().in_position);
    EXPECT_EQ(rig.y().position, 15.0);
}

// The plan stops from 30 mm/s within 1 ms around 500.5 ms. A loop of w rad/s with damping 1 is
// then behind by (v / w) (2 + w s) exp(-w s), s seconds later.
TEST(SimulatedStage, IsInPositionOnceTheServoHasSettled) {
    HomedRig rig(
        {.ramp = 1ms,
         .servos = {std::nullopt, AxisServo{{.bandwidth_hz = 5.0, .damping = 1.0}, 0.01}}});
    rig.start(0.0, 15.0);
    const double w = 10.0 * std::numbers::pi;
    const auto behind = [&](double s) { return 30.0 / w * (2.0 + w * s) * std::exp(-w * s); };
    rig.clock.advance(502ms);
    EXPECT_FALSE(rig.y().moving || rig.y().in_position);
    EXPECT_NEAR(rig.y().position, 15.0 - behind(1.5e-3), 1e-4);
    int settled_ms = 2;
    while (behind(settled_ms * 1e-3 - 0.5e-3) > 0.01)
        ++settled_ms;
    rig.clock.advance(std::chrono::milliseconds(settled_ms - 2 - 2));
    EXPECT_FALSE(rig.y().in_position);
    rig.clock.advance(3ms);
    EXPECT_TRUE(rig.y().in_position);
    EXPECT_EQ(rig.stage.target()[1], 15.0);
    EXPECT_TRUE(rig.x().in_position);
}

TEST(SimulatedStage, ANewCommandTakesTheServoAsItIs) {
    HomedRig rig(
        {.jerk = 10ms,
         .servos = {AxisServo{{.bandwidth_hz = 9.0, .resonance_hz = 14.0}, 0.01}, std::nullopt}});
    rig.start(100.0, 0.0);
    rig.clock.advance(300ms);
    for (int i = 0; i < 3; ++i) {  // stopped while it stops
        const double truth = rig.stage.true_positions()[0], read = rig.x().position;
        rig.stage.stop();
        EXPECT_NEAR(rig.stage.true_positions()[0], truth, 1e-9);
        EXPECT_NEAR(rig.x().position, read, 1e-9);
        rig.clock.advance(7ms);
        // At no more than 100 mm/s and its ringing.
        EXPECT_NEAR(rig.stage.true_positions()[0], truth, 7e-3 * 130.0);
    }
    rig.clock.advance(20s);
    EXPECT_NEAR(rig.stage.true_positions()[0], rig.x().position, 1e-9);
}

TEST(SimulatedStage, EachControllerDrivesItsOwnAxes) {
    std::vector<Axis> axes = two_axes();
    axes.push_back({.name = "z", .low = -5.0, .high = 7.0, .speed = 10.0});
    axes[1].unit = axes[2].unit = 3;
    VirtualClock clock;
    SimulatedStage stage(axes, {}, clock);
    ASSERT_EQ(stage.controllers().size(), 2U);
    EXPECT_EQ(stage.controllers()[1].unit, 3);
    EXPECT_EQ(stage.controllers()[1].first, 1U);
    EXPECT_EQ(stage.controllers()[1].count, 2U);
    stage.enable(true, 1);
    stage.home(1);
    clock.advance(1s);
    stage.start({15.0, -3.0}, {30.0, 10.0}, 1);
    clock.advance(100ms);
    EXPECT_TRUE(stage.is_moving(1) && stage.is_moving());
    EXPECT_FALSE(stage.is_moving(0) || stage.status()[0].enabled || stage.status()[0].homed);
    stage.start({5.0}, {100.0}, 0);  // not enabled: its own alarm, and the others go on
    clock.advance(5s);
    EXPECT_EQ(stage.status()[0].alarm, StageAlarm::not_ready);
    EXPECT_EQ(stage.status()[2].alarm, StageAlarm::none);
    EXPECT_EQ(stage.status()[1].position, 15.0);
    EXPECT_EQ(stage.status()[2].position, -3.0);
    EXPECT_EQ(stage.moves_started(), 1);
}

TEST(SimulatedStage, TellsReadyAndHoming) {
    StageRig rig;
    EXPECT_FALSE(rig.x().ready);
    rig.stage.enable(true);
    EXPECT_TRUE(rig.x().ready);
    rig.stage.home();
    rig.clock.advance(100ms);
    EXPECT_TRUE(rig.x().homing && !rig.x().ready);
    rig.clock.advance(200ms);
    EXPECT_TRUE(!rig.x().homing && rig.x().ready);
    rig.stage.raise_alarm(17);
    EXPECT_FALSE(rig.x().ready);
}

TEST(SimulatedStage, HoldsInPositionUntilThePictureIsReady) {
    HomedRig rig({.errors = {{.scale = 0.01}, {}}});
    bool ready = false;
    std::vector<double> asked;
    rig.stage.hold_in_position_until([&](const std::vector<double>& truth) {
        asked = truth;
        return ready;
    });
    rig.start(100.0, 5.0);
    rig.clock.advance(100ms);
    rig.stage.status();
    EXPECT_TRUE(asked.empty()) << "asked while moving";
    rig.clock.advance(10s);
    EXPECT_FALSE(rig.x().in_position);
    ASSERT_EQ(asked.size(), 2U);
    EXPECT_NEAR(asked[0], 101.0, 1e-9);
    ready = true;
    EXPECT_TRUE(rig.x().in_position);
}

TEST(SimulatedStage, RefusesOptionsThatDoNotFit) {
    VirtualClock clock;
    const auto refused = [&](auto change) {
        SimulatedStageOptions options;
        options.errors = {{}, {}};
        options.servos.resize(2);
        change(options);
        EXPECT_THROW(SimulatedStage(two_axes(), options, clock), ConfigError);
    };
    refused([](auto& options) { options.errors.pop_back(); });
    refused([](auto& options) { options.power_on_position = {501.0, 0.0}; });
    refused([](auto& options) { options.ramp = 0ms; });
    refused([](auto& options) { options.jerk = -1ms; });
    refused([](auto& options) { options.servos = {std::nullopt}; });
    refused([](auto& options) { options.servos[1] = AxisServo{.window = 0.0}; });
    refused([](auto& options) { options.temperature.time_constant = 0.0; });
    refused([](auto& options) { options.errors[0].backlash = -0.1; });
    refused([](auto& options) { options.errors[1].period = 0.0; });
    refused([](auto& options) { options.errors[1].lean = {1e-3}; });
    refused([](auto& options) { options.errors[1].lean = {1e-3, 1e-3}; });
    refused([](auto& options) { options.faults = {{.axis = 2}}; });
    refused([](auto& options) { options.faults = {{.kind = StageFault::Kind::alarm}}; });
}

// ---- scripted faults: each by name, by each kind of trigger

using Kind = StageFault::Kind;
using When = FaultTrigger::When;

// Half a ramp is lost at the start: 100 mm/s * (0.5 s - 25 ms) after half a second.
TEST(StageFaults, AStuckAxisStopsDeadAtItsTime) {
    HomedRig rig({.faults = {{.kind = Kind::stuck_axis, .at = {When::time_ms, 1500}, .axis = 0}}});
    rig.start(200.0, 15.0);
    rig.clock.advance(10s);  // nobody looked in between
    EXPECT_NEAR(rig.x().position, 47.5, 1e-9);
    EXPECT_TRUE(rig.x().moving && rig.stage.is_moving());
    EXPECT_TRUE(rig.y().in_position);
    rig.stage.stop();
    EXPECT_FALSE(rig.x().moving || rig.x().in_position);
}

TEST(StageFaults, AnAxisStuckAsItsMoveStartsDoesNotStart) {
    HomedRig rig({.faults = {{.kind = Kind::stuck_axis, .at = {When::move, 2}, .axis = 1}}});
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
    HomedRig rig({.faults = {{.kind = Kind::false_in_position, .at = {When::move, 1}, .axis = 0}}});
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
    HomedRig rig({.faults = {{.kind = Kind::false_in_position, .at = {When::move, 1}, .axis = 0}}});
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
    HomedRig rig(
        {.faults = {
             {.kind = Kind::encoder_jump, .at = {When::time_ms, 1500}, .axis = 0, .size = 0.25}}});
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
    HomedRig rig({.faults = {{.kind = Kind::limit_hit, .at = {When::time_ms, 1500}, .axis = 1}}});
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
    HomedRig rig({.faults = {{.kind = Kind::emergency_stop, .at = {When::time_ms, 1500}}}});
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
    HomedRig rig(
        {.faults = {{.kind = Kind::alarm, .at = {When::request, 3}, .axis = 0, .code = 21},
                    {.kind = Kind::alarm, .at = {When::write_to, 200}, .axis = 1, .code = 22}}});
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
    HomedRig rig({.faults = {{.kind = Kind::alarm, .at = {When::time_ms, 1700}, .code = 32},
                             {.kind = Kind::alarm, .at = {When::time_ms, 1500}, .code = 31}}});
    rig.start(200.0, 40.0);
    rig.clock.advance(10s);
    EXPECT_EQ(rig.x().alarm, 31);
    EXPECT_NEAR(rig.x().position, 50.0, 1e-9);
}

// ---- stage errors

TEST(StageErrors, PeriodicErrorRepeatsWithItsPeriod) {
    const AxisErrors screw{.periodic = 0.003, .period = 2.0, .phase = 0.7};
    EXPECT_NEAR(error_at(screw, 0.0, 0.0), 0.003 * std::sin(0.7), 1e-15);
    EXPECT_NEAR(error_at(screw, 7.5, 0.0), 0.003 * std::sin(0.7 + 1.5 * std::numbers::pi), 1e-15);
    EXPECT_NEAR(error_at(screw, 7.3, 0.0), error_at(screw, -4.7, 0.0), 1e-15);
}

TEST(StageErrors, AMapIsInterpolatedAndGoesOnBeyondItsEnds) {
    AxisErrors errors;
    errors.map = ErrorMap({{-10.0, 0.002}, {0.0, -0.001}, {20.0, 0.005}}, {"map"});
    EXPECT_NEAR(error_at(errors, 5.0, 0.0), 0.0005, 1e-15);
    EXPECT_NEAR(error_at(errors, -17.0, 0.0), 0.002, 1e-15);
    EXPECT_NEAR(error_at(errors, 23.0, 0.0), 0.005, 1e-15);
}

// 3 K: 11 ppm/K of 200 mm are 6.6 um, 1.5 um/K are 4.5 um.
TEST(StageErrors, WarmthExpandsAndShifts) {
    const AxisErrors warm{.expansion = 11e-6, .drift = 1.5e-3};
    EXPECT_NEAR(error_at(warm, 200.0, 3.0), 6.6e-3 + 4.5e-3, 1e-12);
    EXPECT_NEAR(error_at(warm, -200.0, 3.0), -6.6e-3 + 4.5e-3, 1e-12);
    EXPECT_EQ(error_at(warm, 200.0, 0.0), 0.0);
}

TEST(StageErrors, TheTemperatureApproachesItsEndExponentially) {
    const StageTemperature temperature{.change = -2.5, .time_constant = 1800.0};
    EXPECT_EQ(temperature.at(0.0), 0.0);
    EXPECT_NEAR(temperature.at(1800.0), -2.5 * (1.0 - std::exp(-1.0)), 1e-12);
    EXPECT_NEAR(temperature.at(1800.0 * std::log(2.0)), -1.25, 1e-12);
    EXPECT_NEAR(temperature.at(1e6), -2.5, 1e-12);
}

TEST(StageErrors, AnAxisOutOfSquareAlsoMovesAlongAnother) {
    std::vector<AxisErrors> errors(3);
    errors[1].lean = {0.002, 0.0, -0.001};
    EXPECT_EQ(with_lean(errors, {5.0, 100.0, 7.0}), (std::vector<double>{5.2, 100.0, 6.9}));
    // Of what the axis goes, not of what others make of that.
    errors[0].lean = {0.0, 0.5, 0.0};
    EXPECT_EQ(with_lean(errors, {5.0, 100.0, 7.0}), (std::vector<double>{5.2, 102.5, 6.9}));
}

// The carriage stands still until the gap is taken up, then goes along.
TEST(StageErrors, PlayIsTakenUpOnReversal) {
    EXPECT_DOUBLE_EQ(play_after(0.0, 7.0, 0.05), 0.0);
    EXPECT_DOUBLE_EQ(play_after(0.0, -0.02, 0.05), 0.02);
    EXPECT_DOUBLE_EQ(play_after(0.02, -0.02, 0.05), 0.04);
    EXPECT_DOUBLE_EQ(play_after(0.04, -3.0, 0.05), 0.05);
    EXPECT_DOUBLE_EQ(play_after(0.05, 0.01, 0.05), 0.04);
}

// A stage of one axis of 100 mm/s, homed at 0.
struct ErringRig {
    explicit ErringRig(const AxisErrors& errors, StageTemperature temperature = {})
        : stage({{.name = "x", .low = -70.0, .high = 500.0, .speed = 100.0}},
                {.errors = {errors}, .seed = 5, .temperature = temperature}, clock) {
        stage.enable(true);
        stage.home();
        clock.advance(1s);
    }
    void move(double x) {
        stage.start({x}, {100.0});
        clock.advance(10s);
    }
    double lag() { return stage.true_positions()[0] - stage.status()[0].position; }

    VirtualClock clock;
    SimulatedStage stage;
};

TEST(StageErrors, TheCarriageStandsWhileTheGapIsTakenUp) {
    ErringRig rig({.backlash = 2.0});
    rig.move(50.0);
    EXPECT_NEAR(rig.lag(), 0.0, 1e-12);
    rig.stage.start({40.0}, {100.0});
    // After the ramp of 50 ms and 2.5 mm, at 100 mm/s.
    rig.clock.advance(30ms);
    EXPECT_NEAR(rig.stage.true_positions()[0], 50.0, 1e-12);
    rig.clock.advance(30ms);
    EXPECT_NEAR(rig.lag(), 2.0, 1e-12);
    rig.clock.advance(1s);
    EXPECT_NEAR(rig.stage.true_positions()[0], 42.0, 1e-12);
    rig.move(41.0);
    EXPECT_NEAR(rig.stage.true_positions()[0], 42.0, 1e-12);
    rig.move(43.0);
    EXPECT_NEAR(rig.stage.true_positions()[0], 43.0, 1e-12);
}

TEST(StageErrors, DriftsWhileItRests) {
    ErringRig rig({.drift = 1.5e-3}, {.change = 2.0, .time_constant = 600.0});
    rig.move(50.0);  // 11 s after power-on
    EXPECT_NEAR(rig.lag(), 3e-3 * (1.0 - std::exp(-11.0 / 600.0)), 1e-12);
    rig.clock.advance(600s);
    EXPECT_NEAR(rig.lag(), 3e-3 * (1.0 - std::exp(-611.0 / 600.0)), 1e-12);
    EXPECT_TRUE(rig.stage.status()[0].in_position);
}

// Of n = 1000 readings the standard deviation is known to 1 / sqrt(2 n) = 2.2 %, the mean to
// sigma / sqrt(n) = 3.2 % of it: four of each. Neighbours are independent: correlation 4 / sqrt(n).
TEST(StageErrors, TheEncoderIsNoisyAndTheCarriageIsNot) {
    ErringRig rig({.encoder_noise = 0.002});
    rig.move(50.0);
    double sum = 0.0, squares = 0.0, products = 0.0, last = 0.0;
    constexpr int n = 1000;
    for (int i = 0; i < n; ++i) {
        rig.clock.advance(5ms);
        const AxisStatus status = rig.stage.status()[0];
        const double noise = status.position - 50.0;
        EXPECT_TRUE(status.in_position);
        EXPECT_EQ(rig.stage.true_positions()[0], 50.0);
        sum += noise;
        squares += noise * noise;
        products += noise * last;
        last = noise;
    }
    EXPECT_NEAR(sum / n, 0.0, 0.002 * 4 * 0.032);
    EXPECT_NEAR(std::sqrt(squares / n), 0.002, 0.002 * 4 * 0.022);
    EXPECT_NEAR(products / squares, 0.0, 4 * 0.032);
}

TEST(StageErrors, ReadingsAtOneInstantAgreeAndSeedsDiffer) {
    ErringRig rig({.encoder_noise = 0.002}), same({.encoder_noise = 0.002});
    EXPECT_EQ(rig.stage.status()[0].position, rig.stage.status()[0].position);
    EXPECT_EQ(rig.stage.status()[0].position, same.stage.status()[0].position);
    SimulatedStage other({{.name = "x", .low = -70.0, .high = 500.0, .speed = 100.0}},
                         {.errors = {{.encoder_noise = 0.002}}, .seed = 6}, rig.clock);
    EXPECT_NE(rig.stage.status()[0].position, other.status()[0].position);
}

// ---- stage physics

// The station's own client against a stage that moves, errs and fails as twin.yaml can say, in
// memory and on virtual time.

struct PhysicsRig {
    explicit PhysicsRig(const SimulatedStageOptions& options)
        : simulation(two_axes(), options, clock) {
        stage->enable({});
        stage->home({});
    }
    void move(double x, double y) { stage->move(std::vector<double>{x, y}, {}); }
    double x_error(double x) { return std::abs(simulation.true_positions()[0] - x); }

    VirtualClock clock;
    StageProfile profile = builtin_stage_profile("generic");
    SimulatedStage simulation;
    ModbusController controller{simulation, profile};
    std::unique_ptr<Stage> stage =
        open_modbus_stage({}, profile, two_axes(), clock,
                          std::make_unique<MemoryTransport>(controller, clock, false));
};

// The plan ends after 0.55 s; the motor needs its time to come within the profile's 1 um.
TEST(StagePhysics, TheStationWaitsForTheServo) {
    PhysicsRig rig(
        {.jerk = 20ms,
         .servos = {AxisServo{{.bandwidth_hz = 8.0, .damping = 0.7}, 0.5e-3}, std::nullopt}});
    const Instant begin = rig.clock.now();
    rig.move(50.0, 7.0);
    EXPECT_LE(rig.x_error(50.0), 1e-3);
    EXPECT_GT(rig.clock.now() - begin, 570ms + 150ms);
    EXPECT_LT(rig.clock.now() - begin, 570ms + 600ms);
}

// What an encoder on the motor cannot tell: a carriage that rings on when all is "done". Ramps of
// one and a half periods excite it most: twice a / w^2 each, 0.11 mm.
TEST(StagePhysics, ARingingCarriageIsNotYetWhereTheEncoderSays) {
    const ServoParameters servo{
        .bandwidth_hz = 200.0, .damping = 0.7, .resonance_hz = 30.0, .resonance_damping = 0.01};
    PhysicsRig rig({.servos = {AxisServo{servo, 0.5e-3}, std::nullopt}});
    rig.move(50.0, 7.0);
    EXPECT_NEAR(rig.stage->position()[0], 50.0, 1e-3);
    double swing = 0.0;
    for (int ms = 0; ms < 50; ++ms, rig.clock.advance(1ms))
        swing = std::max(swing, rig.x_error(50.0));
    EXPECT_GT(swing, 0.02);
    rig.clock.advance(10s);
    EXPECT_LE(rig.x_error(50.0), 1e-6);
}

TEST(StagePhysics, AFalseInPositionIsNotBelieved) {
    PhysicsRig rig(
        {.faults = {{.kind = Kind::false_in_position, .at = {When::move, 2}, .axis = 0}}});
    rig.move(20.0, 7.0);
    rig.move(50.0, -7.0);
    EXPECT_LE(rig.x_error(50.0), 1e-3);
    rig.move(-50.0, 7.0);
    EXPECT_LE(rig.x_error(-50.0), 1e-3);
}

// Each during the second of two moves of 0.75 s, at the time or as it starts.
TEST(StagePhysics, WhatHappensInAMoveEndsItWithTheAxesStopped) {
    const std::vector<std::pair<const char*, std::vector<StageFault>>> cases = {
        {"stuck", {{.kind = Kind::stuck_axis, .at = {When::time_ms, 1800}}}},
        {"stuck from the start", {{.kind = Kind::stuck_axis, .at = {When::move, 2}}}},
        {"stuck and lying",
         {{.kind = Kind::stuck_axis, .at = {When::time_ms, 1800}},
          {.kind = Kind::false_in_position, .at = {When::time_ms, 1801}}}},
        {"counts lost", {{.kind = Kind::encoder_jump, .at = {When::time_ms, 1800}, .size = 0.02}}},
        {"limit", {{.kind = Kind::limit_hit, .at = {When::time_ms, 1800}, .axis = 1}}},
        {"alarm", {{.kind = Kind::alarm, .at = {When::time_ms, 1800}, .code = 21}}},
        {"emergency stop", {{.kind = Kind::emergency_stop, .at = {When::time_ms, 1800}}}}};
    for (const auto& [name, faults] : cases) {
        PhysicsRig rig({.faults = faults});
        rig.move(70.0, 7.0);
        rig.clock.advance(1500ms - rig.simulation.uptime());
        EXPECT_THROW(rig.move(0.0, -7.0), DeviceError) << name;
        EXPECT_FALSE(rig.simulation.is_moving()) << name;
        EXPECT_THROW(rig.move(5.0, 5.0), DeviceError) << name;
        EXPECT_FALSE(rig.simulation.is_moving()) << name;
    }
}

}  // namespace
}  // namespace etalon
