#include "stage/motion/motion_guard.h"

#include "core/statistics/random.h"
#include "stage/motion/modbus_stage.h"
#include "tests/fakes/fake_stage.h"
#include "tests/fakes/memory_transport.h"
#include "tests/fakes/test_axes.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Positions = std::vector<double>;

using std::numbers::pi;
using Positions = std::vector<double>;

// x 10 mm/s, z 5 mm/s, and a rotary one with 1 rad/s.
std::vector<Axis> xzr() {
    auto axes = xz();
    axes.push_back(
        {.name = "r", .kind = Axis::Kind::rotary, .low = -7.0, .high = 9.0, .speed = 1.0});
    return axes;
}

MotionRules rules_from(const std::string& yaml, const std::vector<Axis>& axes) {
    const auto file = StrictFile::from_text("etalon: test/1\n" + yaml, "s.yml", "test/1");
    MotionRules rules = read_motion_rules(file.root(), axes);
    file.finish();
    return rules;
}

// A lens in front of x = -20 to 20 from z = 100 on.
MotionRules lens(const std::vector<Axis>& axes, const std::string& more = "") {
    return rules_from("forbidden: [{name: lens, x: [-20, 20], z: [100, 160]}]\n" + more, axes);
}

std::vector<Positions> stops(const std::vector<MotionSegment>& path) {
    std::vector<Positions> all;
    for (const MotionSegment& segment : path)
        all.push_back(segment.to);
    return all;
}

const SourcePlace place{"plan.yml", 9, "poses"};

std::string error_of(const std::vector<Axis>& axes, const MotionRules& rules, const Positions& from,
                     const Positions& to) {
    return config_error_of([&] { plan_motion(axes, rules, from, to, place); });
}

double seconds(const MotionSegment& segment) {
    return std::chrono::duration<double>(segment.time).count();
}

TEST(MotionRules, AreReadInTheUnitsOfTheAxes) {
    const MotionRules rules = rules_from(
        "forbidden: [{name: lens, x: [-20, 30], r: [90, 180]}, {name: wall, z: [150, 170]}]\n"
        "slow_near: {margin: {x: 5, r: 9}, speed_share: 0.2}\n",
        xzr());
    ASSERT_EQ(rules.forbidden.size(), 2u);
    EXPECT_EQ(rules.forbidden[0].name, "lens");
    EXPECT_EQ(rules.forbidden[0].sides[0].high, 30.0);
    EXPECT_TRUE(std::isinf(rules.forbidden[0].sides[1].low));
    EXPECT_DOUBLE_EQ(rules.forbidden[0].sides[2].low, pi / 2);
    EXPECT_EQ(rules.slow_margin, (Positions{5.0, 0.0, pi / 20}));
    EXPECT_EQ(rules.slow_share, 0.2);
    EXPECT_TRUE(rules_from("", {}).forbidden.empty());
}

TEST(MotionRules, NameThePlaceOfEveryFault) {
    const auto error = [](const std::string& yaml) -> std::string {
        return config_error_of([&] { rules_from(yaml, xz()); });
    };
    EXPECT_EQ(error("forbidden: [{name: lens}]"),
              "s.yml:2: forbidden[0]: names no axis, and would forbid everything");
    EXPECT_EQ(error("forbidden: [{name: lens, x: [5, 5]}]"),
              "s.yml:2: forbidden[0].x: must be [low, high] with low < high, not [5, 5]");
    EXPECT_EQ(error("forbidden: [{name: lens, x: [5, 7], q: [5, 7]}]"),
              "s.yml:2: forbidden[0].q: unknown key; did you mean 'x'?");
    EXPECT_EQ(error("slow_near: {margin: {x: 5}, speed_share: 0.2}"),
              "s.yml:2: slow_near: there is no forbidden box to be near to");
    EXPECT_EQ(
        error("forbidden: [{name: a, x: [5, 7]}]\nslow_near: {margin: {x: 5}, speed_share: 0}"),
        "s.yml:3: slow_near.speed_share: must be between 0.001 and 1, not 0");
}

TEST(MotionGuard, GoesStraightWhereNothingIsInTheWay) {
    const auto path = plan_motion(xz(), lens(xz()), Positions{-60, 90}, Positions{70, 50}, place);
    ASSERT_EQ(path.size(), 1u);
    EXPECT_EQ(path[0].from, (Positions{-60, 90}));
    EXPECT_EQ(path[0].to, (Positions{70, 50}));
    EXPECT_EQ(path[0].speed_share, 1.0);
    EXPECT_DOUBLE_EQ(seconds(path[0]), 13.0);
}

