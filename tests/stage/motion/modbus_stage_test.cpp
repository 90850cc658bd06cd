// The client of a stage on virtual time: what profiles ask of it beyond the generic one, several
// units on one bus, and what ends a motion. Over real sockets: tests/loopback/stage_test.cpp.
#include "stage/motion/modbus_stage.h"

#include "tests/stage/motion/modbus_rig.h"

namespace etalon {
namespace {

// Writing the target starts the motion; one axis a unit.
const char* const by_target = R"(etalon: stage-profile/1
name: by-target
extends: generic
max_axes: 1
inputs: {start: none}
target: {register: 100, starts: true, read_back: false, fields: [{target: int32}, {speed: int32}]}
sequences:
  move: [{require: [enabled, homed, not moving]}, {write: target}, {wait: done}]
)";

std::vector<Axis> three_units() {
    std::vector<Axis> axes = {{.name = "x", .low = -7.0, .high = 700.0, .speed = 200.0},
                              {.name = "y", .low = -5.0, .high = 500.0, .speed = 100.0},
                              {.name = "z", .low = -3.0, .high = 300.0, .speed = 50.0}};
    for (std::size_t i = 0; i < axes.size(); ++i)
        axes[i].unit = static_cast<int>(2 * i) + 3;  // 3, 5, 7
    return axes;
}

// ---- profiles

TEST(ModbusStageProfiles, CodesCoilsInputsFloatsSignsAndOffsets) {
    Rig rig(by_code);
    auto stage = rig.connect();
    EXPECT_TRUE(stage->status()[0].enabled) << "the twin's motor is on while its coil is off";
    stage->enable({});
    stage->home({});
    stage->move(std::vector{7.125, -0.25}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], 7.125, 0.0026);  // half a count of 5 um
    EXPECT_NEAR(rig.simulation.true_positions()[1], -0.25, 3e-5);    // of 1/300 degree
    EXPECT_NEAR(stage->position()[0], 7.125, 0.0026);
    stage->move(std::vector{5.0, 0.5}, {});
    EXPECT_NEAR(stage->position()[1], 0.5, 3e-5);
    for (const AxisStatus& axis : stage->status())
        EXPECT_TRUE(axis.homed && axis.ready && axis.in_position && !axis.limit);
}

TEST(ModbusStageProfiles, AnAlarmIsSeenThroughAnInvertedInputAndReset) {
    Rig rig(by_code);
    rig.simulation.raise_alarm(17);
    auto stage = rig.connect();
    EXPECT_EQ(stage->status()[1].alarm, 17);
    stage->enable({});
    EXPECT_EQ(stage->status()[1].alarm, 0);
}

// The error of `act`, which gives one command. Its reply is lost; it is never given again.
std::string error_of_lost_reply(Rig& rig, bool carried_out,
                                const std::function<bool(const ModbusRequest&)>& is_command,
                                const std::function<void()>& act) {
    int commands = 0;
    rig.controller.set_script([&](const ModbusRequest& request) {
        const bool lost = is_command(request);
        commands += lost;
        return ModbusReaction{.carry_out = carried_out || !lost, .reply = !lost};
    });
    const std::string error = device_error_of(act);
    rig.controller.set_script([](const ModbusRequest&) { return ModbusReaction{}; });
    EXPECT_EQ(commands, 1);
    EXPECT_EQ(error == "no error", carried_out) << error;
    return error;
}

bool gives_code(const ModbusRequest& request, int code) {
    return writes_to(request, 0x6002) && request.values[0] == code;
}

TEST(ModbusStageProfiles, AStartByCodeWhoseReplyIsLostIsSeenAndNotRepeated) {
    for (const bool carried_out : {true, false}) {
        HomedRig rig(by_code);
        const std::string error = error_of_lost_reply(
            rig, carried_out, [](const ModbusRequest& r) { return gives_code(r, 0x10); },
            [&] {
                rig.stage->move(std::vector{70.0, 0.5}, {});
            });
        EXPECT_FALSE(rig.simulation.is_moving());
        if (carried_out) {
            EXPECT_NEAR(rig.stage->position()[0], 70.0, 0.003);
        } else {
            EXPECT_THAT(error,
                        HasSubstr("no axis was seen to start; it is not given again; the axes "
                                  "were stopped"));
            EXPECT_NEAR(rig.simulation.true_positions()[0], 0.0, 1e-9);
        }
    }
}

