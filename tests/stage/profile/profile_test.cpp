#include "stage/profile/profile.h"

#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {
namespace {

const std::string valid = R"(etalon: stage-profile/1
name: test
about: a controller of three axes
confirmed: [this much]
unconfirmed: [that, and that]
max_axes: 3
link: {transport: rtu, baud: 19200, parity: even}
word_order: low_first
counts: {per_mm: 500, per_deg: 70, sign: -1, offset: 9}
speed: {unit: counts_per_s, step: 4}
poll:
  - {space: holding, address: 10, count: 4, stride: 5}
  - {space: discrete_inputs, address: 3, count: 2, stride: 0}
position: {register: 12, type: int32}
alarm_code: {register: 10, type: uint16}
signals:
  enabled: {register: 11, bit: 5}
  ready: unavailable
  homed: {register: 11, bit: 7}
  moving: {register: 11, bit: 11}
  homing: unavailable
  in_position: {register: 11, bit: 13}
  alarm: [{register: 11, bit: 2}, {discrete_input: 3, inverted: true}]
  emergency_stop: {discrete_input: 4}
  limit: unavailable
inputs:
  remote: none
  enable: {register: 60, bit: 3, act: level, inverted: true}
  home: {register: 61, act: code, code: 0x20}
  start: {coil: 60, act: edge, read_back: false}
  stop: {register: 61, act: code, code: 0x40}
  reset: {register: 60, bit: 15, act: edge}
target: {register: 40, starts: false, read_back: true, fields: [{constant: 1, type: uint16}, {speed: uint16}, {target: int32}]}
sequences:
  enable: [{set: enable}, {wait: [enabled], within_ms: 100}]
  reset: [{pulse: reset}, {wait: [not alarm], within_ms: 110}]
  home: [{pulse: home}, {wait: [homed, not moving], within_ms: 200, for_ms: 40}]
  move: [{require: [homed, not moving]}, {write: target}, {pulse: start}, {wait: done}]
  stop: [{pulse: stop}, {wait: [not moving], within_ms: 1500}]
watchdog: {register: 70, timeout_ms: 1700}
done: {in_position: true, start_seen: true, tolerance_um: 7, tolerance_deg: 0.05, stable_polls: 5, settle_ms: 30}
limits: {move_factor: 1.25, move_margin_ms: 300}
alarms: {7: too hot}
)";

std::string replaced(const std::string& from, const std::string& to) {
    std::string text = valid;
    const auto at = text.find(from);
    return at == std::string::npos ? "not in the text: " + from : text.replace(at, from.size(), to);
}

std::string error_of(const std::string& text) {
    return config_error_of([&] { stage_profile_from_text(text, "p.yaml"); });
}

// A part of the valid file, what stands there instead, and the error behind the file's name.
struct Fault {
    const char *part, *instead, *error;
};

void expect_errors(std::initializer_list<Fault> faults) {
    for (const auto& [part, instead, error] : faults)
        EXPECT_EQ(error_of(replaced(part, instead)), std::string("p.yaml:") + error);
}

TEST(StageProfile, IsReadKeyByKey) {
    const StageProfile profile = stage_profile_from_text(valid, "p.yaml");
    EXPECT_EQ(profile.name, "test");
    EXPECT_EQ(profile.about, "a controller of three axes");
    EXPECT_EQ(profile.unconfirmed, (std::vector<std::string>{"that", "and that"}));
    EXPECT_EQ(profile.max_axes, 3);
    EXPECT_EQ(profile.link.transport, LinkDefaults::Transport::rtu);
    EXPECT_EQ(profile.link.serial.baud, 19200);
    EXPECT_EQ(profile.word_order, WordOrder::low_first);
    ASSERT_EQ(profile.poll.size(), 2U);
    EXPECT_EQ(profile.poll[0].stride, 5);
    EXPECT_EQ(profile.poll[1].space, RegisterSpace::discrete_inputs);
    EXPECT_EQ(profile.poll[1].stride, 0);
    EXPECT_EQ(profile.position.address, 12);
    ASSERT_TRUE(profile.alarm_code.has_value());
    EXPECT_EQ(profile.alarm_code->type, NumberType::uint16);
    EXPECT_FALSE(profile.has(Signal::ready));
    ASSERT_EQ(profile.signals.at(Signal::alarm).size(), 2U);
    EXPECT_TRUE(profile.signals.at(Signal::alarm)[1].inverted);
    EXPECT_EQ(profile.signals.at(Signal::in_position)[0].bit, 13);
    ASSERT_TRUE(profile.watchdog.has_value());
    EXPECT_EQ(profile.watchdog->timeout, 1700ms);
    EXPECT_EQ(profile.done.stable_polls, 5);
    EXPECT_TRUE(profile.done.start_seen);
    EXPECT_EQ(profile.limits.move_margin, 300ms);
    EXPECT_EQ(profile.describe_alarm(7), "alarm 7 (too hot)");
    EXPECT_EQ(profile.describe_alarm(5), "alarm 5");
}

