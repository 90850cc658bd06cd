#include "stage/motion/motion_guard.h"

#include "stage/motion/modbus_stage.h"
#include "tests/fakes/fake_stage.h"
#include "tests/fakes/memory_transport.h"
#include "tests/fakes/test_axes.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Positions = std::vector<double>;

// Forbidden: |x| < 20 with z > 100; slow from z = 85 on.
const MotionRules lens_rules{{{"lens", {{-20, 20}, {100, 160}}}}, {0, 15}, 0.2};

struct GuardedRig {
    explicit GuardedRig(const MotionRules& rules = lens_rules)
        : GuardedRig(std::make_unique<FakeStage>(xz()), rules) {}
    GuardedRig(std::unique_ptr<FakeStage> stage, const MotionRules& rules)
        : fake(*stage), guarded(std::move(stage), rules) {
        guarded.enable({});
        guarded.home({});
    }
    FakeStage& fake;
    LimitedStage guarded;
};

TEST(LimitedStage, MovesInAsManyMotionsAsTheBoxesTake) {
    GuardedRig rig;
    rig.guarded.move(Positions{-40, 120}, {});
    rig.guarded.move(Positions{40, 130}, {});
    EXPECT_EQ(rig.fake.moves.front(), (Positions{-40, 0}));
    ASSERT_EQ(rig.fake.moves.size(), 5u);
    EXPECT_NEAR(rig.fake.moves[2][1], 99.9, 1e-12);
    EXPECT_EQ(rig.fake.moves[3][0], 40);
    EXPECT_EQ(rig.fake.moves[4], (Positions{40, 130}));
    EXPECT_EQ(rig.guarded.position(), (Positions{40, 130}));
}

TEST(LimitedStage, PlansFromWhereTheAxesReadToBe) {
    GuardedRig rig;
    rig.fake.read_back_error = {0, 40};  // z really stands beside the lens
    rig.guarded.move(Positions{-40, 80}, {});
    rig.fake.read_back_error = {};
    rig.guarded.move(Positions{40, 90}, {});
    EXPECT_EQ(rig.fake.moves, (std::vector<Positions>{{-40, 80}, {-40, 90}, {40, 90}}));
}

TEST(LimitedStage, MovesNothingToWhatIsForbidden) {
    GuardedRig rig;
    EXPECT_THROW(rig.guarded.move(Positions{7, 120}, {}), ConfigError);
    EXPECT_THROW(rig.guarded.move(Positions{7, 201}, {}), ConfigError);
    EXPECT_THROW(rig.guarded.move(Positions{7}, {}), ConfigError);
    EXPECT_TRUE(rig.fake.moves.empty());
}

TEST(LimitedStage, IsSlowNearABoxAndNeverFasterThanItWasLimitedTo) {
    GuardedRig rig;
    rig.guarded.move(Positions{7, 50}, {});
    rig.guarded.move(Positions{7, 95}, {});
    rig.guarded.limit_speed(0.1);
    rig.guarded.move(Positions{7, 90}, {});
    rig.guarded.move(Positions{7, 20}, {});
    EXPECT_EQ(rig.fake.speed_shares, (std::vector<double>{1.0, 0.2, 0.1, 0.1}));
}

// 15 mm beside the lens at 0.1 % of 5 mm/s: half of what the speed register can say.
TEST(LimitedStage, RefusesASlowZoneThatIsSlowerThanTheControllerCanBeBeforeAnythingMoves) {
    MotionRules rules = lens_rules;
    rules.slow_share = 0.001;
    VirtualClock clock;
    SimulatedStage simulation(xz(), {}, clock);
    StageProfile profile = builtin_stage_profile("generic");
    profile.speed.step = 100.0;  // counts a second: 0.01 mm/s
    ModbusController controller(simulation, profile);
    const auto error = [&] {
        return config_error_of([&] {
            LimitedStage(
                open_modbus_stage(StageLink{}, profile, xz(), clock,
                                  std::make_unique<MemoryTransport>(controller, clock, false)),
                rules);
        });
    };
    EXPECT_THAT(error(), HasSubstr("stage axes: z: 0.1 % of its speed is not 1 to"));
    EXPECT_TRUE(controller.writes().empty());
    rules.slow_share = 0.002;
    EXPECT_EQ(error(), "no error");
}

TEST(LimitedStage, EndsTheMoveWhereAMotionFails) {
    GuardedRig rig;
    rig.guarded.move(Positions{-40, 120}, {});
    rig.fake.before_move = [&](std::span<const double>) {
        if (rig.fake.moves.size() == 4)
            throw DeviceError("fake stage", "move", "alarm 7");
    };
    EXPECT_THROW(rig.guarded.move(Positions{40, 130}, {}), DeviceError);
    EXPECT_EQ(rig.fake.moves.size(), 4u);
}