TEST(ModbusStageProfiles, AHomingByCodeWhoseReplyIsLostIsSeenAndNotRepeated) {
    for (const bool carried_out : {true, false}) {
        Rig rig(by_code);
        auto stage = rig.connect();
        stage->enable({});
        error_of_lost_reply(
            rig, carried_out, [](const ModbusRequest& r) { return gives_code(r, 0x20); },
            [&] { stage->home({}); });
    }
}

TEST(ModbusStageProfiles, ATargetThatStartsAndWhoseReplyIsLostIsSeenAndNotRepeated) {
    for (const bool carried_out : {true, false}) {
        HomedRig rig(by_target, {fast_axes()[0]});
        error_of_lost_reply(
            rig, carried_out, [](const ModbusRequest& r) { return writes_to(r, 100); },
            [&] { rig.stage->move(std::vector{70.0}, {}); });
        EXPECT_FALSE(rig.simulation.is_moving());
    }
}

TEST(ModbusStageProfiles, AnAlarmWithoutItsCodeIsSaidSo) {
    StageProfile profile = builtin_stage_profile("generic");
    profile.alarm_code.reset();
    HomedRig rig(profile);
    rig.once_beyond(20.0, [&] { rig.simulation.raise_alarm(17); });
    EXPECT_THAT(error_of_move(*rig.stage, {600.0, 1.0}),
                HasSubstr("axis x: alarm without a code; the axes were stopped"));
}

TEST(ModbusStageProfiles, OtherBitsOfAnInputsRegisterStayAsTheyWere) {
    Rig rig;
    rig.controller.handle({.function = 6, .address = command, .count = 1, .values = {0x4000}});
    auto stage = rig.connect_and_home();
    stage->move(std::vector{7.0, 0.5}, {});
    EXPECT_TRUE(stage->stop());
    for (const ModbusRequest& request : rig.controller.writes()) {
        if (request.address == command) {
            EXPECT_TRUE(request.values[0] & 0x4000);
        }
    }
}

// A start bit that somebody left on would be no edge.
TEST(ModbusStageProfiles, AnEdgeThatIsOnAlreadyGoesOffFirst) {
    HomedRig rig;
    rig.stage.reset();
    rig.controller.handle({.function = 6, .address = command, .count = 1, .values = {0x5}});
    rig.stage = rig.connect_and_home();
    rig.stage->move(std::vector{7.0, 0.5}, {});
    EXPECT_NEAR(rig.stage->position()[0], 7.0, 1e-9);
}

// ---- what ends a motion

struct Disturbance {
    const char* name;
    std::function<void(SimulatedStage&)> happens;
    const char* cause;
};
void PrintTo(const Disturbance& disturbance, std::ostream* stream) {
    *stream << disturbance.name;
}

class ADisturbedMove : public testing::TestWithParam<Disturbance> {};

TEST_P(ADisturbedMove, IsStoppedWithTheNextRequestAndSaysWhy) {
    HomedRig rig;
    rig.once_beyond(20.0, [&] { GetParam().happens(rig.simulation); });
    const std::string error = error_of_move(*rig.stage, {600.0, 1.0});
    EXPECT_THAT(error, HasSubstr(std::string("move: ") + GetParam().cause));
    EXPECT_THAT(error, HasSubstr("; the axes were stopped"));
    ASSERT_FALSE(rig.requests.empty());
    EXPECT_TRUE(gives(rig.requests.front(), stop_bit));
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_THAT(error_of_move(*rig.stage, {7.0, 0.5}), HasSubstr("faulted"));
}

INSTANTIATE_TEST_SUITE_P(
    ModbusStage, ADisturbedMove,
    testing::Values(
        Disturbance{"Alarm", [](SimulatedStage& s) { s.raise_alarm(17); }, "axis x: alarm 17"},
        Disturbance{"EmergencyStop", [](SimulatedStage& s) { s.press_emergency_stop(); },
                    "axis x: emergency stop"},
        Disturbance{"Limit", [](SimulatedStage& s) { s.hit_limit(0); },
                    "axis x is at a limit switch"},
        Disturbance{"LimitOfTheOtherAxis", [](SimulatedStage& s) { s.hit_limit(1); },
                    "axis rz is at a limit switch"},
        Disturbance{"Disabled", [](SimulatedStage& s) { s.enable(false); },
                    "axis x is not enabled any more"},
        Disturbance{"EncoderJump", [](SimulatedStage& s) { s.jump_encoder(0, 30.0); },
                    "axis x cannot have come so far"}),
    [](const auto& test) { return std::string(test.param.name); });