TEST(StageProfile, InputsTargetsAndSequencesAreRead) {
    const StageProfile profile = stage_profile_from_text(valid, "p.yaml");
    EXPECT_FALSE(profile.inputs.contains(Input::remote));
    EXPECT_TRUE(profile.inputs.at(Input::enable).inverted);
    EXPECT_EQ(profile.inputs.at(Input::home).act, InputPoint::Act::code);
    EXPECT_EQ(profile.inputs.at(Input::home).code, 0x20);
    EXPECT_FALSE(profile.inputs.at(Input::home).read_back);
    EXPECT_EQ(profile.inputs.at(Input::start).space, RegisterSpace::coils);
    EXPECT_FALSE(profile.inputs.at(Input::start).read_back);
    EXPECT_TRUE(profile.inputs.at(Input::reset).read_back);
    ASSERT_EQ(profile.target.size(), 1U);
    EXPECT_EQ(profile.target[0].size(), 4);
    EXPECT_EQ(profile.target[0].fields[0].constant, 1.0);
    EXPECT_EQ(profile.target[0].fields[2].is, TargetBlock::Field::Is::target);
    const auto& home = profile.sequences.home;
    ASSERT_EQ(home.size(), 2U);
    EXPECT_EQ(home[0].kind, Step::Kind::pulse);
    EXPECT_TRUE(starts_motion(profile, home[0]));
    EXPECT_EQ(home[1].within, 200ms);
    EXPECT_EQ(home[1].held, 40ms);
    ASSERT_EQ(home[1].conditions.size(), 2U);
    EXPECT_EQ(home[1].conditions[1].signal, Signal::moving);
    EXPECT_FALSE(home[1].conditions[1].on);
    EXPECT_EQ(profile.sequences.move[3].kind, Step::Kind::wait_done);
    EXPECT_FALSE(starts_motion(profile, profile.sequences.move[1]));
}

TEST(StageProfile, ConvertsMillimetresAndRadiansToCounts) {
    const StageProfile profile = stage_profile_from_text(valid, "p.yaml");
    Axis axis;
    EXPECT_DOUBLE_EQ(profile.counts_of(axis, 2.0), 9.0 - 1000.0);
    EXPECT_DOUBLE_EQ(profile.position_of(axis, -991.0), 2.0);
    EXPECT_DOUBLE_EQ(profile.register_of_speed(axis, 2.0), 250.0);
    EXPECT_DOUBLE_EQ(profile.speed_of_register(axis, 250.0), 2.0);
    EXPECT_DOUBLE_EQ(profile.tolerance(axis), 0.007);
    axis.kind = Axis::Kind::rotary;
    EXPECT_DOUBLE_EQ(profile.counts_of(axis, std::numbers::pi), 9.0 - 70.0 * 180.0);
    EXPECT_DOUBLE_EQ(profile.tolerance(axis), 0.05 * std::numbers::pi / 180.0);
}

TEST(StageProfile, AnAxisMaySayItsOwnCountsAndLead) {
    std::string text = replaced("{per_mm: 500, per_deg: 70, sign: -1, offset: 9}", "{from: axis}");
    text.replace(text.find("{unit: counts_per_s, step: 4}"), 29, "{unit: rpm}");
    const StageProfile profile = stage_profile_from_text(text, "p.yaml");
    Axis axis{.name = "x"};
    EXPECT_THROW(profile.counts_of(axis, 2.0), ConfigError);
    EXPECT_THROW(profile.register_of_speed(axis, 20.0), ConfigError);
    axis.counts_per_unit = -300.0;
    axis.lead = 5.0;
    EXPECT_DOUBLE_EQ(profile.counts_of(axis, 2.0), -600.0);
    EXPECT_DOUBLE_EQ(profile.register_of_speed(axis, 20.0), 240.0);  // 4 turns a second
}

