#include "mocks/simulated_stage.h"

#include <gtest/gtest.h>

#include <cmath>

namespace etalon {
namespace {

using namespace std::chrono_literals;

// x: 100 mm/s, y: 30 mm/s; with the ramp of 50 ms, 2000 and 600 mm/s^2.
std::vector<Axis> two_axes() {
    return {{.name = "x", .low = -70.0, .high = 500.0, .speed = 100.0},
            {.name = "y", .low = -50.0, .high = 70.0, .speed = 30.0}};
}

struct Rig {
    explicit Rig(SimulatedStageOptions options = {}) : stage(two_axes(), options, clock) {}

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

// 100 mm at 50 mm/s and 200 mm/s^2: ramps of 0.25 s and 6.25 mm, 87.5 mm in 1.75 s between.
TEST(TrapezoidalMotion, ALongMoveRampsCruisesAndRamps) {
    const auto motion = TrapezoidalMotion::between(7.0, 107.0, 50.0, 200.0);
    EXPECT_DOUBLE_EQ(motion.duration(), 2.25);
    EXPECT_DOUBLE_EQ(motion.position(-1.0), 7.0);
    EXPECT_DOUBLE_EQ(motion.position(0.25), 13.25);
    EXPECT_DOUBLE_EQ(motion.position(1.25), 63.25);
    EXPECT_DOUBLE_EQ(motion.position(2.0), 100.75);
    EXPECT_DOUBLE_EQ(motion.position(2.125), 107.0 - 1.5625);
    EXPECT_EQ(motion.position(2.25), 107.0);
    EXPECT_DOUBLE_EQ(motion.velocity(1.0), 50.0);
}

// 7 mm at 28 mm/s^2 never reaches 100 mm/s: peak sqrt(7 * 28) = 14 mm/s after 0.5 s.
TEST(TrapezoidalMotion, AShortMoveIsTriangular) {
    const auto motion = TrapezoidalMotion::between(5.0, -2.0, 100.0, 28.0);
    EXPECT_DOUBLE_EQ(motion.duration(), 1.0);
    EXPECT_DOUBLE_EQ(motion.position(0.5), 1.5);
    EXPECT_DOUBLE_EQ(motion.velocity(0.5), -14.0);
    EXPECT_EQ(motion.position(1.0), -2.0);
}

// Independent of the closed form: the velocity's integral (midpoint rule, 10000 steps; the velocity
// is piecewise linear, so at most the four steps with a corner are off, each by < a h^2 / 4).
TEST(TrapezoidalMotion, PositionIsTheIntegralOfVelocity) {
    for (const auto& motion : {TrapezoidalMotion::between(3.0, -11.0, 9.0, 17.0),
                               TrapezoidalMotion::between(3.0, 3.5, 9.0, 17.0),
                               TrapezoidalMotion::braking(5.0, -7.0, 17.0)}) {
        const double step = motion.duration() / 10000;
        double integral = motion.start();
        for (int i = 0; i < 10000; ++i)
            integral += motion.velocity((i + 0.5) * step) * step;
        EXPECT_NEAR(integral, motion.end(), 4 * 17.0 * step * step / 4 + 1e-9);
    }
}

TEST(TrapezoidalMotion, BrakingEndsAfterVSquaredOverTwoA) {
    const auto motion = TrapezoidalMotion::braking(5.0, -30.0, 60.0);
    EXPECT_DOUBLE_EQ(motion.duration(), 0.5);
    EXPECT_DOUBLE_EQ(motion.end(), -2.5);
    EXPECT_DOUBLE_EQ(motion.position(0.25), 5.0 - 30.0 * 0.25 + 30.0 * 0.0625);
}

TEST(TrapezoidalMotion, NowhereToGoTakesNoTime) {
    EXPECT_EQ(TrapezoidalMotion::between(7.0, 7.0, 5.0, 3.0).duration(), 0.0);
    EXPECT_EQ(TrapezoidalMotion::between(7.0, 7.0, 5.0, 3.0).position(0.0), 7.0);
}

TEST(SimulatedStage, MovesEachAxisAtItsSpeed) {
    Rig rig;
    rig.enable_and_home();
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
    SimulatedStageOptions options;
    options.homing = 700ms;
    options.power_on_position = {11.0, -13.0};
    Rig rig(options);
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
    Rig rig;
    rig.stage.enable(true);
    rig.stage.home();
    rig.clock.advance(50ms);
    rig.stage.stop();
    rig.clock.advance(5s);
    EXPECT_FALSE(rig.stage.status()[0].homed);
}

TEST(SimulatedStage, StopBrakesAtOnce) {
    Rig rig;
    rig.enable_and_home();
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
    SimulatedStageOptions options;
    options.errors = {{.scale = 0.002, .backlash = 0.03}, {.scale = -0.001}};
    Rig rig(options);
    rig.enable_and_home();
    rig.move(100.0, 50.0);
    EXPECT_NEAR(rig.stage.true_positions()[0], 100.2, 1e-9);
    EXPECT_NEAR(rig.stage.true_positions()[1], 49.95, 1e-9);
    rig.move(40.0, 50.0);  // x from above
    EXPECT_NEAR(rig.stage.true_positions()[0], 40.08 + 0.03, 1e-9);
    EXPECT_EQ(rig.stage.status()[0].position, 40.0);
}

TEST(SimulatedStage, NeverJumpsWhenTheErrorsChange) {
    SimulatedStageOptions options;
    options.errors = {{.scale = 0.0, .repeatability = 0.5, .backlash = 0.3}, {}};
    Rig rig(options);
    rig.enable_and_home();
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
    SimulatedStageOptions options;
    options.errors = {{.repeatability = 0.007}, {}};
    options.seed = 5;
    Rig rig(options);
    rig.enable_and_home();
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
    SimulatedStageOptions options;
    options.errors = {{.repeatability = 0.007}, {.repeatability = 0.005}};
    options.seed = 11;
    Rig one(options), same(options);
    options.seed = 12;
    Rig other(options);
    for (Rig* rig : {&one, &same, &other}) {
        rig->enable_and_home();
        rig->move(7.0, 5.0);
    }
    EXPECT_EQ(one.stage.true_positions(), same.stage.true_positions());
    EXPECT_NE(one.stage.true_positions(), other.stage.true_positions());
}

TEST(SimulatedStage, RefusesWhatAControllerRefuses) {
    const auto alarm_after = [](auto act) {
        Rig rig;
        act(rig);
        EXPECT_FALSE(rig.stage.true_positions()[0] != 0.0);
        return rig.stage.status()[0].alarm;
    };
    const auto start = [](Rig& rig, double x, double speed) {
        rig.stage.start({x, 0.0}, {speed, 30.0});
    };
    EXPECT_EQ(alarm_after([&](Rig& rig) { start(rig, 7.0, 100.0); }), StageAlarm::not_ready);
    EXPECT_EQ(alarm_after([&](Rig& rig) { rig.stage.home(); }), StageAlarm::not_ready);
    EXPECT_EQ(alarm_after([&](Rig& rig) {
                  rig.enable_and_home();
                  start(rig, 501.0, 100.0);
              }),
              StageAlarm::outside_travel);
    EXPECT_EQ(alarm_after([&](Rig& rig) {
                  rig.enable_and_home();
                  start(rig, 7.0, 200.0);
              }),
              StageAlarm::outside_travel);
    EXPECT_EQ(alarm_after([&](Rig& rig) {
                  rig.enable_and_home();
                  start(rig, 7.0, 100.0);
              }),
              StageAlarm::none);
}

TEST(SimulatedStage, AnAlarmBrakesAndStaysUntilReset) {
    Rig rig;
    rig.enable_and_home();
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
    Rig rig;
    rig.enable_and_home();
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

TEST(SimulatedStage, HoldsInPositionUntilThePictureIsReady) {
    SimulatedStageOptions options;
    options.errors = {{.scale = 0.01}, {}};
    Rig rig(options);
    rig.enable_and_home();
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
    SimulatedStageOptions one_error;
    one_error.errors = {{}};
    EXPECT_THROW(SimulatedStage(two_axes(), one_error, clock), ConfigError);
    SimulatedStageOptions outside;
    outside.power_on_position = {501.0, 0.0};
    EXPECT_THROW(SimulatedStage(two_axes(), outside, clock), ConfigError);
    SimulatedStageOptions no_ramp;
    no_ramp.ramp = 0ms;
    EXPECT_THROW(SimulatedStage(two_axes(), no_ramp, clock), ConfigError);
}

}  // namespace
}  // namespace etalon
