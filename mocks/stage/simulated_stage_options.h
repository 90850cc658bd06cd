// What a simulated stage is like: its errors, how it moves, when it fails.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "mocks/stage/simulated_axis.h"
#include "mocks/stage/stage_errors.h"
#include "mocks/stage/stage_fault.h"
#include "stage/axes/axes.h"

namespace etalon {

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
