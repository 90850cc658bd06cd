// The station's own client against a stage that moves, errs and fails as twin.yaml can say, in
// memory and on virtual time.

#include "stage/motion/modbus_stage.h"
#include "tests/fakes/memory_transport.h"
#include "tests/mocks/stage/two_axes.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Kind = StageFault::Kind;
using When = FaultTrigger::When;

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
