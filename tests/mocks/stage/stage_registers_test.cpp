#include "mocks/stage/stage_registers.h"

#include <gtest/gtest.h>

#include "stage/link/register_numbers.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

// Of the generic profile, as docs/stage.md says them: written out here, not taken from the struct.
constexpr int move_block = 100, command = 200, watchdog = 201;
constexpr std::uint16_t enable = 1, home = 2, start = 4, stop = 8, reset = 16;
constexpr std::uint16_t enabled = 1, homed = 2, moving = 4, in_position = 8, alarm = 16;

std::vector<Axis> x_and_rz() {
    return {{.name = "x", .low = -70.0, .high = 500.0, .speed = 100.0},
            {.name = "rz", .kind = Axis::Kind::rotary, .low = -1.0, .high = 2.0, .speed = 1.0}};
}

// 32 bits in two registers, high word first, as the generic profile says.
std::pair<std::uint16_t, std::uint16_t> registers_from_int32(std::int32_t value) {
    const auto bits = static_cast<std::uint32_t>(value);
    return {static_cast<std::uint16_t>(bits >> 16), static_cast<std::uint16_t>(bits & 0xFFFFU)};
}
std::int32_t int32_from_registers(std::uint16_t high, std::uint16_t low) {
    return static_cast<std::int32_t>(static_cast<std::uint32_t>(high) << 16 | low);
}