TEST(StageProfile, NamesFileLineAndKeyOfRegistersThatAreWrong) {
    expect_errors(
        {{"count: 4, stride: 5", "count: 4, stride: 63",
          "12: poll[0]: 130 registers do not fit into one request of 125"},
         {"count: 4, stride: 5", "count: 4, stride: 3",
          "12: poll[0].stride: the axes' 4 registers overlap"},
         {"count: 4, stride: 5", "count: 4", "12: poll[0].stride: missing"},
         {"{space: discrete_inputs, address: 3", "{space: holding, address: 23",
          "13: poll[1]: overlaps with another block"},
         {"register: 12, type", "register: 13, type", "14: position: lies in no block of 'poll'"},
         {"{register: 10, type", "{register: 12, type",
          "15: alarm_code: register 12 is 'position' already"},
         {"register: 10, type: uint16", "register: 10, type: float32",
          "15: alarm_code: must be a whole number"},
         {"bit: 7", "bit: 5", "19: signals.homed: this bit of register 11 is 'enabled' already"},
         {"bit: 7", "bit: 16", "19: signals.homed.bit: must be between 0 and 15, not 16"},
         {"  limit: unavailable\n", "", "17: signals.limit: missing"},
         {"moving: {register: 11, bit: 11}", "moving: unavailable",
          "20: signals.moving: must be available: without it no motion is safe"},
         {"{coil: 60, act", "{discrete_input: 60, act",
          "30: inputs.start: cannot be written: an input needs 'register' or 'coil'"},
         {"{coil: 60, act", "{coil: 60, register: 60, act",
          "30: inputs.start.coil: is at 'register' already"},
         {"code: 0x40", "code: 0x20", "31: inputs.stop.code: code 32 is used twice"},
         {"bit: 15", "bit: 3", "32: inputs.reset: this bit of register 60 is 'enable' already"},
         {"{register: 60, bit: 15", "{register: 20, bit: 15",
          "32: inputs.reset: register 20 lies in a block that is polled"},
         {"{register: 40", "{register: 49", "33: target: register 60 is 'enable' already"},
         {"{register: 40", "{register: 65530", "33: target: reaches beyond register 65535"},
         {"{speed: uint16}", "{target: int16}",
          "33: target: must have one target and one speed, not 2 and 0"},
         {"{register: 70", "{register: 61", "40: watchdog: register 61 is 'home' already"}});
}

TEST(StageProfile, NamesFileLineAndKeyOfSequencesThatAreWrong) {
    expect_errors(
        {{"{set: enable}", "{set: remote}",
          "35: sequences.enable[0].set: this controller has no input 'remote'"},
         {"{set: enable}, ", "", "28: inputs.enable: is used in no sequence"},
         {"{pulse: home}", "{set: home}",
          "37: sequences.home[0].set: 'home' is a code: it can only be pulsed"},
         {"[homed, not moving], within", "[ready, not moving], within",
          "37: sequences.home[1].wait[0]: signal 'ready' is unavailable"},
         {"[homed, not moving], within", "[homed], within",
          "37: sequences.home: must wait for 'not moving' after the start"},
         {"[enabled], within_ms: 100", "[not resting], within_ms: 100",
          "35: sequences.enable[1].wait[0]: there is no signal 'resting'"},
         {"{set: enable}", "{set: enable}, {pulse: start}",
          "35: sequences.enable: may not set anything in motion"},
         {"{pulse: start}, ", "{pulse: start}, {pulse: start}, ",
          "38: sequences.move: must start a motion exactly once, not 2 times"},
         {"starts: false", "starts: true",
          "38: sequences.move: must start a motion exactly once, not 2 times"},
         {"{write: target}, {pulse: start}", "{pulse: start}, {write: target}",
          "38: sequences.move: must write the target once, not after the start"},
         {", {wait: done}", "", "38: sequences.move: must wait for 'done' once, after the start"},
         {"stop: [", "stop: [{wait: [homed], within_ms: 5}, ",
          "39: sequences.stop: may not wait before it gives 'stop'"},
         {"within_ms: 1500", "within_ms: 15000",
          "39: sequences.stop: may not take more than 3000 ms"},
         {"[not alarm]", "[enabled]", "36: sequences.reset: must wait for 'not alarm'"}});
}

TEST(StageProfile, NamesFileLineAndKeyOfEveryOtherFault) {
    expect_errors(
        {{"per_mm: 500", "per_mm: 0",
          "9: counts.per_mm: must be between 0.001 and 10000000000 counts, not 0"},
         {"stable_polls: 5, ", "", "41: done.stable_polls: missing"},
         {"bit: 15, act", "bit: 15, brake: 4, act", "32: inputs.reset.brake: unknown key"},
         {"{7: too hot}", "{hot: too hot}",
          "43: alarms.hot: an alarm's key must be its code, 1 to 65535"},
         {"in_position: {register: 11, bit: 13}", "in_position: unavailable",
          "41: done.in_position: signal 'in_position' is unavailable"}});
}