TEST(LimitedStage, TellsWhatDisturbsTheAxesAtRest) {
    const auto error_with = [](void (*disturb)(AxisStatus & x, AxisStatus & z)) -> std::string {
        GuardedRig rig;
        rig.fake.on_status = [disturb](auto& axes) { disturb(axes[0], axes[1]); };
        return device_error_of([&] { rig.guarded.position(); });
    };
    const std::string read = "fake stage: read the positions: axis ";
    EXPECT_EQ(error_with([](AxisStatus&, AxisStatus&) {}), "no error");
    EXPECT_EQ(error_with([](AxisStatus&, AxisStatus& z) { z.alarm = 7; }), read + "z: alarm 7");
    EXPECT_EQ(error_with([](AxisStatus&, AxisStatus& z) { z.emergency_stop = true; }),
              read + "z: emergency stop");
    EXPECT_EQ(error_with([](AxisStatus&, AxisStatus& z) { z.limit = true; }),
              read + "z is at a limit switch");
    // The alarm of a limit switch is its whole controller's.
    EXPECT_EQ(
        error_with([](AxisStatus& x, AxisStatus& z) { x.alarm = z.alarm = 4 * (z.limit = true); }),
        read + "z is at a limit switch");
}

TEST(LimitedStage, MayLeaveTheLimitSwitchThatItWasHomedTo) {
    GuardedRig rig;
    rig.fake.on_status = [](std::vector<AxisStatus>& axes) { axes[0].limit = true; };
    rig.guarded.move(Positions{7, 5}, {});
    EXPECT_EQ(rig.fake.moves, (std::vector<Positions>{{7, 5}}));
}

// ---- Against the twin's controller and physics, on virtual time

class SimulatedRig {
public:
    SimulatedRig(const std::vector<Axis>& axes, MotionRules rules, SimulatedStageOptions options)
        : simulation(axes, std::move(options), clock), guarded(connected(axes), std::move(rules)) {
        guarded.enable({});
        guarded.home({});
    }

    VirtualClock clock;
    SimulatedStage simulation;
    ModbusController controller{simulation, builtin_stage_profile("generic")};
    LimitedStage guarded;

private:
    std::unique_ptr<Stage> connected(const std::vector<Axis>& axes) {
        return open_modbus_stage(StageLink{}, builtin_stage_profile("generic"), axes, clock,
                                 std::make_unique<MemoryTransport>(controller, clock, false));
    }
};

// Looked at with every request, that is every 5 ms: where the carriage truly is.
TEST(LimitedStage, NeverCarriesAnythingIntoABox) {
    SimulatedRig rig(xz(), lens_rules, {});
    int looks = 0, inside = 0, beside = 0;
    rig.controller.set_script([&](const ModbusRequest&) {
        const Positions q = rig.simulation.true_positions();
        ++looks;
        inside += std::abs(q[0]) < 20 && q[1] > 100 && q[1] < 160;
        beside += std::abs(q[0]) > 20 && q[1] > 100 && q[1] < 160;
        return ModbusReaction{};
    });
    RandomStream random(7, 3);
    int moves = 0;
    while (moves < 40) {
        const Positions target = {200 * random.uniform() - 100, 120 * random.uniform() + 60};
        if (!is_clear(xz(), lens_rules, target))
            continue;
        rig.guarded.move(target, {});
        ++moves;
        EXPECT_NEAR(rig.simulation.true_positions()[0], target[0], 1e-3);
        EXPECT_NEAR(rig.simulation.true_positions()[1], target[1], 1e-3);
    }
    EXPECT_EQ(inside, 0);
    EXPECT_GT(beside, 1000);
    EXPECT_GT(looks, 10000);
}

// 0.03 mm of lost motion: from either side the carriage is off by all of it or by nothing.
TEST(LimitedStage, ApproachesSoThatTheBacklashIsAConstant) {
    const auto errors_with = [](int approach) {
        std::vector<Axis> axes = xz();
        axes[0].approach = approach;
        axes[0].overrun = 0.1;
        SimulatedRig rig(axes, {}, {.errors = {{.backlash = 0.03}, {}}});
        Positions errors;
        for (const double x : {7.0, -5.0, -5.0, 3.0, 3.05, 40.0, 39.95, 0.0}) {
            rig.guarded.move(Positions{x, 11.0}, {});
            errors.push_back(rig.simulation.true_positions()[0] - rig.guarded.position()[0]);
        }
        return errors;
    };
    const auto spread = [](const Positions& errors) {
        const auto [low, high] = std::ranges::minmax(errors);
        return high - low;
    };
    EXPECT_NEAR(spread(errors_with(0)), 0.03, 1e-9);
    EXPECT_NEAR(spread(errors_with(1)), 0.0, 1e-9);
    EXPECT_NEAR(spread(errors_with(-1)), 0.0, 1e-9);
}

}  // namespace
}  // namespace etalon