struct RegistersRig {
    void write(int address, std::vector<std::uint16_t> values) {
        EXPECT_TRUE(registers.write(RegisterSpace::holding_registers, address, values));
    }
    void home_all() {
        write(command, {enable});
        write(command, {enable | home});
        write(command, {enable});
        clock.advance(10s);
    }
    // 50 mm at 100 mm/s; 5 degrees at 20 degrees per second.
    void write_move() {
        const auto [x_high, x_low] = registers_from_int32(500'000);
        const auto [vx_high, vx_low] = registers_from_int32(1'000'000);
        const auto [r_high, r_low] = registers_from_int32(500'000);
        const auto [vr_high, vr_low] = registers_from_int32(2'000'000);
        write(move_block, {x_high, x_low, vx_high, vx_low, r_high, r_low, vr_high, vr_low});
    }
    std::uint16_t status(int axis) {
        return registers.read(RegisterSpace::holding_registers, 4 * axis, 1)->front();
    }
    std::int32_t position(int axis) {
        const auto pair = registers.read(RegisterSpace::holding_registers, 4 * axis + 2, 2).value();
        return int32_from_registers(pair[0], pair[1]);
    }

    VirtualClock clock;
    SimulatedStage stage{x_and_rz(), {}, clock};
    StageRegisters registers{stage, builtin_stage_profile("generic")};
};

TEST(StageRegisters, EnableHomeAndMoveByTheDocumentedMap) {
    RegistersRig rig;
    EXPECT_EQ(rig.status(0), 0);
    rig.write(command, {enable});
    EXPECT_EQ(rig.status(0) & ~in_position, enabled);
    rig.write(command, {enable | home});
    EXPECT_EQ(rig.status(1), enabled | moving);
    rig.clock.advance(10s);
    EXPECT_EQ(rig.status(1), enabled | homed | in_position);
    rig.write_move();
    EXPECT_EQ(rig.status(0), enabled | homed | in_position) << "moved before the start";
    rig.write(command, {enable});
    rig.write(command, {enable | start});
    EXPECT_EQ(rig.status(0), enabled | homed | moving);
    rig.clock.advance(10s);
    EXPECT_EQ(rig.status(0), enabled | homed | in_position);
    EXPECT_EQ(rig.position(0), 500'000);
    EXPECT_EQ(rig.position(1), 500'000);
    EXPECT_NEAR(rig.stage.true_positions()[0], 50.0, 1e-9);
    EXPECT_NEAR(rig.stage.true_positions()[1], 0.0872664625997, 1e-9);  // 5 degrees
}

TEST(StageRegisters, AStartThatStaysSetStartsOnce) {
    RegistersRig rig;
    rig.home_all();
    rig.write_move();
    rig.write(command, {enable | start});
    rig.clock.advance(10s);
    rig.write(move_block, {0, 0});
    rig.write(command, {enable | start});
    EXPECT_FALSE(rig.stage.is_moving());
    rig.write(command, {enable});
    rig.write(command, {enable | start});
    EXPECT_TRUE(rig.stage.is_moving());
}

TEST(StageRegisters, NothingStartsWhileStopIsSet) {
    RegistersRig rig;
    rig.home_all();
    rig.write_move();
    rig.write(command, {enable | stop | start});
    EXPECT_FALSE(rig.stage.is_moving());
    rig.write(command, {enable | start});
    EXPECT_FALSE(rig.stage.is_moving()) << "start did not rise";
}

TEST(StageRegisters, StopHaltsAMove) {
    RegistersRig rig;
    rig.home_all();
    rig.write_move();
    rig.write(command, {enable | start});
    rig.clock.advance(200ms);
    rig.write(command, {enable | start | stop});
    rig.clock.advance(51ms);
    EXPECT_EQ(rig.status(0), enabled | homed);
    EXPECT_LT(rig.position(0), 250'000);
}

TEST(StageRegisters, ShowAnAlarmAndResetIt) {
    RegistersRig rig;
    rig.home_all();
    rig.stage.raise_alarm(7);
    EXPECT_TRUE(rig.status(1) & alarm);
    EXPECT_EQ(rig.registers.read(RegisterSpace::holding_registers, 5, 1)->front(), 7);
    rig.write(command, {enable | reset});
    EXPECT_FALSE(rig.status(1) & alarm);
}

TEST(StageRegisters, TheWatchdogStopsAMoveThatNobodyWatches) {
    RegistersRig rig;
    rig.home_all();
    rig.write_move();
    rig.write(watchdog, {200});
    rig.write(command, {enable | start});
    rig.clock.advance(150ms);
    rig.write(watchdog, {200});
    rig.clock.advance(150ms);
    rig.registers.check_watchdog();
    EXPECT_EQ(rig.status(0), enabled | homed | moving);
    rig.clock.advance(51ms);
    rig.registers.check_watchdog();
    rig.clock.advance(51ms);
    EXPECT_EQ(rig.status(0), enabled | homed | alarm);
    EXPECT_EQ(rig.registers.read(RegisterSpace::holding_registers, 1, 1)->front(),
              StageAlarm::watchdog);
}

TEST(StageRegisters, TheWatchdogLeavesAStageAtRestAlone) {
    RegistersRig rig;
    rig.home_all();
    rig.write(watchdog, {300});
    rig.clock.advance(10s);
    rig.registers.check_watchdog();
    EXPECT_EQ(rig.status(0) & alarm, 0);
}

TEST(StageRegisters, RegistersThatDoNotExistAreRefusedAndNothingIsWritten) {
    RegistersRig rig;
    EXPECT_FALSE(rig.registers.read(RegisterSpace::holding_registers, 90, 1));
    EXPECT_FALSE(rig.registers.read(RegisterSpace::holding_registers, 30, 3))
        << "beyond the eighth axis";
    EXPECT_TRUE(rig.registers.read(RegisterSpace::holding_registers, 30, 2));
    EXPECT_FALSE(rig.registers.read(RegisterSpace::holding_registers, 65535, 2));
    EXPECT_FALSE(
        rig.registers.write(RegisterSpace::holding_registers, 0, std::vector<std::uint16_t>{7}))
        << "read-only";
    EXPECT_FALSE(rig.registers.write(RegisterSpace::holding_registers, 131,
                                     std::vector<std::uint16_t>{7, 5}));
    EXPECT_EQ(rig.registers.read(RegisterSpace::holding_registers, 131, 1)->front(), 0);
    EXPECT_FALSE(rig.registers.write(RegisterSpace::holding_registers, 201,
                                     std::vector<std::uint16_t>{7, 5}));
    EXPECT_EQ(rig.registers.read(RegisterSpace::holding_registers, 201, 1)->front(), 0);
}

TEST(StageRegisters, DisablingLosesTheHomePosition) {
    RegistersRig rig;
    rig.home_all();
    rig.write(command, {0});
    EXPECT_EQ(rig.status(0), 0);
    rig.write(command, {enable});
    EXPECT_FALSE(rig.status(0) & homed);
}

// ---- what other profiles say

// A unit of one axis whose input bits are coils, told by codes, and only when it obeys the bus.
StageProfile coils_and_codes() {
    StageProfile profile = builtin_stage_profile("generic");
    profile.max_axes = 1;
    profile.inputs = {
        {Input::remote, {.space = RegisterSpace::coils, .address = 7}},
        {Input::enable, {.space = RegisterSpace::coils, .address = 5, .inverted = true}},
        {Input::home, {.address = 30, .act = InputPoint::Act::code, .code = 0x20}},
        {Input::stop, {.address = 30, .act = InputPoint::Act::code, .code = 0x40}},
    };
    profile.target[0].starts = true;
    profile.target[0].fields.push_back({.type = NumberType::uint16, .constant = 3.0});
    profile.signals[Signal::alarm].push_back({.address = 0, .bit = 9, .inverted = true});
    return profile;
}

struct CodedRig {
    explicit CodedRig(std::vector<Axis> axes = {x_and_rz()[0]})
        : stage(std::move(axes), {}, clock) {}

    void write(RegisterSpace space, int address, std::vector<std::uint16_t> values) {
        EXPECT_TRUE(registers.write(space, address, values));
    }
    void move_to(std::int32_t counts, std::uint16_t constant = 3) {
        const auto [high, low] = registers_from_int32(counts);
        const auto [v_high, v_low] = registers_from_int32(1'000'000);
        write(RegisterSpace::holding_registers, move_block, {high, low, v_high, v_low, constant});
    }
    void home() {
        write(RegisterSpace::coils, 7, {1});
        write(RegisterSpace::holding_registers, 30, {0x20});
        clock.advance(10s);
    }

    VirtualClock clock;
    SimulatedStage stage;
    StageRegisters registers{stage, coils_and_codes(), stage.controllers().size() - 1};
};

TEST(StageRegisters, AMotorThatOnlyABitSwitchesOffIsOnFromTheBeginning) {
    CodedRig rig;
    EXPECT_TRUE(rig.stage.status()[0].enabled);
    rig.write(RegisterSpace::coils, 7, {1});
    rig.write(RegisterSpace::coils, 5, {1});
    EXPECT_FALSE(rig.stage.status()[0].enabled);
}

TEST(StageRegisters, ACodeActsWheneverItIsWrittenAndReadsAsZero) {
    CodedRig rig;
    rig.home();
    EXPECT_TRUE(rig.stage.status()[0].homed);
    EXPECT_EQ(rig.registers.read(RegisterSpace::holding_registers, 30, 1)->front(), 0);
    rig.move_to(500'000);
    rig.clock.advance(200ms);
    rig.write(RegisterSpace::holding_registers, 30, {0x41});
    EXPECT_TRUE(rig.stage.is_moving()) << "another code";
    rig.write(RegisterSpace::holding_registers, 30, {0x40});
    rig.clock.advance(51ms);
    EXPECT_FALSE(rig.stage.is_moving());
    rig.write(RegisterSpace::holding_registers, 30, {0x20});
    EXPECT_TRUE(rig.stage.is_moving()) << "homing again";
}

TEST(StageRegisters, ObeyNothingButStopBeforeTheyAreRemote) {
    CodedRig rig;
    rig.write(RegisterSpace::holding_registers, 30, {0x20});
    EXPECT_FALSE(rig.stage.is_moving());
    rig.home();
    rig.write(RegisterSpace::coils, 7, {0});
    rig.move_to(500'000);
    EXPECT_FALSE(rig.stage.is_moving());
    rig.write(RegisterSpace::coils, 7, {1});
    rig.move_to(500'000);
    rig.clock.advance(100ms);
    rig.write(RegisterSpace::coils, 7, {0});
    rig.write(RegisterSpace::holding_registers, 30, {0x40});
    rig.clock.advance(51ms);
    EXPECT_FALSE(rig.stage.is_moving());
}

TEST(StageRegisters, ATargetThatStartsDoesSoWhenWrittenUnlessItIsOfAnotherKind) {
    CodedRig rig;
    rig.home();
    rig.move_to(70'000);
    EXPECT_TRUE(rig.stage.is_moving());
    rig.clock.advance(10s);
    EXPECT_NEAR(rig.stage.true_positions()[0], 7.0, 1e-9);
    rig.move_to(50'000, 5);
    EXPECT_FALSE(rig.stage.is_moving());
    EXPECT_EQ(rig.stage.status()[0].alarm, StageAlarm::outside_travel);
}

TEST(StageRegisters, ASignalOfSeveralBitsShowsOnTheFirstAndTheOthersAreOff) {
    CodedRig rig;
    EXPECT_EQ(
        rig.registers.read(RegisterSpace::holding_registers, 0, 1)->front() & (alarm | 1 << 9),
        1 << 9);
    rig.stage.raise_alarm(7);
    EXPECT_EQ(
        rig.registers.read(RegisterSpace::holding_registers, 0, 1)->front() & (alarm | 1 << 9),
        alarm | 1 << 9);
}

TEST(StageRegisters, EachUnitHasItsOwnAxes) {
    auto axes = x_and_rz();
    axes[0].unit = 3;
    axes[1] = {.name = "y", .low = -70.0, .high = 500.0, .speed = 100.0, .unit = 5};
    CodedRig rig(axes);
    StageRegisters first(rig.stage, coils_and_codes(), 0);
    rig.home();
    rig.move_to(70'000);
    rig.clock.advance(10s);
    EXPECT_NEAR(rig.stage.true_positions()[1], 7.0, 1e-9);
    EXPECT_FALSE(rig.stage.status()[0].homed);
    EXPECT_EQ(first.read(RegisterSpace::holding_registers, 3, 1)->front(), 0);
    EXPECT_EQ(rig.registers.read(RegisterSpace::holding_registers, 2, 2),
              (std::vector<std::uint16_t>{1, 4464}));  // 70 000
}

}  // namespace
}  // namespace etalon
