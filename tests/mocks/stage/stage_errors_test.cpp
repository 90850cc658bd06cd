#include "mocks/stage/simulated_axis.h"

#include "mocks/stage/simulated_stage.h"
#include "tests/test.h"

namespace etalon {
namespace {

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

}  // namespace
}  // namespace etalon