// The straight way might cut the lens' corner, whichever axis is slower: z has to come out first,
// and to go in last.
TEST(MotionGuard, MovesOneAxisAfterTheOtherAroundABox) {
    const auto out = plan_motion(xz(), lens(xz()), Positions{40, 120}, Positions{-5, 60}, place);
    EXPECT_EQ(stops(out), (std::vector<Positions>{{40, 60}, {-5, 60}}));
    const auto in = plan_motion(xz(), lens(xz()), Positions{-5, 60}, Positions{40, 120}, place);
    EXPECT_EQ(stops(in), (std::vector<Positions>{{40, 60}, {40, 120}}));
}

// From one side of the lens to the other neither order helps: z draws back to 0.1 mm before it.
TEST(MotionGuard, DrawsBackWhereNoOrderOfTheAxesHelps) {
    const auto path = plan_motion(xz(), lens(xz()), Positions{-60, 120}, Positions{70, 130}, place);
    ASSERT_EQ(path.size(), 3u);
    EXPECT_NEAR(path[0].to[1], 99.9, 1e-12);
    EXPECT_EQ(path[0].to[0], -60);
    EXPECT_EQ(path[1].to[0], 70);
    EXPECT_EQ(path[2].to, (Positions{70, 130}));
}

TEST(MotionGuard, RefusesWhatHasNoWay) {
    auto axes = xz();
    axes[1].low = 100.0;
    axes[1].high = 150.0;
    EXPECT_EQ(error_of(axes, lens(axes), {-60, 120}, {70, 130}),
              "plan.yml:9: poses: no way was found from x -60 mm, z 120 mm to x 70 mm, z 130 mm "
              "past the forbidden box 'lens'");
}

TEST(MotionGuard, RefusesTargetsInABoxOrTooNearToIt) {
    const auto axes = xz();
    const MotionRules rules = lens(axes);
    EXPECT_EQ(error_of(axes, rules, {0, 0}, {7, 120}),
              "plan.yml:9: poses: x 7 mm, z 120 mm is in the forbidden box 'lens' or too near to "
              "it");
    EXPECT_EQ(error_of(axes, rules, {0, 0}, {7, 99.95}).substr(0, 20), "plan.yml:9: poses: x");
    EXPECT_EQ(error_of(axes, rules, {0, 0}, {7, 99.9}), "no error");
    EXPECT_EQ(error_of(axes, rules, {0, 0}, {7, 201}),
              "plan.yml:9: poses: axis z at 201 mm is outside its soft limits -50 mm to 200 mm");
    EXPECT_TRUE(is_clear(axes, rules, Positions{30, 120}));
    EXPECT_FALSE(is_clear(axes, rules, Positions{20.05, 120}));
}

// An axis at rest reads a little off its target, so the way out of there must stay open; from
// inside the box there is none.
TEST(MotionGuard, GoesOnFromWhereItMayRestAndNotFromInsideABox) {
    const auto axes = xz();
    EXPECT_EQ(error_of(axes, lens(axes), {7, 99.94}, {7, 20}), "no error");
    EXPECT_EQ(error_of(axes, lens(axes), {7, 103}, {7, 20}),
              "plan.yml:9: poses: the axes stand in the forbidden box 'lens' (x 7 mm, z 103 mm): "
              "bring them out with the controller's own means");
    EXPECT_EQ(error_of(axes, lens(axes), {std::nan(""), 10}, {7, 20}),
              "plan.yml:9: poses: where the axes are is not known");
}

TEST(MotionGuard, MeetsABoxOfARotaryAxisAtEveryTurn) {
    const auto axes = xzr();
    const MotionRules rules = rules_from("forbidden: [{name: arm, r: [90, 100]}]", axes);
    const double inside = 95 * pi / 180;
    EXPECT_FALSE(is_clear(axes, rules, Positions{0, 0, inside}));
    EXPECT_FALSE(is_clear(axes, rules, Positions{0, 0, inside + 2 * pi}));
    EXPECT_FALSE(is_clear(axes, rules, Positions{0, 0, inside - 2 * pi}));
    EXPECT_TRUE(is_clear(axes, rules, Positions{0, 0, inside + pi}));
    EXPECT_NE(error_of(axes, rules, {0, 0, 0}, {0, 0, 3}), "no error");
    EXPECT_NE(error_of(axes, rules, {0, 0, 0}, {0, 0, -5}), "no error");
    EXPECT_EQ(error_of(axes, rules, {0, 0, 0}, {0, 0, -4.5}), "no error");
}

