// The physics of a motorised stage: axes that ramp up, travel and ramp down, encoders that read
// back, and a carriage that is truly somewhere slightly else.
//
// Every quantity is a closed-form function of the time since the last command (nothing is
// integrated), so a test on a VirtualClock knows the exact answer. Positions are mm or rad.
// Not a controller: no registers, no sockets (mocks/stage_registers.h has those).
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <vector>

#include "core/clock.h"
#include "stage/axes.h"
#include "stage/stage.h"

namespace etalon {

// Motion of one axis with constant acceleration up, constant speed, constant acceleration down.
class TrapezoidalMotion {
public:
    TrapezoidalMotion() = default;  // at rest at 0

    // From rest at `from` to rest at `to`; speed and acceleration > 0. A short move never reaches
    // the speed (triangular).
    static TrapezoidalMotion between(double from, double to, double speed, double acceleration);

    // From `from` at `velocity` (signed) to rest as soon as the acceleration allows.
    static TrapezoidalMotion braking(double from, double velocity, double acceleration);

    // At t seconds after its start; before it the start, after its end the end.
    double position(double t) const;
    double velocity(double t) const;
    double duration() const { return ramp_up_ + cruise_ + ramp_down_; }  // s
    double start() const { return from_; }
    double end() const { return to_; }

private:
    double from_ = 0.0, to_ = 0.0;
    double peak_velocity_ = 0.0;                             // signed
    double ramp_up_ = 0.0, cruise_ = 0.0, ramp_down_ = 0.0;  // s
};

// How the carriage differs from what the encoder says:
//     true = encoder * (1 + scale) + drawn error of this move + (backlash if it came from above)
// The last two change linearly with the way travelled, so the carriage never jumps.
struct AxisErrors {
    double scale = 0.0;          // relative; 0.002 = 0.2 % too far
    double repeatability = 0.0;  // standard deviation, drawn anew for each move; mm or rad
    double backlash = 0.0;       // mm or rad
};

// The simulated controller's alarm codes; other values may be injected.
struct StageAlarm {
    static constexpr int none = 0;
    static constexpr int not_ready = 1;       // asked to move while disabled, not homed or moving
    static constexpr int outside_travel = 2;  // target outside the limits, or an unusable speed
    static constexpr int watchdog = 3;        // the master fell silent during a motion
};

struct SimulatedStageOptions {
    std::vector<AxisErrors> errors;         // one per axis, or empty: none
    std::chrono::milliseconds ramp{50};     // from rest to the axis' declared speed; > 0
    std::chrono::milliseconds homing{200};  // homing takes at least this long
    std::vector<double> power_on_position;  // one per axis, or empty: 0
    std::uint64_t seed = 1;                 // of the repeatability
};

// Safe from every thread: the Modbus server commands it, the camera looks at it.
class SimulatedStage {
public:
    // Throws ConfigError when an option's length or value does not fit the axes. The clock must
    // outlive the stage.
    SimulatedStage(std::vector<Axis> axes, SimulatedStageOptions options, Clock& clock);

    const std::vector<Axis>& axes() const { return axes_; }
    Clock& clock() const { return clock_; }

    // Commands, as a controller carries them out: at once, and an impossible one raises an alarm.
    void enable(bool on);  // off brakes, and the axes have to be homed again
    void home();           // all axes to 0, or to the limit nearest to 0
    void start(const std::vector<double>& target, const std::vector<double>& speed);
    void stop();   // brakes every axis from now on
    void reset();  // clears the alarms

    // What the controller knows: positions are the encoders'.
    std::vector<AxisStatus> status() const;

    // Where the carriage truly is, for the twin's camera.
    std::vector<double> true_positions() const;

    // Whether any axis moves now.
    bool is_moving() const;

    // The axes' target, as last commanded.
    std::vector<double> target() const;

    // Lets the twin's camera render the picture of a new position before the stage claims to be
    // there: while all axes rest, "in position" is reported only if `ready(true positions)`. Called
    // on the thread that asks for status(), at every such status(), without a lock held; it must
    // return at once. An empty function ends it.
    void hold_in_position_until(std::function<bool(const std::vector<double>&)> ready);

    // Faults. An alarm brakes every axis and stays until reset(). A jammed axis stops dead, or does
    // not start, while it reports to be moving until stop().
    void raise_alarm(int code);
    void jam(std::size_t axis, bool jammed = true);

private:
    struct AxisState {
        TrapezoidalMotion motion;
        double offset_before = 0.0, offset_after = 0.0;  // true - scaled encoder, over the motion
        double target = 0.0;
        bool jammed = false, stuck_now = false;
    };

    // All need the lock; t is in seconds since motion_start_.
    double seconds_since_start(Instant now) const;
    double acceleration(std::size_t axis) const;
    double encoder(const AxisState& axis, double t) const;
    double offset(const AxisState& axis, double t) const;
    std::vector<double> true_positions_at(double t) const;
    bool moves(const AxisState& axis, double t) const;
    bool any_moves(double t) const;
    bool is_homed(double t) const;
    int reason_to_refuse(const std::vector<double>& target, const std::vector<double>& speed,
                         double t) const;
    void begin(std::size_t axis, double target, double speed);
    void brake();
    void fail(int alarm);

    const std::vector<Axis> axes_;
    SimulatedStageOptions options_;
    Clock& clock_;

    mutable std::mutex mutex_;
    std::vector<AxisState> states_;
    Instant motion_start_;         // common to all axes
    double homing_seconds_ = 0.0;  // all axes report motion as long
    bool homed_ = false;           // counts once the homing is over
    bool enabled_ = false;
    int alarm_ = StageAlarm::none;
    std::uint64_t moves_started_ = 0;
    std::function<bool(const std::vector<double>&)> ready_;
};

}  // namespace etalon
