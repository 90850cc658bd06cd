#include "stage/motion/axis_signals.h"

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

}  // namespace etalon