// By hand: 40 mm before the lens are 8 s at full speed; the 10 mm inside the slow zone take 10 s.
TEST(MotionGuard, IsSlowNearABox) {
    const auto axes = xz();
    const MotionRules rules = lens(axes, "slow_near: {margin: {z: 15}, speed_share: 0.2}\n");
    const auto far = plan_motion(axes, rules, Positions{0, 45}, Positions{0, 85}, place);
    ASSERT_EQ(far.size(), 1u);
    EXPECT_EQ(far[0].speed_share, 1.0);
    EXPECT_DOUBLE_EQ(seconds(far[0]), 8.0);
    const auto near = plan_motion(axes, rules, Positions{0, 85}, Positions{0, 95}, place);
    ASSERT_EQ(near.size(), 1u);
    EXPECT_EQ(near[0].speed_share, 0.2);
    EXPECT_DOUBLE_EQ(seconds(near[0]), 10.0);
    EXPECT_EQ(near[0].near, std::vector<std::string>{"lens"});
}

// 80 mm of x beside the lens, then 5 mm of z in its zone: together all would be slow.
TEST(MotionGuard, DoesTheFarPartOfAMoveAtFullSpeed) {
    const auto axes = xz();
    const MotionRules rules = lens(axes, "slow_near: {margin: {z: 15}, speed_share: 0.2}\n");
    const auto path = plan_motion(axes, rules, Positions{-85, 84}, Positions{-5, 89}, place);
    EXPECT_EQ(stops(path), (std::vector<Positions>{{-5, 84}, {-5, 89}}));
    EXPECT_EQ(path.at(0).speed_share, 1.0);
    EXPECT_EQ(path.at(1).speed_share, 0.2);
}

TEST(MotionGuard, ComesFromTheDeclaredSide) {
    auto axes = xz();
    axes[0].approach = 1;
    axes[0].overrun = 0.5;
    axes[1].approach = -1;
    axes[1].overrun = 0.25;
    const auto approach = [&](Positions from, Positions to) {
        return stops(plan_motion(axes, {}, from, to, place));
    };
    // Already upwards in x and downwards in z over enough of a way.
    EXPECT_EQ(approach({0, 7}, {3, 5}), (std::vector<Positions>{{3, 5}}));
    EXPECT_EQ(approach({0, 5}, {3, 7}), (std::vector<Positions>{{2.5, 7.25}, {3, 7}}));
    EXPECT_EQ(approach({2.75, 9}, {3, 7}), (std::vector<Positions>{{2.5, 7.25}, {3, 7}}));
    // A place where it is already may have been reached from the other side.
    EXPECT_EQ(approach({3, 7}, {3, 7}), (std::vector<Positions>{{2.5, 7.25}, {3, 7}}));
    EXPECT_EQ(error_of(axes, {}, {0, 0}, {-100, 5}),
              "plan.yml:9: poses (overrun before the approach): axis x at -100.5 mm is outside its "
              "soft limits -100 mm to 100 mm");
    EXPECT_EQ(error_of(axes, lens(axes), {-60, 190}, {0, 160.2}), "no error");
    axes[1].approach = 1;
    EXPECT_NE(error_of(axes, lens(axes), {-60, 190}, {0, 160.2}), "no error");
    EXPECT_FALSE(is_clear(axes, lens(axes), Positions{0, 160.2}));
    EXPECT_TRUE(is_clear(axes, lens(axes), Positions{0, 160.4}));
}

TEST(MotionGuard, IsOneMotionWhereNothingHasToMove) {
    const auto path = plan_motion(xz(), lens(xz()), Positions{3, 7}, Positions{3, 7}, place);
    ASSERT_EQ(path.size(), 1u);
    EXPECT_EQ(path[0].time, Duration::zero());
}

// ---- Exhaustively: whatever the axes' timing, no planned way meets a box, and what is refused
// cannot be done one axis after the other. Judged by another program than the planner's: points.

struct Scene {
    std::vector<Axis> axes = xzr();
    MotionRules rules;
    Positions from, to;
};

double drawn(RandomStream& random, double low, double high) {
    return low + random.uniform() * (high - low);
}

