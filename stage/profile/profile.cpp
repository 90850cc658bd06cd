#include "stage/profile/profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/geometry/units.h"
#include "stage/profile/profile_parts.h"

namespace etalon {
namespace {

// Signed: an axis may count backwards.
double counts_per_unit(const StageProfile& profile, const Axis& axis) {
    if (axis.counts_per_unit)
        return *axis.counts_per_unit;
    const bool linear = axis.kind == Axis::Kind::linear;
    const auto given = linear ? profile.counts.per_mm : profile.counts.per_deg;
    if (!given)
        throw ConfigError({"stage axes", 0, axis.name},
                          fmt::format("profile '{}' needs its {}", profile.name,
                                      linear ? "counts_per_mm" : "counts_per_deg"));
    return linear ? *given : *given * deg_per_rad;
}

// Of a speed register, per mm/s or rad/s.
double speed_factor(const StageProfile& profile, const Axis& axis) {
    if (profile.speed.unit == StageProfile::Speed::Unit::counts_per_s)
        return std::abs(counts_per_unit(profile, axis)) / profile.speed.step;
    if (!axis.lead)
        throw ConfigError({"stage axes", 0, axis.name},
                          fmt::format("profile '{}' needs its {}", profile.name,
                                      axis.kind == Axis::Kind::linear ? "lead_mm" : "lead_deg"));
    return 60.0 / *axis.lead / profile.speed.step;
}

}  // namespace

const std::vector<SignalWord>& signal_words() {
    static const std::vector<SignalWord> words = {
        {Signal::enabled, "enabled"}, {Signal::ready, "ready"},
        {Signal::homed, "homed"},     {Signal::moving, "moving"},
        {Signal::homing, "homing"},   {Signal::in_position, "in_position"},
        {Signal::alarm, "alarm"},     {Signal::emergency_stop, "emergency_stop"},
        {Signal::limit, "limit"},
    };
    return words;
}

const std::vector<InputWord>& input_words() {
    static const std::vector<InputWord> words = {
        {Input::remote, "remote"}, {Input::enable, "enable"}, {Input::home, "home"},
        {Input::start, "start"},   {Input::stop, "stop"},     {Input::reset, "reset"},
    };
    return words;
}

const char* name_of(Signal signal) {
    return signal_words()[static_cast<std::size_t>(signal)].word;
}

const char* name_of(Input input) {
    return input_words()[static_cast<std::size_t>(input)].word;
}

int TargetBlock::size() const {
    int count = 0;
    for (const Field& field : fields)
        count += registers_of(field.type);
    return count;
}

bool starts_motion(const StageProfile& profile, const Step& step) {
    const bool gives = step.kind == Step::Kind::set || step.kind == Step::Kind::pulse;
    if (gives)
        return step.input == Input::home || step.input == Input::start;
    return step.kind == Step::Kind::write &&
           std::ranges::any_of(profile.target, &TargetBlock::starts);
}

double StageProfile::counts_of(const Axis& axis, double mm_or_rad) const {
    return counts.offset + counts.sign * counts_per_unit(*this, axis) * mm_or_rad;
}

double StageProfile::position_of(const Axis& axis, double number) const {
    return (number - counts.offset) / (counts.sign * counts_per_unit(*this, axis));
}

double StageProfile::register_of_speed(const Axis& axis, double mm_or_rad_per_s) const {
    return mm_or_rad_per_s * speed_factor(*this, axis);
}

double StageProfile::speed_of_register(const Axis& axis, double number) const {
    return number / speed_factor(*this, axis);
}

double StageProfile::tolerance(const Axis& axis) const {
    return axis.kind == Axis::Kind::linear ? done.tolerance_mm : done.tolerance_deg / deg_per_rad;
}

std::string StageProfile::describe_alarm(int code) const {
    if (code < 0)
        return "alarm without a code";
    const auto known = alarms.find(code);
    return known == alarms.end() ? fmt::format("alarm {}", code)
                                 : fmt::format("alarm {} ({})", code, known->second);
}

StageProfile named_stage_profile(const std::string& name) {
    return name.ends_with(".yaml") ? read_stage_profile(name) : builtin_stage_profile(name);
}

}  // namespace etalon
