// What a simulated stage is like: its errors, how it moves, when it fails.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "mocks/stage/simulated_axis.h"
#include "mocks/stage/stage_errors.h"
#include "stage/axes/axes.h"

namespace etalon {

// When a scripted fault of the twin happens. One of (twin.yaml's `at`):
//     {time_ms: 2500}   2.5 s after power-on
//     {move: 7}         as the 7th move is started
//     {request: 120}    with the 120th Modbus request, of all clients together
//     {register: 200}   with the first request that writes it (coils: the same)
struct FaultTrigger {
    enum class When { time_ms, move, request, write_to };
    When when = When::time_ms;
    int value = 0;  // as above; moves and requests are counted from 1
};

// Faults of a stage, by name, at a scripted moment: what twin.yaml's `faults` lists beside those of
// the link. They happen once. See SimulatedStage for what each does.
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

// The simulated controllers' alarm codes; other values may be injected.
struct StageAlarm {
    static constexpr int none = 0;
    static constexpr int not_ready = 1;       // asked to move while disabled, not homed or moving
    static constexpr int outside_travel = 2;  // target outside the limits, or an unusable speed
    static constexpr int watchdog = 3;        // the master fell silent during a motion
    static constexpr int limit = 4;           // a limit switch was hit
    static constexpr int emergency_stop = 5;  // stays while it is pressed
};

// How an axis follows its plan.
struct AxisServo {
    ServoParameters parameters;
    double window = 0.0;  // "in position" within so much of the target; mm or rad, > 0
};

struct SimulatedStageOptions {
    std::vector<AxisErrors> errors;                // one per axis, or empty: none
    std::chrono::milliseconds ramp{50};            // from rest to the axis' declared speed; > 0
    std::chrono::milliseconds homing{200};         // homing takes at least this long
    std::vector<double> power_on_position;         // one per axis, or empty: 0
    std::uint64_t seed = 1;                        // of the repeatability and the encoders' noise
    std::chrono::milliseconds jerk{0};             // until the acceleration is there; 0: at once
    std::vector<std::optional<AxisServo>> servos;  // one per axis, or empty; nothing: exactly
    StageTemperature temperature;
    std::vector<StageFault> faults;
};

// One controller drives consecutive axes with the same Modbus unit.
struct StageController {
    std::optional<int> unit;  // as the axes declare it
    std::size_t first = 0, count = 0;
};

std::vector<StageController> controllers_of(const std::vector<Axis>& axes);

// The same with an entry for every axis. Throws ConfigError at "simulated stage" when a length or
// value does not fit the axes.
SimulatedStageOptions complete(SimulatedStageOptions options, const std::vector<Axis>& axes);

// Of one axis; the options are complete.
AxisDynamics dynamics_of(const SimulatedStageOptions& options, const std::vector<Axis>& axes,
                         std::size_t axis);

}  // namespace etalon
