// A controller counts in steps, of the way and of the speed, which may be larger than what it is
// asked for.

#include "tests/stage/motion/modbus_rig.h"

namespace etalon {
namespace {

using namespace test;

// Below one count nothing could be told to arrive: every move would end at its time limit.
TEST(ModbusStageSteps, AnAxisThatCountsCoarserThanItsToleranceIsRefused) {
    Rig rig;  // 1 um, 0.0002 degree
    rig.profile.counts.per_mm = 990.0;
    EXPECT_THAT(config_error_of([&] { rig.connect(); }),
                HasSubstr("stage axes: x: one of its counts, 0.0010101 mm, is more than the "
                          "profile's tolerance, 0.001 mm"));
    rig.profile.counts = {.per_mm = -1000.0, .per_deg = 4900.0};
    EXPECT_THAT(config_error_of([&] { rig.connect(); }),
                HasSubstr("stage axes: rz: one of its counts"));
    rig.profile.counts.per_deg = 5000.0;
    EXPECT_NO_THROW(rig.connect());
}

TEST(ModbusStageSteps, AnApproachOfLessThanTwoCountsIsRefused) {
    std::vector<Axis> axes = fast_axes();
    axes[0].approach = -1;
    axes[0].overrun = 0.0019;
    Rig rig(builtin_stage_profile("generic"), axes);
    rig.profile.counts.per_mm = 1000.0;
    EXPECT_THAT(
        config_error_of([&] { rig.connect(); }),
        HasSubstr("stage axes: x: its overrun before the approach, 0.0019 mm, is less than two "
                  "of its counts, 0.002 mm"));
    rig.profile.counts.per_mm = 1100.0;
    EXPECT_NO_THROW(rig.connect());
}

// 200 counts a mm: 5 um, and limits in mid count. Rounded to the nearest both would be beyond them.
TEST(ModbusStageSteps, NoTargetIsRoundedToBeyondASoftLimit) {
    std::vector<Axis> axes = fast_axes();
    axes[0].low = -7.0029;
    axes[0].high = 50.0029;
    HomedRig rig(by_code, axes);
    rig.stage->move(std::vector{50.0029, 0.5}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], 50.0, 1e-6);
    rig.stage->move(std::vector{-7.0029, 0.5}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], -7.0, 1e-6);
    rig.stage->move(std::vector{7.0029, 0.5}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], 7.005, 1e-6) << "elsewhere to the nearest";
}

// Speeds in whole steps of 5 counts a second, 25 um/s: 1.9 of them are 1, and less would be faster
// than was asked for.
TEST(ModbusStageSteps, ASpeedBelowTheSmallestStepIsRefusedAndNotMadeFaster) {
    HomedRig rig(by_code);
    rig.stage->limit_speed(1.9 * 0.025 / 200.0);
    const Instant start = rig.clock.now();
    rig.stage->move(std::vector{0.1, 0.0}, {});
    EXPECT_NEAR(std::chrono::duration<double>(rig.clock.now() - start).count(), 4.0, 0.2);
    EXPECT_THAT(config_error_of([&] { rig.stage->limit_speed(0.99 * 0.025 / 200.0); }),
                HasSubstr("stage axes: x: 0.012375 % of its speed is not 1 to 65535 in the speed "
                          "register"));
}

}  // namespace
}  // namespace etalon