class ExtendingProfile : public testing::Test {
protected:
    void write(const std::string& name, const std::string& text) {
        std::ofstream(folder_.path() / name) << text;
    }
    StageProfile read(const std::string& name) { return read_stage_profile(folder_.path() / name); }
    std::string error_of(const std::string& name) {
        const std::string path = folder_.path().string() + "/";
        const std::string text = config_error_of([&] { read(name); });
        return text.starts_with(path) ? text.substr(path.size()) : text;
    }
    TemporaryFolder folder_;
};

TEST_F(ExtendingProfile, MergesMappingsKeyByKeyAndReplacesTheRest) {
    write("base.yaml", valid);
    write("child.yaml", R"(etalon: stage-profile/1
name: child
extends: base
done: {tolerance_um: 3}
signals: {alarm: {register: 11, bit: 1}}
confirmed: [all]
watchdog: ~
)");
    write("grandchild.yaml",
          "etalon: stage-profile/1\nname: grandchild\nextends: child\ndone: {stable_polls: 2}\n");
    const StageProfile profile = read("grandchild.yaml");
    EXPECT_EQ(profile.name, "grandchild");
    EXPECT_EQ(profile.about, "a controller of three axes");
    EXPECT_DOUBLE_EQ(profile.done.tolerance_mm, 0.003);
    EXPECT_DOUBLE_EQ(profile.done.tolerance_deg, 0.05);
    EXPECT_EQ(profile.done.stable_polls, 2);
    ASSERT_EQ(profile.signals.at(Signal::alarm).size(), 1U);
    EXPECT_EQ(profile.signals.at(Signal::alarm)[0].bit, 1);
    EXPECT_EQ(profile.signals.at(Signal::homed)[0].bit, 7);
    EXPECT_EQ(profile.confirmed, std::vector<std::string>{"all"});
    EXPECT_FALSE(profile.watchdog.has_value());
}

TEST_F(ExtendingProfile, NamesTheFileThatTheFaultStandsIn) {
    write("base.yaml", replaced("bit: 7", "bit: 17"));
    write("child.yaml", "etalon: stage-profile/1\nname: child\nextends: base\n");
    EXPECT_EQ(error_of("child.yaml"),
              "base.yaml:19: signals.homed.bit: must be between 0 and 15, not 17");
    write("base.yaml", valid + "brake: 7\n");
    EXPECT_EQ(error_of("child.yaml"), "base.yaml:44: brake: unknown key; did you mean 'name'?");
    write("base.yaml", valid);
    write("child.yaml", "etalon: stage-profile/1\nname: child\nextends: base\nbrake: 5\n");
    EXPECT_EQ(error_of("child.yaml"), "child.yaml:4: brake: unknown key; did you mean 'name'?");
}

TEST_F(ExtendingProfile, MayExtendWhatIsBuiltInButNothingElseThatIsNotThere) {
    write("mine.yaml", "etalon: stage-profile/1\nname: mine\nextends: generic\nmax_axes: 5\n");
    EXPECT_EQ(read("mine.yaml").max_axes, 5);
    write("lost.yaml", "etalon: stage-profile/1\nname: lost\nextends: nobody\n");
    EXPECT_THAT(error_of("lost.yaml"), HasSubstr("lost.yaml:3: extends: there is no"));
    write("ring.yaml", "etalon: stage-profile/1\nname: ring\nextends: ring\n");
    EXPECT_EQ(error_of("ring.yaml"),
              "ring.yaml:3: extends: more than 8 profiles extend each other");
}

TEST(StageProfile, AnUnknownNameIsRefusedWithTheKnownOnes) {
    const std::string text = config_error_of([] { builtin_stage_profile("genric"); });
    EXPECT_TRUE(text.starts_with("stage profile: there is no profile 'genric'; known: "));
    EXPECT_THAT(text, HasSubstr("generic"));
}

// ---- shipped profiles

// The profiles that come with Etalon: that each is complete, and that what stands in it is what the
// makers' register lists say. tests/loopback/profiles_test.cpp drives each of them.

constexpr auto coils = RegisterSpace::coils;
constexpr auto discrete = RegisterSpace::discrete_inputs;

