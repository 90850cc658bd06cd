#include "mocks/stage/stage_registers.h"

#include "tests/test.h"

namespace etalon {
namespace {

// Of the generic profile, as docs/stage.md says them: written out here, not taken from the struct.
constexpr auto holding = RegisterSpace::holding_registers, coils = RegisterSpace::coils;
constexpr int move_block = 100, command = 200, watchdog = 201;
constexpr std::uint16_t enable = 1, home = 2, start = 4, stop = 8, reset = 16;
constexpr std::uint16_t enabled = 1, homed = 2, moving = 4, in_position = 8, alarm = 16;

std::vector<Axis> x_and_rz() {
    return {{.name = "x", .low = -70.0, .high = 500.0, .speed = 100.0},
            {.name = "rz", .kind = Axis::Kind::rotary, .low = -1.0, .high = 2.0, .speed = 1.0}};
}

// 32 bits in two registers, high word first, as the generic profile says.
std::vector<std::uint16_t> registers_of(std::initializer_list<std::uint32_t> numbers) {
    std::vector<std::uint16_t> words;
    for (const std::uint32_t number : numbers) {
        words.push_back(static_cast<std::uint16_t>(number >> 16));
        words.push_back(static_cast<std::uint16_t>(number & 0xFFFFU));
    }
    return words;
}

struct RegistersRig {
    void write(int address, std::vector<std::uint16_t> values) {
        EXPECT_TRUE(registers.write(holding, address, values));
    }
    // 50 mm at 100 mm/s; 5 degrees at 20 degrees per second.
    void write_move() { write(move_block, registers_of({500'000, 1'000'000, 500'000, 2'000'000})); }
    std::uint16_t at(int address) { return registers.read(holding, address, 1)->front(); }
    std::uint16_t status(int axis) { return at(4 * axis); }
    int position(int axis) {
        const auto words = registers.read(holding, 4 * axis + 2, 2).value();
        return words[0] << 16 | words[1];
    }

