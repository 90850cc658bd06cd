#include "mocks/stage/simulated_stage.h"
#include "tests/fakes/test_axes.h"
#include "tests/test.h"

namespace etalon {
namespace {

struct StageRig {
    explicit StageRig(SimulatedStageOptions options = {}) : stage(two_axes(), options, clock) {}

    void enable_and_home() {
        stage.enable(true);
        stage.home();
        clock.advance(10s);
    }
    void move(double x, double y) {
        stage.start({x, y}, {100.0, 30.0});
        clock.advance(20s);
    }

    VirtualClock clock;
    SimulatedStage stage;
};

struct HomedRig : StageRig {
    explicit HomedRig(const SimulatedStageOptions& options = {}) : StageRig(options) {
        enable_and_home();
    }
};

TEST(SimulatedStage, MovesEachAxisAtItsSpeed) {
    HomedRig rig;
    rig.stage.start({200.0, 15.0}, {100.0, 30.0});
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
    EXPECT_EQ(rig.stage.status()[0].position, 200.0);
    EXPECT_FALSE(rig.stage.is_moving());
}

TEST(SimulatedStage, HomingTakesTimeAndEndsAtZero) {
    StageRig rig({.homing = 700ms, .power_on_position = {11.0, -13.0}});
    rig.stage.enable(true);
    EXPECT_FALSE(rig.stage.status()[0].homed);
    rig.stage.home();
    rig.clock.advance(699ms);
    EXPECT_FALSE(rig.stage.status()[0].homed);
    EXPECT_TRUE(rig.stage.status()[0].moving);
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
    EXPECT_FALSE(rig.stage.status()[0].homed);
}

TEST(SimulatedStage, StopBrakesAtOnce) {
    HomedRig rig;
    rig.stage.start({200.0, 0.0}, {100.0, 30.0});
    rig.clock.advance(500ms);
    rig.stage.stop();
    EXPECT_TRUE(rig.stage.is_moving());
    rig.clock.advance(51ms);
    EXPECT_FALSE(rig.stage.is_moving());
    // 47.5 mm so far, then v^2 / 2a = 100^2 / 4000 = 2.5 mm.
    EXPECT_NEAR(rig.stage.status()[0].position, 50.0, 1e-9);
    EXPECT_FALSE(rig.stage.status()[0].in_position);
}

TEST(SimulatedStage, IsTrulyWhereScaleAndBacklashPutIt) {
    HomedRig rig({.errors = {{.scale = 0.002, .backlash = 0.03}, {.scale = -0.001}}});
    rig.move(100.0, 50.0);
    EXPECT_NEAR(rig.stage.true_positions()[0], 100.2, 1e-9);
    EXPECT_NEAR(rig.stage.true_positions()[1], 49.95, 1e-9);
    rig.move(40.0, 50.0);  // x from above
    EXPECT_NEAR(rig.stage.true_positions()[0], 40.08 + 0.03, 1e-9);
    EXPECT_EQ(rig.stage.status()[0].position, 40.0);
}

TEST(SimulatedStage, NeverJumpsWhenTheErrorsChange) {
    HomedRig rig({.errors = {{.scale = 0.0, .repeatability = 0.5, .backlash = 0.3}, {}}});
    rig.move(100.0, 0.0);
    const double before = rig.stage.true_positions()[0];
    rig.stage.start({60.0, 0.0}, {100.0, 30.0});
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
        return rig.stage.status()[0].alarm;
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
    rig.stage.start({200.0, 0.0}, {100.0, 30.0});
    rig.clock.advance(500ms);
    rig.stage.raise_alarm(17);
    rig.clock.advance(51ms);
    EXPECT_FALSE(rig.stage.is_moving());
    EXPECT_EQ(rig.stage.status()[1].alarm, 17);
    rig.stage.start({7.0, 0.0}, {100.0, 30.0});
    EXPECT_FALSE(rig.stage.is_moving());
    EXPECT_EQ(rig.stage.status()[1].alarm, 17);
    rig.stage.reset();
    EXPECT_EQ(rig.stage.status()[1].alarm, 0);
    rig.stage.start({7.0, 0.0}, {100.0, 30.0});
    EXPECT_TRUE(rig.stage.is_moving());
}

TEST(SimulatedStage, AJammedAxisClaimsToMoveUntilStopped) {
    HomedRig rig;
    rig.stage.start({200.0, 7.0}, {100.0, 30.0});
    rig.clock.advance(500ms);
    rig.stage.jam(0);
    rig.clock.advance(20s);
    const auto status = rig.stage.status();
    EXPECT_TRUE(status[0].moving);
    EXPECT_NEAR(status[0].position, 47.5, 1e-9);
    EXPECT_TRUE(status[1].in_position);
    rig.stage.stop();
    EXPECT_FALSE(rig.stage.is_moving());
    rig.stage.start({200.0, 7.0}, {100.0, 30.0});
    rig.clock.advance(20s);
    EXPECT_TRUE(rig.stage.is_moving());
    rig.stage.stop();
    rig.stage.jam(0, false);
    rig.move(200.0, 7.0);
    EXPECT_EQ(rig.stage.status()[0].position, 200.0);
}

// A ramp of 50 ms whose acceleration builds up in 20 ms: 0.5 s at 30 mm/s and 70 ms of ramp.
TEST(SimulatedStage, MovesByAnSCurveWhenTheJerkIsLimited) {
    HomedRig rig({.jerk = 20ms});
    rig.stage.start({0.0, 15.0}, {100.0, 30.0});
    rig.clock.advance(20ms);  // j t^3 / 6 = 600 mm/s^2 / 20 ms * (20 ms)^3 / 6
    EXPECT_NEAR(rig.stage.status()[1].position, 600.0 * 0.02 * 0.02 / 6.0, 1e-12);
    rig.clock.advance(549ms);
    EXPECT_TRUE(rig.stage.status()[1].moving);
    rig.clock.advance(2ms);
    EXPECT_TRUE(rig.stage.status()[1].in_position);
    EXPECT_EQ(rig.stage.status()[1].position, 15.0);
}

// The plan stops from 30 mm/s within 1 ms around 500.5 ms. A loop of w rad/s with damping 1 is
// then behind by (v / w) (2 + w s) exp(-w s), s seconds later.
TEST(SimulatedStage, IsInPositionOnceTheServoHasSettled) {
    HomedRig rig(
        {.ramp = 1ms,
         .servos = {std::nullopt, AxisServo{{.bandwidth_hz = 5.0, .damping = 1.0}, 0.01}}});
    rig.stage.start({0.0, 15.0}, {100.0, 30.0});
    const double w = 10.0 * std::numbers::pi;
    const auto behind = [&](double s) { return 30.0 / w * (2.0 + w * s) * std::exp(-w * s); };
    rig.clock.advance(502ms);
    EXPECT_FALSE(rig.stage.status()[1].moving || rig.stage.status()[1].in_position);
    EXPECT_NEAR(rig.stage.status()[1].position, 15.0 - behind(1.5e-3), 1e-4);
    int settled_ms = 2;
    while (behind(settled_ms * 1e-3 - 0.5e-3) > 0.01)
        ++settled_ms;
    rig.clock.advance(std::chrono::milliseconds(settled_ms - 2 - 2));
    EXPECT_FALSE(rig.stage.status()[1].in_position);
    rig.clock.advance(3ms);
    EXPECT_TRUE(rig.stage.status()[1].in_position);
    EXPECT_EQ(rig.stage.target()[1], 15.0);
    EXPECT_TRUE(rig.stage.status()[0].in_position);
}

TEST(SimulatedStage, ANewCommandTakesTheServoAsItIs) {
    HomedRig rig(
        {.jerk = 10ms,
         .servos = {AxisServo{{.bandwidth_hz = 9.0, .resonance_hz = 14.0}, 0.01}, std::nullopt}});
    rig.stage.start({100.0, 0.0}, {100.0, 30.0});
    rig.clock.advance(300ms);
    for (int i = 0; i < 3; ++i) {  // stopped while it stops
        const double truth = rig.stage.true_positions()[0], read = rig.stage.status()[0].position;
        rig.stage.stop();
        EXPECT_NEAR(rig.stage.true_positions()[0], truth, 1e-9);
        EXPECT_NEAR(rig.stage.status()[0].position, read, 1e-9);
        rig.clock.advance(7ms);
        // At no more than 100 mm/s and its ringing.
        EXPECT_NEAR(rig.stage.true_positions()[0], truth, 7e-3 * 130.0);
    }
    rig.clock.advance(20s);
    EXPECT_NEAR(rig.stage.true_positions()[0], rig.stage.status()[0].position, 1e-9);
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
    EXPECT_FALSE(rig.stage.status()[0].ready);
    rig.stage.enable(true);
    EXPECT_TRUE(rig.stage.status()[0].ready);
    rig.stage.home();
    rig.clock.advance(100ms);
    EXPECT_TRUE(rig.stage.status()[0].homing && !rig.stage.status()[0].ready);
    rig.clock.advance(200ms);
    EXPECT_TRUE(!rig.stage.status()[0].homing && rig.stage.status()[0].ready);
    rig.stage.raise_alarm(17);
    EXPECT_FALSE(rig.stage.status()[0].ready);
}

TEST(SimulatedStage, HoldsInPositionUntilThePictureIsReady) {
    HomedRig rig({.errors = {{.scale = 0.01}, {}}});
    bool ready = false;
    std::vector<double> asked;
    rig.stage.hold_in_position_until([&](const std::vector<double>& truth) {
        asked = truth;
        return ready;
    });
    rig.stage.start({100.0, 5.0}, {100.0, 30.0});
    rig.clock.advance(100ms);
    rig.stage.status();
    EXPECT_TRUE(asked.empty()) << "asked while moving";
    rig.clock.advance(10s);
    EXPECT_FALSE(rig.stage.status()[0].in_position);
    ASSERT_EQ(asked.size(), 2U);
    EXPECT_NEAR(asked[0], 101.0, 1e-9);
    ready = true;
    EXPECT_TRUE(rig.stage.status()[0].in_position);
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

}  // namespace
}  // namespace etalon