// ---- another master

// What `etalon stage stop` does beside a run.
void stop_from_elsewhere(Rig& rig) {
    EXPECT_TRUE(rig.connect(Opening::asks_nothing)->stop());
}

TEST(ModbusStageMoves, AStopByAnotherMasterEndsTheMove) {
    HomedRig rig;
    rig.once_beyond(20.0, [&] { stop_from_elsewhere(rig); });
    const Instant begin = rig.clock.now();
    EXPECT_THAT(
        error_of_move(*rig.stage, {600.0, 1.0}),
        HasSubstr("move: another program or the operator stopped the stage: command register "
                  "200 reads 0x1 and was left at 0x5; the axes were stopped"));
    EXPECT_LT(rig.clock.now() - begin, 500ms);
    EXPECT_LT(rig.simulation.true_positions()[0], 100.0);
}

// By a panel: the commands read as they were left.
TEST(ModbusStageMoves, AStopThatNoCommandTellsEndsTheMoveAtItsTimeLimit) {
    HomedRig rig;
    rig.once_beyond(20.0, [&] { rig.simulation.stop(); });
    EXPECT_THAT(error_of_move(*rig.stage, {600.0, 1.0}),
                HasSubstr("; nothing moves: another program or the operator may have stopped it"));
}

TEST(ModbusStageMoves, AStopByAnotherMasterAtRestKeepsTheNextMoveFromStarting) {
    HomedRig rig;
    rig.stage->move(std::vector{70.0, 0.5}, {});
    stop_from_elsewhere(rig);
    EXPECT_THAT(error_of_move(*rig.stage, {50.0, 1.0}),
                HasSubstr("another program or the operator stopped the stage"));
    EXPECT_EQ(rig.simulation.moves_started(), 1);
    EXPECT_NEAR(rig.simulation.true_positions()[0], 70.0, 1e-3);
}

TEST(ModbusStageProfiles, AxesMustFitEveryRegisterThatCountsThem) {
    Rig rig;
    rig.profile.position.type = NumberType::int16;  // 3.2767 mm at 10 000 counts per mm
    EXPECT_THROW(rig.connect(), ConfigError);
    rig.profile.counts.per_mm = rig.profile.counts.per_deg = 40.0;
    rig.profile.done.tolerance_mm = 0.03;
    rig.profile.done.tolerance_deg = 0.03;
    EXPECT_NO_THROW(rig.connect());
}

TEST(ModbusStageMoves, AFalseInPositionIsNoArrival) {
    Rig rig;
    rig.profile.limits.move_margin = 300ms;
    auto stage = rig.connect_and_home();
    rig.once_beyond(20.0, [&] { rig.simulation.claim_arrival(0); });
    stage->move(std::vector{70.0, 0.5}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], 70.0, 1e-3);
}

TEST(ModbusStageMoves, NothingStartsFromWhereTheAxesWereNotLeft) {
    HomedRig rig;
    rig.stage->move(std::vector{70.0, 0.5}, {});
    rig.simulation.jump_encoder(0, 0.02);
    const std::size_t before = rig.controller.writes().size();
    EXPECT_THAT(error_of_move(*rig.stage, {50.0, 0.5}),
                HasSubstr("the axes are not where they were left: x at 70.0200 mm"));
    for (const ModbusRequest& request : rig.writes_since(before))
        EXPECT_FALSE(gives(request, start_bit));
}

// So does reading: at the last pose of a run nothing starts any more.
TEST(ModbusStageMoves, APushedAxisIsNoticedWhenThePositionsAreRead) {
    HomedRig rig;
    rig.stage->move(std::vector{70.0, 0.5}, {});
    EXPECT_NEAR(rig.stage->position()[1], 0.5, 1e-6);
    rig.simulation.jump_encoder(0, 0.02);
    const std::string error = device_error_of([&] { rig.stage->position(); });
    EXPECT_THAT(
        error,
        HasSubstr("read the positions: the axes are not where they were left: x at 70.0200 mm"));
    EXPECT_NO_THROW(rig.stage->status()) << "looking is allowed";
}