const std::vector<std::string> families = {
    "generic",          "iai-acon",    "iai-pcon",    "leadshine-em2rs",
    "leadshine-icl-rs", "oriental-ar", "oriental-az", "smc-lecp6",
};

std::string source_folder() {
    return std::string(ETALON_SOURCE_DIR) + "/stage/profiles";
}

class ShippedProfile : public testing::TestWithParam<std::string> {
protected:
    StageProfile profile = builtin_stage_profile(GetParam());
};

TEST_P(ShippedProfile, IsCompleteBuiltInAndAsAFile) {
    EXPECT_EQ(profile.name, GetParam());
    const StageProfile file = read_stage_profile(source_folder() + "/" + GetParam() + ".yaml");
    EXPECT_EQ(file.name, profile.name);
    EXPECT_EQ(file.about, profile.about);
    EXPECT_EQ(file.position.address, profile.position.address);
    EXPECT_EQ(file.unconfirmed, profile.unconfirmed);
    EXPECT_EQ(file.max_axes, profile.max_axes);
    EXPECT_EQ(file.inputs.at(Input::stop).bit, profile.inputs.at(Input::stop).bit);
    EXPECT_EQ(file.alarms, profile.alarms);
}

TEST_P(ShippedProfile, SaysWhatItIsAndWhereThatComesFrom) {
    EXPECT_FALSE(profile.about.starts_with("what "));  // as the bases do
    EXPECT_GE(profile.confirmed.size() + profile.unconfirmed.size(), 1U);
    const bool tried = std::ranges::none_of(profile.unconfirmed, [](const std::string& text) {
        return text.find("the twin only") != std::string::npos;
    });
    EXPECT_EQ(tried, GetParam() == "generic");
}

TEST_P(ShippedProfile, HasAToleranceThatItsCountsCanMeet) {
    if (profile.counts.per_mm) {
        EXPECT_GE(profile.done.tolerance_mm, 0.5 / *profile.counts.per_mm);
    }
    if (profile.counts.per_deg) {
        EXPECT_GE(profile.done.tolerance_deg, 0.5 / *profile.counts.per_deg);
    }
}

INSTANTIATE_TEST_SUITE_P(Every, ShippedProfile, testing::ValuesIn(families), [](const auto& one) {
    std::string name = one.param;
    std::erase(name, '-');
    return name;
});

TEST(ShippedProfiles, AreThese) {
    EXPECT_EQ(builtin_stage_profile_names(), families);
}

// ---- addresses as the makers' lists have them

TEST(ShippedProfiles, OrientalAzWritesSixteenRegistersThatStart) {
    const StageProfile profile = builtin_stage_profile("oriental-az");
    ASSERT_EQ(profile.target.size(), 1U);
    EXPECT_EQ(profile.target[0].address, 0x58);
    EXPECT_EQ(profile.target[0].size(), 16);
    EXPECT_TRUE(profile.target[0].starts);
    EXPECT_EQ(profile.target[0].fields.back().constant, 1.0);  // the trigger, 0x0066
    EXPECT_EQ(profile.inputs.at(Input::home).bit, 4);
    EXPECT_EQ(profile.inputs.at(Input::stop).address, 0x7D);
    EXPECT_EQ(profile.inputs.at(Input::stop).bit, 5);
    EXPECT_EQ(profile.inputs.at(Input::reset).bit, 7);
    EXPECT_EQ(profile.signals.at(Signal::moving)[0].bit, 13);
    EXPECT_EQ(profile.signals.at(Signal::in_position)[0].bit, 14);
    EXPECT_EQ(profile.position.address, 0x120);
    EXPECT_EQ(profile.link.serial.parity, 'E');
    EXPECT_FALSE(profile.has(Signal::homed));
}

TEST(ShippedProfiles, OrientalArStartsOperationDataZero) {
    const StageProfile profile = builtin_stage_profile("oriental-ar");
    EXPECT_EQ(profile.position.address, 0xCC);
    EXPECT_EQ(profile.alarm_code->address, 0x80);
    EXPECT_EQ(profile.inputs.at(Input::start).bit, 3);
    ASSERT_EQ(profile.target.size(), 3U);
    EXPECT_EQ(profile.target[0].address, 0x400);
    EXPECT_EQ(profile.target[1].address, 0x480);
    EXPECT_FALSE(profile.target[2].starts);
}

