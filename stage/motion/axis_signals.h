// A profile's signals as the fields of AxisStatus.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "stage/motion/stage.h"
#include "stage/profile/profile.h"

namespace etalon {

bool is_on(const AxisStatus& axis, Signal signal);  // alarm: any code but 0

inline bool holds(const AxisStatus& axis, const Condition& condition) {
    return is_on(axis, condition.signal) == condition.on;
}

// What disturbs axes, in the order in which it is looked for: of a limit switch or an emergency
// stop many controllers raise the alarm of all their axes, which says less and names the wrong one.
inline constexpr Condition pressed{Signal::emergency_stop}, at_limit{Signal::limit},
    alarmed{Signal::alarm}, disabled{Signal::enabled, false};

// The first of these conditions that holds of an axis, in words: "axis y is at a limit switch".
// Empty where none does. The profile has the words for alarms' codes.
std::string disturbance(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                        std::span<const Condition> conditions, const StageProfile& profile);

}  // namespace etalon
