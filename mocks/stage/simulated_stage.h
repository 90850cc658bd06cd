// A motorised stage without its wires: controllers that enable, home, start and stop their axes and
// raise alarms, and a carriage that is truly somewhere slightly else. For the twin, behind
// registers and sockets (mocks/stage/stage_registers.h), and for tests.
//
// Every quantity is a closed-form function of the time since the last command
// (mocks/stage/simulated_axis.h), so a test on a VirtualClock knows the exact answer. Positions are
// mm or rad.
#pragma once

#include <cstdint>

#include "mocks/stage/simulated_axis.h"
#include "stage/motion/stage.h"

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

// Safe from every thread: the Modbus server commands it, the camera looks at it.
class SimulatedStage {
public:
    // Powers on. Throws ConfigError when an option's length or value does not fit the axes,
    // NumericalError for a servo that cannot be. The clock must outlive the stage.
    SimulatedStage(std::vector<Axis> axes, SimulatedStageOptions options, Clock& clock);

    const std::vector<Axis>& axes() const { return axes_; }
    const std::vector<StageController>& controllers() const { return controllers_; }
    Clock& clock() const { return clock_; }

    // Commands to one controller, as it carries them out: at once, and an impossible one raises an
    // alarm. `target` and `speed` are of its axes.
    void enable(bool on, std::size_t controller = 0);  // off brakes, and the homing is lost
    void home(std::size_t controller = 0);             // to 0, or to the limit nearest to 0
    void start(const std::vector<double>& target, const std::vector<double>& speed,
               std::size_t controller = 0);
    // Brakes every axis from now on.
    void stop(std::size_t controller = 0) {
        now([&](double t) { brake(controller, t); });
    }
    void reset(std::size_t controller = 0);  // clears the alarm and the limit switches

    // What the controllers know, of all axes: positions are the encoders'.
    std::vector<AxisStatus> status();

    // Where the carriage truly is, for the twin's camera.
    std::vector<double> true_positions() {
        return now([&](double t) { return true_positions_at(t); });
    }

    // Whether any axis moves now, whatever the controller claims.
    bool is_moving() {
        return now([&](double t) { return any_moves(states_, t); });
    }
    bool is_moving(std::size_t controller) {
        return now([&](double t) { return any_moves(axes_of(controller), t); });
    }

    // The axes' target, as last commanded.
    std::vector<double> target();

    // Lets the twin's camera render the picture of a new position before the stage claims to be
    // there: while all axes rest, "in position" is reported only if `ready(true positions)`. Called
    // on the thread that asks for status(), at every such status(), without a lock held; it must
    // return at once. An empty function ends it.
    void hold_in_position_until(std::function<bool(const std::vector<double>&)> ready);

    // Faults. An alarm brakes every axis of the controller and stays until reset().
    void raise_alarm(int code, std::size_t controller = 0) {
        now([&](double t) { fail(code, controller, t); });
    }
    // A jammed axis stops dead, or does not start, while it reports to be moving until stop().
    void jam(std::size_t axis, bool jammed = true);
    // Says "in position" and "not moving" until its next command, wherever it is.
    void claim_arrival(std::size_t axis) {
        now([&](double) { states_.at(axis).claims_arrival = true; });
    }
    // The encoder reads `size` more until it is homed; the motion that runs ends there too.
    void jump_encoder(std::size_t axis, double size) {
        now([&](double) { states_.at(axis).physics.jump_encoder(size); });
    }
    void hit_limit(std::size_t axis) {
        now([&](double t) { hit_limit_at(axis, t); });
    }
    // All controllers: brakes, drives off. Nothing can be enabled and no alarm reset while pressed.
    void press_emergency_stop(bool pressed = true);

    // For faults that happen with a request: to be called for each one before it is carried out.
    // Registers or coils first_written ... are written, none if the count is 0.
    void notice_request(int first_written, int count);

    // start() that moved something, of all controllers.
    int moves_started() {
        return now([&](double) { return moves_started_; });
    }
    Duration uptime() { return clock_.now() - power_on_; }  // since power-on

private:
    struct AxisState {
        SimulatedAxis physics;
        std::size_t controller = 0;
        bool enabled = false;
        bool homed = false;         // counts once the homing is over
        double homing_until = 0.0;  // it reports motion as long, s
        bool jammed = false, claims_arrival = false, at_limit = false;
    };

    // Does `work` with the time in seconds since power-on, after the faults that were due by then.
    template <class Work>
    std::invoke_result_t<Work, double> now(const Work& work) {
        const std::scoped_lock lock(mutex_);
        return work(catch_up());
    }

    // All need the lock; t is in seconds since power-on.
    double catch_up();  // t of now, after the faults that were due by then
    std::span<AxisState> axes_of(std::size_t controller);
    std::size_t index_of(const AxisState& axis) const;
    bool is_homed(const AxisState& axis, double t) const;
    bool moves(const AxisState& axis, double t) const;
    bool any_moves(std::span<const AxisState> axes, double t) const;
    AxisStatus status_of(const AxisState& axis, double t) const;
    double reading(const AxisState& axis, double t) const;
    double drawn_error(std::size_t axis) const;
    std::vector<double> true_positions_at(double t) const;
    int reason_to_refuse(const std::vector<double>& target, const std::vector<double>& speed,
                         std::size_t controller, double t);
    void begin_homing(std::size_t controller, double t);
    void brake(std::size_t controller, double t);
    void fail(int alarm, std::size_t controller, double t);
    void jam_at(std::size_t axis, double t);
    void hit_limit_at(std::size_t axis, double t);
    void press_emergency_stop_at(double t);
    void happen(const StageFault& fault, double t);
    void fire(FaultTrigger::When when, int first, int last, double t);

    const std::vector<Axis> axes_;
    SimulatedStageOptions options_;
    Clock& clock_;
    const Instant power_on_;
    const std::vector<StageController> controllers_;

    std::mutex mutex_;
    std::vector<AxisState> states_;
    std::vector<int> alarms_;  // of the controllers
    bool emergency_stop_ = false;
    std::uint64_t motions_ = 0;  // homing included
    int moves_started_ = 0, requests_ = 0;
    std::vector<StageFault> pending_;  // faults that have not happened yet
    std::function<bool(const std::vector<double>&)> ready_;
};

}  // namespace etalon