TEST(ModbusStageMoves, NothingStartsWhenInterruptedBefore) {
    HomedRig rig;
    std::stop_source interrupt;
    interrupt.request_stop();
    EXPECT_THROW(rig.stage->move(std::vector{70.0, 0.5}, interrupt.get_token()), Interrupted);
    EXPECT_EQ(rig.simulation.moves_started(), 0);
    rig.stage->move(std::vector{7.0, 0.5}, {});
}

TEST(ModbusStageMoves, AnInterruptionSaysWhenItsStopWasNotConfirmed) {
    HomedRig rig;
    std::stop_source interrupt;
    rig.once_beyond(20.0, [&] {
        interrupt.request_stop();
        rig.controller.set_script([](const ModbusRequest& request) {
            const bool read = request.values.empty();
            return ModbusReaction{.carry_out = read, .reply = read};
        });
    });
    EXPECT_THAT(error_of_move(*rig.stage, {600.0, 1.0}, interrupt.get_token()),
                HasSubstr("interrupted; the stop was NOT confirmed"));
    EXPECT_THAT(error_of_move(*rig.stage, {7.0, 0.5}), HasSubstr("faulted"));
}

// While it is on the controller ignores homing, and says "homed" since an earlier one.
TEST(ModbusStageMoves, AStopThatWasLeftOnIsEndedBeforeHoming) {
    HomedRig rig;
    rig.stage->move(std::vector{70.0, 0.5}, {});
    rig.stage.reset();
    rig.controller.handle(
        {.function = 6, .address = command, .count = 1, .values = {enable_bit | stop_bit}});
    EXPECT_THAT(device_error_of([&] { rig.connect()->resume(); }), HasSubstr("stop is still on"));
    rig.stage = rig.connect_and_home();
    EXPECT_NEAR(rig.simulation.true_positions()[0], 0.0, 1e-9);
    rig.stage->move(std::vector{7.0, 0.5}, {});
}

TEST(ModbusStageMoves, TheWatchdogIsFedWhileALongMoveLasts) {
    HomedRig rig;
    rig.stage->limit_speed(0.1);  // 680 mm at 20 mm/s: 34 s with a watchdog of 1.5 s
    rig.stage->move(std::vector{680.0, 0.5}, {});
    EXPECT_GT(rig.simulation.uptime(), 34s);
    EXPECT_NEAR(rig.stage->position()[0], 680.0, 1e-3);
}

TEST(ModbusStageMoves, ALimitedSpeedIsWhatTheControllerIsTold) {
    HomedRig rig;
    rig.stage->limit_speed(0.25);
    const Instant start = rig.clock.now();
    rig.stage->move(std::vector{100.0, 0.0}, {});  // at 50 mm/s
    EXPECT_NEAR(std::chrono::duration<double>(rig.clock.now() - start).count(), 2.07, 0.05);
    EXPECT_THROW(rig.stage->limit_speed(0.0), ConfigError);
    EXPECT_THROW(rig.stage->limit_speed(1.01), ConfigError);
}

// ---- several units on one bus

TEST(ModbusStageUnits, AllTargetsAreWrittenBeforeAnyUnitStarts) {
    HomedRig rig(builtin_stage_profile("generic"), three_units());
    const std::size_t before = rig.controller.writes().size();
    rig.stage->move(std::vector{70.0, 50.0, 30.0}, {});
    EXPECT_NEAR(rig.stage->position()[0], 70.0, 1e-9);
    EXPECT_NEAR(rig.stage->position()[2], 30.0, 1e-9);
    std::vector<int> targets, starts;
    for (const ModbusRequest& request : rig.writes_since(before)) {
        if (writes_to(request, 100)) {
            EXPECT_TRUE(starts.empty());
            targets.push_back(request.unit);
        }
        if (gives(request, start_bit))
            starts.push_back(request.unit);
    }
    EXPECT_EQ(targets, (std::vector{3, 5, 7}));
    EXPECT_EQ(starts, (std::vector{3, 5, 7}));
}

