// Faults of a stage, by name, at a scripted moment: what twin.yaml's `faults` lists beside those of
// the link. They happen once. See SimulatedStage for what each does.
#pragma once

#include <cstddef>

#include "mocks/fault_trigger.h"

namespace etalon {

struct StageFault {
    enum class Kind {
        stuck_axis,         // the axis stops dead, or does not start, and claims to move
        false_in_position,  // the axis claims to have arrived, until its next command
        encoder_jump,       // the encoder reads `size` more from now on, until homed
        limit_hit,          // a limit switch: brakes with an alarm
        emergency_stop,     // pressed for good: brakes, drives off, homing lost
        alarm               // `code`: brakes
    };
    Kind kind = Kind::stuck_axis;
    FaultTrigger at;
    std::size_t axis = 0;  // of all but emergency_stop
    double size = 0.0;     // of encoder_jump: mm or rad, signed
    int code = 0;          // of alarm: 1 to 65535
};

}  // namespace etalon
