// A profile's signals as the fields of AxisStatus.
#pragma once

#include "stage/motion/stage.h"
#include "stage/profile/profile.h"

namespace etalon {

bool is_on(const AxisStatus& axis, Signal signal);  // alarm: any code but 0

inline bool holds(const AxisStatus& axis, const Condition& condition) {
    return is_on(axis, condition.signal) == condition.on;
}

}  // namespace etalon
