// The profiles that come with Etalon: that each is complete, and that what stands in it is what the
// makers' register lists say. tests/loopback/profiles_test.cpp drives each of them.

#include "stage/profile/profile.h"
#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr auto holding = RegisterSpace::holding_registers;
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