Scene drawn_scene(RandomStream& random) {
    Scene scene;
    for (int i = 0; i < 3; ++i) {
        ForbiddenBox box{"box " + std::to_string(i), {}};
        for (const Axis& axis : scene.axes) {
            const bool rotary = axis.kind == Axis::Kind::rotary;
            const double range = rotary ? 2 * pi : axis.high - axis.low;
            const double low = drawn(random, axis.low, axis.high - 0.2 * range);
            const bool bounded = random.uniform() < 0.8;
            box.sides.push_back(bounded ? AxisInterval{low, low + drawn(random, 0.1, 0.5) * range}
                                        : AxisInterval{});
        }
        scene.rules.forbidden.push_back(box);
    }
    for (const Axis& axis : scene.axes) {
        scene.from.push_back(drawn(random, axis.low, axis.high));
        scene.to.push_back(drawn(random, axis.low, axis.high));
    }
    return scene;
}

bool point_is_in(const Scene& scene, const ForbiddenBox& box, const Positions& q, double margin) {
    for (std::size_t i = 0; i < q.size(); ++i) {
        const auto& [low, high] = box.sides[i];
        if (std::isinf(low))
            continue;
        const bool rotary = scene.axes[i].kind == Axis::Kind::rotary;
        const double m = rotary ? margin * pi / 180 : margin;
        double beyond = q[i] - (low - m);
        if (rotary)
            beyond -= 2 * pi * std::floor(beyond / (2 * pi));
        if (!(beyond > 0.0 && beyond < high - low + 2 * m))
            return false;
    }
    return true;
}

bool point_is_free(const Scene& scene, const Positions& q, double margin) {
    return std::ranges::none_of(scene.rules.forbidden, [&](const ForbiddenBox& box) {
        return point_is_in(scene, box, q, margin);
    });
}

// Each axis goes at its own uneven pace.
bool sampled_motion_is_free(const Scene& scene, const MotionSegment& segment,
                            RandomStream& random) {
    Positions pace;
    for (std::size_t i = 0; i < segment.from.size(); ++i)
        pace.push_back(std::exp(2.5 * random.normal()));
    for (int step = 0; step <= 60; ++step) {
        Positions q;
        for (std::size_t i = 0; i < pace.size(); ++i)
            q.push_back(std::lerp(segment.from[i], segment.to[i], std::pow(step / 60.0, pace[i])));
        if (!point_is_free(scene, q, 0.0))
            return false;
    }
    return true;
}

// One axis after the other in some order, in steps finer than the clearance in x and z.
bool some_order_is_free(const Scene& scene) {
    std::vector<std::size_t> order = {0, 1, 2};
    do {
        Positions q = scene.from;
        bool free = true;
        for (const std::size_t axis : order) {
            for (int step = 0; step <= 4000 && free; ++step) {
                q[axis] = std::lerp(scene.from[axis], scene.to[axis], step / 4000.0);
                free = point_is_free(scene, q, 0.05);
            }
        }
        if (free)
            return true;
    } while (std::ranges::next_permutation(order).found);
    return false;
}

TEST(MotionGuard, PlansOnlyWaysThatAreFreeWhateverTheTiming) {
    RandomStream random(5, 3);
    int straight = 0, split = 0, refused = 0;
    for (int i = 0; i < 2000; ++i) {
        const Scene scene = drawn_scene(random);
        if (!point_is_free(scene, scene.to, 0.1) || !point_is_free(scene, scene.from, 0.05))
            continue;
        std::vector<MotionSegment> path;
        try {
            path = plan_motion(scene.axes, scene.rules, scene.from, scene.to, place);
        } catch (const ConfigError&) {
            ++refused;
            EXPECT_FALSE(refused < 40 && some_order_is_free(scene)) << "scene " << i;
            continue;
        }
        (path.size() == 1 ? straight : split) += 1;
        EXPECT_EQ(path.back().to, scene.to);
        for (std::size_t s = 0; s < path.size(); ++s) {
            EXPECT_EQ(path[s].from, s == 0 ? scene.from : path[s - 1].to);
            require_within_limits(scene.axes, path[s].to, place);
            for (int pace = 0; pace < 10; ++pace)
                EXPECT_TRUE(sampled_motion_is_free(scene, path[s], random)) << "scene " << i;
        }
    }
    EXPECT_GT(straight, 100);
    EXPECT_GT(split, 100);
    EXPECT_GT(refused, 20);
}

// ---- limited stage

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
