#include "stage/profile.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/errors.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

const std::string valid = R"(etalon: stage-profile/1
name: test
max_axes: 3
counts: {per_mm: 500, per_deg: 70}
poll: {address: 10, stride: 5, status: 4, alarm: 0, position: 2}
status_bits: {enabled: 5, homed: 7, moving: 11, in_position: 13, alarm: 2}
move: {address: 40, stride: 4, target: 2, speed: 0}
command: {address: 60, enable: 3, home: 1, start: 9, stop: 0, reset: 15}
watchdog: {address: 61, timeout_ms: 1700}
done: {tolerance_um: 7, tolerance_deg: 0.05, stable_polls: 5, settle_ms: 30}
limits: {enable_ms: 100, home_ms: 200, move_factor: 1.25, move_margin_ms: 300}
alarms: {7: too hot}
)";

std::string replaced(const std::string& from, const std::string& to) {
    std::string text = valid;
    const auto at = text.find(from);
    return at == std::string::npos ? "not in the text: " + from : text.replace(at, from.size(), to);
}

std::string error_of(const std::string& text) {
    try {
        stage_profile_from_text(text, "p.yaml");
    } catch (const ConfigError& error) {
        return error.what();
    }
    return "no error";
}

TEST(StageProfile, IsReadKeyByKey) {
    const StageProfile profile = stage_profile_from_text(valid, "p.yaml");
    EXPECT_EQ(profile.name, "test");
    EXPECT_EQ(profile.max_axes, 3);
    EXPECT_EQ(profile.poll.address, 10);
    EXPECT_EQ(profile.poll.stride, 5);
    EXPECT_EQ(profile.poll.status, 4);
    EXPECT_EQ(profile.poll.alarm, 0);
    EXPECT_EQ(profile.poll.position, 2);
    EXPECT_EQ(profile.status_bits.in_position, 13);
    EXPECT_EQ(profile.move.target, 2);
    EXPECT_EQ(profile.command.reset, 15);
    ASSERT_TRUE(profile.watchdog.has_value());
    EXPECT_EQ(profile.watchdog->timeout, 1700ms);
    EXPECT_EQ(profile.done.stable_polls, 5);
    EXPECT_EQ(profile.limits.move_margin, 300ms);
    EXPECT_EQ(profile.describe_alarm(7), "alarm 7 (too hot)");
    EXPECT_EQ(profile.describe_alarm(5), "alarm 5");
}

TEST(StageProfile, ConvertsMillimetresAndRadiansToCounts) {
    const StageProfile profile = stage_profile_from_text(valid, "p.yaml");
    Axis axis;
    EXPECT_DOUBLE_EQ(profile.counts_per_unit(axis), 500.0);
    EXPECT_DOUBLE_EQ(profile.tolerance(axis), 0.007);
    axis.kind = Axis::Kind::rotary;
    EXPECT_DOUBLE_EQ(profile.counts_per_unit(axis), 70.0 * 180.0 / std::numbers::pi);
    EXPECT_DOUBLE_EQ(profile.tolerance(axis), 0.05 * std::numbers::pi / 180.0);
}

TEST(StageProfile, NamesFileLineAndKeyOfEveryFault) {
    EXPECT_EQ(error_of(replaced("stride: 5", "stride: 60")),
              "p.yaml:5: poll: 180 registers do not fit into one request of 125");
    EXPECT_EQ(error_of(replaced("alarm: 0, position", "alarm: 3, position")),
              "p.yaml:5: poll.position: overlaps with another register of its group");
    EXPECT_EQ(error_of(replaced("position: 2", "position: 5")),
              "p.yaml:5: poll.position: does not fit into the stride 5");
    EXPECT_EQ(error_of(replaced("homed: 7", "homed: 5")),
              "p.yaml:6: status_bits.homed: bit 5 is used twice");
    EXPECT_EQ(error_of(replaced("start: 9", "start: 16")),
              "p.yaml:8: command.start: must be between 0 and 15, not 16");
    EXPECT_EQ(error_of(replaced("address: 40", "address: 20")),
              "p.yaml:7: move: overlaps with the registers of 'poll'");
    EXPECT_EQ(error_of(replaced("address: 61", "address: 60")),
              "p.yaml:9: watchdog: overlaps with the registers of 'command'");
    EXPECT_EQ(error_of(replaced("address: 40", "address: 65530")),
              "p.yaml:7: move: reaches beyond register 65535");
    EXPECT_EQ(error_of(replaced("per_mm: 500", "per_mm: 0")),
              "p.yaml:4: counts.per_mm: must be greater than 0, not 0");
    EXPECT_EQ(error_of(replaced("stable_polls: 5, ", "")), "p.yaml:10: done.stable_polls: missing");
    EXPECT_EQ(error_of(replaced("reset: 15", "reset: 15, brake: 4")),
              "p.yaml:8: command.brake: unknown key");
    EXPECT_EQ(error_of(replaced("{7: too hot}", "{hot: too hot}")),
              "p.yaml:12: alarms.hot: an alarm's key must be its code, 1 to 65535");
}

TEST(StageProfile, TheGenericOneIsBuiltInAndEqualToItsFile) {
    const StageProfile built_in = builtin_stage_profile("generic");
    const StageProfile from_file =
        read_stage_profile(std::string(ETALON_SOURCE_DIR) + "/stage/profiles/generic.yaml");
    EXPECT_EQ(built_in.name, "generic");
    EXPECT_EQ(built_in.max_axes, from_file.max_axes);
    EXPECT_EQ(built_in.command.address, from_file.command.address);
    EXPECT_EQ(built_in.alarms, from_file.alarms);
    EXPECT_EQ(builtin_stage_profile_names(), std::vector<std::string>{"generic"});
}

TEST(StageProfile, AnUnknownNameIsRefusedWithTheKnownOnes) {
    try {
        builtin_stage_profile("genric");
        FAIL() << "accepted";
    } catch (const ConfigError& error) {
        EXPECT_STREQ(error.what(), "stage profile: there is no profile 'genric'; known: generic");
    }
}

}  // namespace
}  // namespace etalon
