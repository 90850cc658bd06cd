// What `etalon stage` prints and what is typed for it.
#include "station/devices/commands.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/error_text.h"

namespace etalon {
namespace {

constexpr double rad_per_deg = std::numbers::pi / 180.0;

std::vector<Axis> two_axes() {
    return {{.name = "x", .low = -7.0, .high = 70.0, .speed = 20.0},
            {.name = "rz", .kind = Axis::Kind::rotary, .low = -1.0, .high = 2.0, .speed = 2.0}};
}

std::size_t longest_line(const std::string& text) {
    std::size_t longest = 0;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);)
        longest = std::max(longest, line.size());
    return longest;
}

TEST(StageText, TellsTheWorstOfAnAxisFirst) {
    const StageProfile profile = builtin_stage_profile("generic");
    AxisStatus x{.enabled = true, .homed = true, .in_position = true, .position = 7.12345};
    AxisStatus rz{.homing = true, .emergency_stop = true};
    rz.alarm = 3;
    rz.position = -0.5 * rad_per_deg;
    const std::string text = stage_status_text(two_axes(), std::vector{x, rz}, profile);
    EXPECT_TRUE(has(text, "x             7.1234 mm   enabled, homed, in position\n") ||
                has(text, "x             7.1235 mm   enabled, homed, in position\n"))
        << text;
    EXPECT_TRUE(has(text, "rz           -0.5000 deg  EMERGENCY STOP, alarm 3 (watchdog expired"));
    EXPECT_TRUE(has(text, "off, not homed, homing"));
    EXPECT_LE(longest_line(text), 79U);
}

TEST(StageText, IsTheSameAsJson) {
    const StageProfile profile = builtin_stage_profile("generic");
    const std::vector<AxisStatus> statuses = {{.enabled = true, .position = 7.5},
                                              {.moving = true, .position = 0.25 * rad_per_deg}};
    const auto json = nlohmann::json::parse(stage_status_json(two_axes(), statuses, profile));
    EXPECT_EQ(json["etalon"], "stage/1");
    EXPECT_EQ(json["axes"][0]["position"], 7.5);
    EXPECT_EQ(json["axes"][0]["enabled"], true);
    EXPECT_NEAR(json["axes"][1]["position"].get<double>(), 0.25, 1e-12);
    EXPECT_EQ(json["axes"][1]["unit"], "deg");
    EXPECT_EQ(json["axes"][1]["moving"], true);
}

TEST(StageText, ShowsAPathWithWhatMakesItSlow) {
    Plan plan;
    plan.poses = {{{5.0, 0.0}, false}, {{7.0, 0.5}, true}};
    plan.legs = {{{{0.0, 0.0}, {5.0, 0.0}, 1.0, std::chrono::milliseconds(250), {}}},
                 {{{5.0, 0.0}, {5.0, 0.5}, 1.0, std::chrono::milliseconds(400), {}},
                  {{5.0, 0.5}, {7.0, 0.5}, 0.2, std::chrono::milliseconds(1500), {"lens"}}}};
    plan.expected_duration = std::chrono::seconds(7);
    const std::string text = stage_plan_text(two_axes(), plan);
    EXPECT_TRUE(has(text, "   1   0.2s  100 %  x=5.000\n")) << text;
    EXPECT_TRUE(has(text, "   2   0.4s  100 %  rz=28.648\n"));
    EXPECT_TRUE(has(text, "       1.5s   20 %  x=7.000 (near lens)\n"));
    EXPECT_TRUE(has(text, "2 poses in 3 motions"));
    const auto json = nlohmann::json::parse(stage_plan_json(two_axes(), plan));
    EXPECT_EQ(json["poses"][1]["motions"][1]["near"][0], "lens");
    EXPECT_EQ(json["poses"][1]["hold_out"], true);
    EXPECT_NEAR(json["poses"][1]["target"]["rz"].get<double>(), 0.5 / rad_per_deg, 1e-12);
}

TEST(StageText, SaysWhatAProfileCannotDo) {
    StageProfile profile = builtin_stage_profile("generic");
    profile.unconfirmed = {
        "that the fourth register of each axis keeps its value over a loss of "
        "power, as an integrator wrote"};
    EXPECT_TRUE(has(stage_profile_text(profile), "the controller stops the axes 1500 ms after"));
    profile.watchdog.reset();
    const std::string text = stage_profile_text(profile);
    EXPECT_TRUE(has(text, "none: axes that move go on when this program is killed"));
    EXPECT_TRUE(has(text, "does not tell: ready, homing"));
    EXPECT_TRUE(has(text, "profile valid\n"));
    EXPECT_LE(longest_line(text), 79U);
    const auto json = nlohmann::json::parse(stage_profile_json(profile));
    EXPECT_TRUE(json["watchdog_ms"].is_null());
    EXPECT_EQ(json["unconfirmed"].size(), 1U);
}

TEST(TypedTarget, IsAbsoluteOrRelativeInMmAndDegrees) {
    const std::vector<double> from = {5.0, 0.5};
    const auto absolute = typed_target(two_axes(), {"rz=-3"}, from, false);
    EXPECT_EQ(absolute[0], 5.0);
    EXPECT_NEAR(absolute[1], -3.0 * rad_per_deg, 1e-15);
    const auto relative = typed_target(two_axes(), {"x=-0.5", "rz=+3"}, from, true);
    EXPECT_EQ(relative[0], 4.5);
    EXPECT_NEAR(relative[1], 0.5 + 3.0 * rad_per_deg, 1e-15);
}

TEST(TypedTarget, MustNameAnAxisOnceWithANumber) {
    const std::vector<double> from = {5.0, 0.5};
    for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
             {"y=1"}, {"x"}, {"x="}, {"=1"}, {"x=nan"}, {"x=1mm"}, {"x=1", "x=2"}, {"x=+-1"}})
        EXPECT_THROW(typed_target(two_axes(), words, from, false), ConfigError) << words[0];
}

}  // namespace
}  // namespace etalon
