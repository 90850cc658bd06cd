#include "stage/motion/axis_signals.h"

#include <fmt/format.h>

namespace etalon {

bool is_on(const AxisStatus& axis, Signal signal) {
    switch (signal) {
        case Signal::enabled:
            return axis.enabled;
        case Signal::ready:
            return axis.ready;
        case Signal::homed:
            return axis.homed;
        case Signal::moving:
            return axis.moving;
        case Signal::homing:
            return axis.homing;
        case Signal::in_position:
            return axis.in_position;
        case Signal::alarm:
            return axis.alarm != 0;
        case Signal::emergency_stop:
            return axis.emergency_stop;
        case Signal::limit:
            return axis.limit;
    }
    return false;
}

namespace {

std::string words(const Condition& condition, const AxisStatus& axis, const StageProfile& profile) {
    switch (condition.signal) {
        case Signal::emergency_stop:
            return ": emergency stop";
        case Signal::limit:
            return " is at a limit switch";
        case Signal::alarm:
            return ": " + profile.describe_alarm(axis.alarm);
        case Signal::enabled:
            return " is not enabled any more";
        default:
            return fmt::format(" is {}{}", condition.on ? "" : "not ", name_of(condition.signal));
    }
}

}  // namespace

std::string disturbance(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                        std::span<const Condition> conditions, const StageProfile& profile) {
    for (const Condition& condition : conditions)
        for (std::size_t i = 0; i < statuses.size(); ++i)
            if (holds(statuses[i], condition))
                return fmt::format("axis {}{}", axes[i].name,
                                   words(condition, statuses[i], profile));
    return "";
}

}  // namespace etalon