    VirtualClock clock;
    SimulatedStage stage{x_and_rz(), {}, clock};
    StageRegisters registers{stage, builtin_stage_profile("generic")};
};

struct HomedRegisters : RegistersRig {
    HomedRegisters() {
        write(command, {enable});
        write(command, {enable | home});
        write(command, {enable});
        clock.advance(10s);
    }
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
    HomedRegisters rig;
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
    HomedRegisters rig;
    rig.write_move();
    rig.write(command, {enable | stop | start});
    EXPECT_FALSE(rig.stage.is_moving());
    rig.write(command, {enable | start});
    EXPECT_FALSE(rig.stage.is_moving()) << "start did not rise";
}

TEST(StageRegisters, StopHaltsAMove) {
    HomedRegisters rig;
    rig.write_move();
    rig.write(command, {enable | start});
    rig.clock.advance(200ms);
    rig.write(command, {enable | start | stop});
    rig.clock.advance(51ms);
    EXPECT_EQ(rig.status(0), enabled | homed);
    EXPECT_LT(rig.position(0), 250'000);
}

TEST(StageRegisters, ShowAnAlarmAndResetIt) {
    HomedRegisters rig;
    rig.stage.raise_alarm(7);
    EXPECT_TRUE(rig.status(1) & alarm);
    EXPECT_EQ(rig.at(5), 7);
    rig.write(command, {enable | reset});
    EXPECT_FALSE(rig.status(1) & alarm);
}

TEST(StageRegisters, TheWatchdogStopsAMoveThatNobodyWatches) {
    HomedRegisters rig;
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
    EXPECT_EQ(rig.at(1), StageAlarm::watchdog);
}

TEST(StageRegisters, TheWatchdogLeavesAStageAtRestAlone) {
    HomedRegisters rig;
    rig.write(watchdog, {300});
    rig.clock.advance(10s);
    rig.registers.check_watchdog();
    EXPECT_EQ(rig.status(0) & alarm, 0);
}

TEST(StageRegisters, RegistersThatDoNotExistAreRefusedAndNothingIsWritten) {
    RegistersRig rig;
    EXPECT_FALSE(rig.registers.read(holding, 90, 1));
    EXPECT_FALSE(rig.registers.read(holding, 30, 3)) << "beyond the eighth axis";
    EXPECT_TRUE(rig.registers.read(holding, 30, 2));
    EXPECT_FALSE(rig.registers.read(holding, 65535, 2));
    EXPECT_FALSE(rig.registers.write(holding, 0, std::vector<std::uint16_t>{7})) << "read-only";
    EXPECT_FALSE(rig.registers.write(holding, 131, std::vector<std::uint16_t>{7, 5}));
    EXPECT_EQ(rig.at(131), 0);
    EXPECT_FALSE(rig.registers.write(holding, 201, std::vector<std::uint16_t>{7, 5}));
    EXPECT_EQ(rig.at(201), 0);
}

TEST(StageRegisters, DisablingLosesTheHomePosition) {
    HomedRegisters rig;
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
        {Input::remote, {.space = coils, .address = 7}},
        {Input::enable, {.space = coils, .address = 5, .inverted = true}},
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
    void move_to(std::uint32_t counts, std::uint16_t constant = 3) {
        std::vector<std::uint16_t> words = registers_of({counts, 1'000'000});
        words.push_back(constant);
        write(holding, move_block, words);
    }
    std::uint16_t at(int address) { return registers.read(holding, address, 1)->front(); }
    void home() {
        write(coils, 7, {1});
        write(holding, 30, {0x20});
        clock.advance(10s);
    }

    VirtualClock clock;
    SimulatedStage stage;
    StageRegisters registers{stage, coils_and_codes(), stage.controllers().size() - 1};
};

TEST(StageRegisters, AMotorThatOnlyABitSwitchesOffIsOnFromTheBeginning) {
    CodedRig rig;
    EXPECT_TRUE(rig.stage.status()[0].enabled);
    rig.write(coils, 7, {1});
    rig.write(coils, 5, {1});
    EXPECT_FALSE(rig.stage.status()[0].enabled);
}

TEST(StageRegisters, ACodeActsWheneverItIsWrittenAndReadsAsZero) {
    CodedRig rig;
    rig.home();
    EXPECT_TRUE(rig.stage.status()[0].homed);
    EXPECT_EQ(rig.at(30), 0);
    rig.move_to(500'000);
    rig.clock.advance(200ms);
    rig.write(holding, 30, {0x41});
    EXPECT_TRUE(rig.stage.is_moving()) << "another code";
    rig.write(holding, 30, {0x40});
    rig.clock.advance(51ms);
    EXPECT_FALSE(rig.stage.is_moving());
    rig.write(holding, 30, {0x20});
    EXPECT_TRUE(rig.stage.is_moving()) << "homing again";
}

TEST(StageRegisters, ObeyNothingButStopBeforeTheyAreRemote) {
    CodedRig rig;
    rig.write(holding, 30, {0x20});
    EXPECT_FALSE(rig.stage.is_moving());
    rig.home();
    rig.write(coils, 7, {0});
    rig.move_to(500'000);
    EXPECT_FALSE(rig.stage.is_moving());
    rig.write(coils, 7, {1});
    rig.move_to(500'000);
    rig.clock.advance(100ms);
    rig.write(coils, 7, {0});
    rig.write(holding, 30, {0x40});
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
    EXPECT_EQ(rig.at(0) & (alarm | 1 << 9), 1 << 9);
    rig.stage.raise_alarm(7);
    EXPECT_EQ(rig.at(0) & (alarm | 1 << 9), alarm | 1 << 9);
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
    EXPECT_EQ(first.read(holding, 3, 1)->front(), 0);
    EXPECT_EQ(rig.registers.read(holding, 2, 2), (std::vector<std::uint16_t>{1, 4464}));  // 70 000
}

}  // namespace
}  // namespace etalon
