// A motorised stage: axes that are enabled, homed, moved and stopped. A stage can crush a lens, so:
//
//   * nothing moves before enable() and home(), with an alarm, or to outside the soft limits;
//   * a motion command is never repeated without reading back first;
//   * destroying the object stops every axis, whatever the reason (best effort, bounded by the
//     profile's time for stopping, at most 3 s; on a fresh connection when the old one is broken).
//
// States: connected -> enabled -> homed <-> moving (or at once homed, by resume()); an alarm or a
// lost link leads to faulted, from where only stop() is allowed. One thread owns a stage.
#pragma once

#include <functional>

#include "core/time/clock.h"
#include "stage/axes/axes.h"
#include "stage/link/stage_link.h"

namespace etalon {

struct AxisStatus {
    bool enabled = false, homed = false, moving = false, in_position = false;
    int alarm = 0;                               // the controller's code; 0: none
    double position = 0.0;                       // read back, mm or rad
    bool ready = false;                          // takes a command for motion
    bool homing = false;                         // moving, to find its zero
    bool emergency_stop = false, limit = false;  // pressed; a limit switch is reached
};

class Stage {
public:
    virtual ~Stage() = default;

    virtual const std::vector<Axis>& axes() const = 0;

    virtual void enable(std::stop_token stop) = 0;
    virtual void home(std::stop_token stop) = 0;

    // In place of enable() and home(): continues where an earlier program left the axes. Commands
    // nothing. Throws DeviceError unless every axis is enabled, homed, at rest and without alarm.
    virtual void resume() = 0;

    // The operator's word for controllers that do not tell whether axes are homed: resume() and
    // home() (of an axis that does not move) rely on it, and throw DeviceError without.
    virtual void take_for_homed() {}

    // Moves all axes together, returns when every one is done and settled. Throws ConfigError for a
    // target outside the soft limits (before anything moves), DeviceError for an alarm, a lost link
    // or a move that does not end in time, Interrupted on request; the axes are stopped first.
    virtual void move(std::span<const double> target, std::stop_token stop) = 0;

    // Moves from now on run at this share of each axis' speed, 0 < share <= 1; at first 1.
    virtual void limit_speed(double share) = 0;

    // Read back from axes at rest, mm or rad, one per axis. Throws DeviceError when one tells an
    // alarm, an emergency stop or a limit, or is not where the last move left it.
    virtual std::vector<double> position() = 0;
    virtual std::vector<AxisStatus> status() = 0;

    // Stops every axis. True when the controller confirmed that nothing moves.
    virtual bool stop() noexcept = 0;

    // The last exchanges with the device, one line each; may be empty. Safe from every thread.
    virtual std::string trace() const { return {}; }

    // Called with one line for every exchange, on its thread, times from now; empty: ends it.
    virtual void set_trace(std::function<void(const std::string&)>) {}
};

// For stopping a stage is opened without a question, so that a silent unit keeps none from it.
enum class Opening { asks, asks_nothing };

// Opens a stage on Modbus TCP or RTU that speaks the given profile, built in ("generic") or a file
// ("stage.yaml"). Throws ConfigError for an unknown profile, DeviceError when nobody answers.
std::unique_ptr<Stage> open_stage(const StageLink& link, const std::string& profile,
                                  std::vector<Axis> axes, Clock& clock,
                                  Opening opening = Opening::asks);

}  // namespace etalon
