#include "station/devices/stage_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>
#include <set>

#include "core/file/text.h"
#include "core/geometry/units.h"
#include "core/time/progress.h"
#include "report/json_text.h"

namespace etalon {
namespace {

using Json = nlohmann::ordered_json;

double typed_unit(const Axis& axis) {
    return axis.kind == Axis::Kind::linear ? 1.0 : rad_per_deg;
}

const char* unit_name(const Axis& axis) {
    return axis.kind == Axis::Kind::linear ? "mm" : "deg";
}

double seconds(Duration time) {
    return std::chrono::duration<double>(time).count();
}

std::string print(const Json& json) {
    return text_of(json) + "\n";
}

// The worst first.
std::vector<std::string> state_words(const AxisStatus& status, const StageProfile& profile) {
    std::vector<std::string> words;
    if (status.emergency_stop)
        words.push_back("EMERGENCY STOP");
    if (status.alarm != 0)
        words.push_back(profile.describe_alarm(status.alarm));
    if (status.limit)
        words.push_back("at a limit switch");
    words.push_back(status.enabled ? "enabled" : "off");
    if (profile.has(Signal::homed))
        words.push_back(status.homed ? "homed" : "not homed");
    if (status.homing || status.moving)
        words.push_back(status.homing ? "homing" : "moving");
    else
        words.push_back(status.in_position ? "in position" : "at rest");
    return words;
}

std::string segment_text(const MotionSegment& segment, std::span<const Axis> axes) {
    std::vector<std::string> words;
    for (std::size_t i = 0; i < axes.size(); ++i)
        if (segment.to[i] != segment.from[i])
            words.push_back(
                fmt::format("{}={:.3f}", axes[i].name, segment.to[i] / typed_unit(axes[i])));
    return words.empty() ? "stays" : fmt::format("{}", fmt::join(words, " "));
}

Json positions_json(std::span<const Axis> axes, const std::vector<double>& positions) {
    Json json = Json::object();
    for (std::size_t i = 0; i < axes.size(); ++i)
        json[axes[i].name] = positions[i] / typed_unit(axes[i]);
    return json;
}

std::string link_text(const LinkDefaults& link) {
    if (link.transport == LinkDefaults::Transport::tcp)
        return "Modbus TCP";
    return fmt::format("Modbus RTU, {} baud, {}{}{}", link.serial.baud, link.serial.data_bits,
                       link.serial.parity, link.serial.stop_bits);
}

constexpr Signal all_signals[] = {Signal::enabled, Signal::ready,          Signal::homed,
                                  Signal::moving,  Signal::homing,         Signal::in_position,
                                  Signal::alarm,   Signal::emergency_stop, Signal::limit};

std::vector<std::string> missing_signals(const StageProfile& profile) {
    std::vector<std::string> names;
    for (const Signal signal : all_signals)
        if (!profile.has(signal))
            names.push_back(name_of(signal));
    return names;
}

std::string watchdog_text(const StageProfile& profile) {
    if (!profile.watchdog)
        return "none: axes that move go on when this program is killed or its link is cut";
    return fmt::format("the controller stops the axes {} ms after the last it heard",
                       profile.watchdog->timeout.count());
}

}  // namespace

std::string stage_status_text(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                              const StageProfile& profile) {
    std::string text;
    for (std::size_t i = 0; i < axes.size(); ++i)
        text += wrapped_text(
            fmt::format("{:<8}{:12.4f} {:<3}  ", axes[i].name,
                        statuses[i].position / typed_unit(axes[i]), unit_name(axes[i])),
            fmt::format("{}", fmt::join(state_words(statuses[i], profile), ", ")));
    return text;
}

std::string stage_status_json(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                              const StageProfile& profile) {
    Json json = {{"etalon", "stage/1"}, {"profile", profile.name}, {"axes", Json::array()}};
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const AxisStatus& status = statuses[i];
        json["axes"].push_back({{"name", axes[i].name},
                                {"position", status.position / typed_unit(axes[i])},
                                {"unit", unit_name(axes[i])},
                                {"enabled", status.enabled},
                                {"homed", status.homed},
                                {"moving", status.moving},
                                {"homing", status.homing},
                                {"in_position", status.in_position},
                                {"ready", status.ready},
                                {"limit", status.limit},
                                {"emergency_stop", status.emergency_stop},
                                {"alarm", status.alarm}});
    }
    return print(json);
}