TEST(ShippedProfiles, IaiWritesPositionBandSpeedAndRamp) {
    for (const char* name : {"iai-pcon", "iai-acon"}) {
        const StageProfile profile = builtin_stage_profile(name);
        EXPECT_EQ(profile.target[0].address, 0x9900);
        EXPECT_EQ(profile.target[0].size(), 9);  // 0x9900 to 0x9908
        EXPECT_EQ(profile.target[0].fields[2].is, TargetBlock::Field::Is::speed);
        EXPECT_EQ(profile.poll.size(), 1U);  // position and status of one instant
        EXPECT_EQ(profile.signals.at(Signal::enabled)[0].bit, 12);
        EXPECT_EQ(profile.signals.at(Signal::alarm).size(), 2U);
        EXPECT_EQ(profile.signals.at(Signal::homing)[0].address, 0x9007);
        EXPECT_EQ(profile.inputs.at(Input::home).address, 0x40B);
        EXPECT_EQ(profile.inputs.at(Input::stop).space, coils);
        EXPECT_EQ(profile.inputs.at(Input::stop).address, 0x42C);
        const Axis axis{.name = "x"};
        EXPECT_DOUBLE_EQ(profile.counts_of(axis, 7.25), 725.0);
        EXPECT_DOUBLE_EQ(profile.register_of_speed(axis, 30.5), 3050.0);  // 0.01 mm/s
    }
}

TEST(ShippedProfiles, SmcStartsAStepAndItsAlarmIsAZero) {
    const StageProfile profile = builtin_stage_profile("smc-lecp6");
    EXPECT_EQ(profile.target[0].address, 0x9102);
    EXPECT_EQ(profile.target[0].size(), 16);  // to 0x9111
    EXPECT_EQ(profile.inputs.at(Input::start).address, 0x9100);
    EXPECT_EQ(profile.inputs.at(Input::start).code, 0x100);
    EXPECT_EQ(profile.signals.at(Signal::alarm)[0].space, discrete);
    EXPECT_EQ(profile.signals.at(Signal::alarm)[0].address, 0x4F);
    EXPECT_TRUE(profile.signals.at(Signal::alarm)[0].inverted);
    EXPECT_DOUBLE_EQ(profile.register_of_speed(Axis{.name = "x"}, 30.0), 30.0);  // mm/s
    const auto& stop = profile.sequences.stop;  // HOLD goes off only after RESET
    ASSERT_EQ(stop.size(), 5U);
    EXPECT_EQ(stop[1].input, Input::reset);
    EXPECT_EQ(stop[4].kind, Step::Kind::clear);
}

// A homing whose bit stays on after it was stopped might go on.
TEST(ShippedProfiles, AStopTakesBackAHomingThatHasACoilOfItsOwn) {
    for (const std::string& name : families) {
        const StageProfile profile = builtin_stage_profile(name);
        const InputPoint &home = profile.inputs.at(Input::home),
                         &stop = profile.inputs.at(Input::stop);
        const bool apart =
            home.act != InputPoint::Act::code &&
            std::pair(home.space, home.address) != std::pair(stop.space, stop.address);
        const bool cleared = std::ranges::any_of(profile.sequences.stop, [](const Step& step) {
            return step.kind == Step::Kind::clear && step.input == Input::home;
        });
        EXPECT_EQ(cleared, apart) << name;
    }
}

TEST(ShippedProfiles, LeadshineRunsPathZeroInTurnsPerMinute) {
    for (const char* name : {"leadshine-icl-rs", "leadshine-em2rs"}) {
        const StageProfile profile = builtin_stage_profile(name);
        EXPECT_EQ(profile.target[0].address, 0x6200);
        EXPECT_EQ(profile.target[0].size(), 6);
        for (const Input input : {Input::home, Input::start, Input::stop})
            EXPECT_EQ(profile.inputs.at(input).address, 0x6002);
        EXPECT_EQ(profile.inputs.at(Input::stop).code, 0x40);
        EXPECT_EQ(profile.inputs.at(Input::reset).code, 0x1111);
        EXPECT_EQ(profile.signals.at(Signal::homed)[0].bit, 6);
        EXPECT_EQ(profile.position.space, holding);
        Axis axis{.name = "x"};
        EXPECT_THROW(profile.counts_of(axis, 1.0), ConfigError);
        axis.counts_per_unit = 800.0;
        axis.lead = 5.0;
        EXPECT_DOUBLE_EQ(profile.counts_of(axis, -2.5), -2000.0);
        EXPECT_DOUBLE_EQ(profile.register_of_speed(axis, 20.0), 240.0);  // rpm
    }
}

}  // namespace
}  // namespace etalon