TEST(ModbusStageUnits, AnAlarmOfOneStopsAll) {
    HomedRig rig(builtin_stage_profile("generic"), three_units());
    rig.once_beyond(20.0, [&] { rig.simulation.raise_alarm(17, 1); });
    EXPECT_THAT(error_of_move(*rig.stage, {600.0, 400.0, 200.0}),
                HasSubstr("axis y: alarm 17; the axes were stopped"));
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_LT(rig.simulation.true_positions()[0], 50.0);
}

// Unit 5 falls silent in mid-move. The others are stopped at once; it stops by its own watchdog.
TEST(ModbusStageUnits, ASilentOneKeepsNoOtherFromBeingStopped) {
    Rig rig(builtin_stage_profile("generic"), three_units());
    std::set<int> stopped;
    bool silent = false;
    auto stage = rig.connect_and_home();
    rig.controller.set_script([&](const ModbusRequest& request) {
        silent = silent || rig.simulation.true_positions()[0] > 20.0;
        const bool lost = silent && request.unit == 5;
        if (!lost && gives(request, stop_bit))
            stopped.insert(request.unit);
        return ModbusReaction{.carry_out = !lost, .reply = !lost};
    });
    const Instant start = rig.clock.now();
    EXPECT_THAT(error_of_move(*stage, {600.0, 400.0, 200.0}),
                HasSubstr("no answer within 100 ms; the stop was NOT confirmed"));
    EXPECT_EQ(stopped, (std::set{3, 7}));
    EXPECT_LT(rig.clock.now() - start, 3500ms);
    EXPECT_FALSE(rig.simulation.is_moving());
}

// As `etalon stage move --trace | head`.
TEST(ModbusStageUnits, ATraceThatCannotBeWrittenKeepsNoneFromBeingStopped) {
    HomedRig rig(builtin_stage_profile("generic"), three_units());
    rig.stage->set_trace([&](const std::string&) {
        if (rig.simulation.true_positions()[0] > 20.0)
            throw std::runtime_error("broken pipe");
    });
    EXPECT_THROW(rig.stage->move(std::vector{600.0, 400.0, 200.0}, {}), std::runtime_error);
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_LT(rig.simulation.true_positions()[0], 50.0);
}

// `etalon stage stop` while unit 5 is silent and another program's motion goes on.
TEST(ModbusStageUnits, ASilentOneKeepsNoOtherFromBeingStoppedByHand) {
    Rig rig(builtin_stage_profile("generic"), three_units());
    auto moving = rig.connect_and_home();
    bool stopped = true;
    const auto stop_by_hand = [&] {
        rig.controller.set_script([](const ModbusRequest& request) {
            const bool answers = request.unit != 5;
            return ModbusReaction{.carry_out = answers, .reply = answers};
        });
        stopped = rig.connect(Opening::asks_nothing)->stop();
    };
    rig.once_beyond(20.0, stop_by_hand);
    EXPECT_THROW(moving->move(std::vector{600.0, 400.0, 200.0}, {}), DeviceError);
    EXPECT_FALSE(stopped);
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_LT(rig.simulation.true_positions()[0], 50.0);
}

TEST(ModbusStageUnits, StoppingByHandLeavesTheMotorsOn) {
    for (const bool reads : {true, false}) {
        Rig rig;
        rig.connect_and_home().reset();
        rig.controller.set_script([&](const ModbusRequest& request) {
            const bool lost = !reads && request.values.empty() && request.address == command;
            return ModbusReaction{.carry_out = !lost, .reply = !lost};
        });
        EXPECT_TRUE(rig.connect(Opening::asks_nothing)->stop());
        for (const AxisStatus& axis : rig.simulation.status())
            EXPECT_TRUE(axis.enabled && axis.homed);
    }
}

TEST(ModbusStageUnits, TheAxesOfAUnitMustStandTogetherAndFit) {
    Rig rig(by_target, three_units());
    const auto open = [&](std::vector<Axis> axes) {
        open_modbus_stage(StageLink{}, rig.profile, std::move(axes), rig.clock,
                          std::make_unique<MemoryTransport>(rig.controller, rig.clock, false));
    };
    auto axes = three_units();
    axes[2].unit = 3;
    EXPECT_THROW(open(axes), ConfigError);
    axes = three_units();
    axes[1].unit = 3;  // two axes of a profile for one
    EXPECT_THROW(open(axes), ConfigError);
    open(three_units());
}

}  // namespace
}  // namespace etalon