std::string stage_plan_text(std::span<const Axis> axes, const Plan& plan) {
    std::string text = "pose   time  speed  to (mm, deg)\n";
    std::size_t motions = 0;
    for (std::size_t pose = 0; pose < plan.legs.size(); ++pose)
        for (const MotionSegment& segment : plan.legs[pose]) {
            ++motions;
            const bool first = &segment == &plan.legs[pose].front();
            std::string where = segment_text(segment, axes);
            if (!segment.near.empty())
                where += fmt::format(" (near {})", fmt::join(segment.near, ", "));
            text += wrapped_text(
                fmt::format("{:>4} {:5.1f}s {:4.0f} %  ", first ? std::to_string(pose + 1) : "",
                            seconds(segment.time), 100.0 * segment.speed_share),
                where);
        }
    return text + fmt::format("{} poses in {} motions, about {} without homing\n",
                              plan.poses.size(), motions, duration_text(plan.expected_duration));
}

std::string stage_plan_json(std::span<const Axis> axes, const Plan& plan) {
    Json json = {{"etalon", "stage-plan/1"},
                 {"duration_s", seconds(plan.expected_duration)},
                 {"poses", Json::array()}};
    for (std::size_t pose = 0; pose < plan.legs.size(); ++pose) {
        Json motions = Json::array();
        for (const MotionSegment& segment : plan.legs[pose])
            motions.push_back({{"from", positions_json(axes, segment.from)},
                               {"to", positions_json(axes, segment.to)},
                               {"time_s", seconds(segment.time)},
                               {"speed_share", segment.speed_share},
                               {"near", segment.near}});
        json["poses"].push_back({{"target", positions_json(axes, plan.poses[pose].target)},
                                 {"hold_out", plan.poses[pose].hold_out},
                                 {"motions", motions}});
    }
    return print(json);
}

std::string stage_profile_text(const StageProfile& profile) {
    std::string text = wrapped_text(profile.name + ": ", profile.about);
    text += fmt::format("  {} {} a unit, {}\n", profile.max_axes,
                        profile.max_axes == 1 ? "axis" : "axes", link_text(profile.link));
    const auto list = [&](const char* title, const std::vector<std::string>& items) {
        text += fmt::format("  {}\n", title);
        for (const std::string& item : items)
            text += wrapped_text("    - ", item);
        if (items.empty())
            text += "    nothing\n";
    };
    list("confirmed by the vendor's documents", profile.confirmed);
    list("not confirmed", profile.unconfirmed);
    const std::vector<std::string> missing = missing_signals(profile);
    if (!missing.empty())
        text += wrapped_text("  does not tell: ", fmt::format("{}", fmt::join(missing, ", ")));
    return text + wrapped_text("  watchdog: ", watchdog_text(profile)) + "profile valid\n";
}

std::string stage_profile_json(const StageProfile& profile) {
    return print(
        {{"etalon", "stage-profile-check/1"},
         {"name", profile.name},
         {"about", profile.about},
         {"max_axes", profile.max_axes},
         {"confirmed", profile.confirmed},
         {"unconfirmed", profile.unconfirmed},
         {"missing_signals", missing_signals(profile)},
         {"watchdog_ms", profile.watchdog ? Json(profile.watchdog->timeout.count()) : Json()}});
}

std::vector<double> typed_target(std::span<const Axis> axes, const std::vector<std::string>& words,
                                 std::span<const double> from, bool relative) {
    std::vector<double> target(from.begin(), from.end());
    std::set<std::string> named;
    for (const std::string& word : words) {
        const std::size_t equals = std::min(word.find('='), word.size());
        const std::string name = word.substr(0, equals);
        const auto value =
            equals < word.size() ? parse_number(word.substr(equals + 1)) : std::nullopt;
        const auto axis = std::ranges::find(axes, name, &Axis::name);
        if (!value || axis == axes.end())
            throw ConfigError(
                {"stage target"},
                fmt::format("'{}' is not AXIS=NUMBER of an axis that there is", word));
        if (!named.insert(name).second)
            throw ConfigError({"stage target"}, fmt::format("axis {} is named twice", name));
        double& position = target[static_cast<std::size_t>(axis - axes.begin())];
        position = (relative ? position : 0.0) + *value * typed_unit(*axis);
    }
    return target;
}

}  // namespace etalon
