// A motorised stage without its wires: controllers that enable, home, start and stop their axes and
// raise alarms, and a carriage that is truly somewhere slightly else. For the twin
// (mocks/stage/stage_registers.h) and for tests. Every quantity is a closed form of the time since
// the last command (simulated_axis.h): a test on a VirtualClock knows the exact answer. mm or rad.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/statistics/random.h"
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

// Faults of a stage at a scripted moment (twin.yaml's `faults`). They happen once.
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
    SimulatedStage(std::vector<Axis> axes, SimulatedStageOptions options, Clock& clock)
        : axes_(std::move(axes)),
          options_(complete(std::move(options), axes_)),
          clock_(clock),
          power_on_(clock.now()),
          controllers_(controllers_of(axes_)),
          alarms_(controllers_.size(), StageAlarm::none),
          pending_(options_.faults) {
        for (std::size_t c = 0; c < controllers_.size(); ++c) {
            for (std::size_t i = states_.size(); i < controllers_[c].first + controllers_[c].count;
                 ++i)
                states_.push_back({SimulatedAxis(dynamics_of(options_, axes_, i),
                                                 options_.errors[i], options_.power_on_position[i]),
                                   c});
        }
        std::ranges::stable_sort(pending_, {},
                                 [](const StageFault& fault) { return fault.at.value; });
    }

    const std::vector<Axis>& axes() const { return axes_; }
    const std::vector<StageController>& controllers() const { return controllers_; }
    Clock& clock() const { return clock_; }

    // Commands to one controller, as it carries them out: at once, and an impossible one raises an
    // alarm. `target` and `speed` are of its axes.
    void enable(bool on, std::size_t controller = 0) {
        const std::scoped_lock lock(mutex_);
        const double t = catch_up();
        for (AxisState& axis : axes_of(controller)) {
            if (axis.enabled && !on) {
                brake(controller, t);
                axis.homed = false;
            }
            axis.enabled = on && !emergency_stop_;
        }
    }  // off brakes, and the homing is lost
    void home(std::size_t controller = 0) {
        const std::scoped_lock lock(mutex_);
        const double t = catch_up();
        const bool able = std::ranges::all_of(axes_of(controller), [&](const AxisState& axis) {
            return axis.enabled && !moves(axis, t);
        });
        if (able && alarms_[controller] == StageAlarm::none)
            begin_homing(controller, t);
        else
            fail(StageAlarm::not_ready, controller, t);
    }  // to 0, or to the limit nearest to 0
    void start(const std::vector<double>& target, const std::vector<double>& speed,
               std::size_t controller = 0) {
        const std::scoped_lock lock(mutex_);
        const double t = catch_up();
        const int refused = reason_to_refuse(target, speed, controller, t);
        if (refused != StageAlarm::none) {
            fail(refused, controller, t);
            return;
        }
        ++motions_;
        const std::span<AxisState> axes = axes_of(controller);
        for (std::size_t i = 0; i < axes.size(); ++i) {
            axes[i].claims_arrival = false;
            axes[i].physics.move_to(target[i], speed[i], drawn_error(index_of(axes[i])), t);
            if (axes[i].jammed && axes[i].physics.runs(t))
                axes[i].physics.seize(t);
        }
        ++moves_started_;
        fire(When::move, moves_started_, moves_started_, t);
    }
    // Brakes every axis from now on.
    void stop(std::size_t controller = 0) {
        now([&](double t) { brake(controller, t); });
    }
    void reset(std::size_t controller = 0) {
        now([&](double) {
            if (emergency_stop_)
                return;
            alarms_.at(controller) = StageAlarm::none;
            for (AxisState& axis : axes_of(controller))
                axis.at_limit = false;
        });
    }  // clears the alarm and the limit switches

    // What the controllers know, of all axes: positions are the encoders'.
    std::vector<AxisStatus> status() {
        std::unique_lock lock(mutex_);
        const double t = catch_up();
        std::vector<AxisStatus> statuses;
        for (const AxisState& axis : states_)
            statuses.push_back(status_of(axis, t));
        // An axis that lies may be photographed while it moves: the picture follows it.
        const bool lies = std::ranges::any_of(states_, &AxisState::claims_arrival);
        const bool moves = any_moves(states_, t);
        if (!ready_ || (moves && !lies))
            return statuses;
        const auto ready = ready_;
        const std::vector<double> truth = true_positions_at(t);
        lock.unlock();
        if (!ready(truth) && !moves) {
            for (AxisStatus& status : statuses)
                status.in_position = false;
        }
        return statuses;
    }

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
    std::vector<double> target() {
        const std::scoped_lock lock(mutex_);
        std::vector<double> targets;
        for (const AxisState& axis : states_)
            targets.push_back(axis.physics.target());
        return targets;
    }

    // While all axes rest, "in position" is reported only if `ready(true positions)`: the twin
    // renders the new picture first. Called by every status(), on its thread and without a lock;
    // must return at once. An empty function ends it.
    void hold_in_position_until(std::function<bool(const std::vector<double>&)> ready) {
        const std::scoped_lock lock(mutex_);
        ready_ = std::move(ready);
    }

    // Faults. An alarm brakes every axis of the controller and stays until reset().
    void raise_alarm(int code, std::size_t controller = 0) {
        now([&](double t) { fail(code, controller, t); });
    }
    // A jammed axis stops dead, or does not start, while it reports to be moving until stop().
    void jam(std::size_t axis, bool jammed = true) {
        now([&](double t) {
            if (jammed)
                return jam_at(axis, t);
            states_.at(axis).jammed = false;
        });
    }
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
    void press_emergency_stop(bool pressed = true) {
        now([&](double t) {
            if (pressed)
                return press_emergency_stop_at(t);
            emergency_stop_ = false;
        });
    }

    // For faults that happen with a request: to be called for each one before it is carried out.
    // Registers or coils first_written ... are written, none if the count is 0.
    void notice_request(int first_written, int count) {
        const std::scoped_lock lock(mutex_);
        const double t = catch_up();
        ++requests_;
        fire(When::request, requests_, requests_, t);
        if (count > 0)
            fire(When::write_to, first_written, first_written + count - 1, t);
    }

    // start() that moved something, of all controllers.
    int moves_started() {
        return now([&](double) { return moves_started_; });
    }
    Duration uptime() { return clock_.now() - power_on_; }  // since power-on

private:
    using When = FaultTrigger::When;
    using Fault = StageFault::Kind;
    // Beside the axes' streams of drawn errors.
    static constexpr std::uint32_t noise_stream = 1U << 16;

    static bool is_usable(const StageFault& fault, std::size_t axes) {
        const bool alarm_fits =
            fault.kind != StageFault::Kind::alarm || (fault.code >= 1 && fault.code <= 65535);
        return fault.axis < axes && fault.at.value >= 0 && std::isfinite(fault.size) && alarm_fits;
    }

    static void require_options(const std::vector<Axis>& axes,
                                const SimulatedStageOptions& options) {
        const SourcePlace place{"simulated stage"};
        if (axes.empty())
            throw ConfigError(place, "needs at least one axis");
        if (!options.errors.empty())
            require_usable(options.errors, axes);
        if (!options.servos.empty() && options.servos.size() != axes.size())
            throw ConfigError(
                place, fmt::format("{} servos for {} axes", options.servos.size(), axes.size()));
        for (const auto& servo : options.servos)
            if (servo && !(servo->window > 0.0 && std::isfinite(servo->window)))
                throw ConfigError(place, "a servo's window must be finite and more than 0");
        if (!options.power_on_position.empty())
            require_within_limits(axes, options.power_on_position, place);
        if (options.ramp.count() <= 0 || options.homing.count() < 0 || options.jerk.count() < 0)
            throw ConfigError(place,
                              "the ramp must be longer than 0 ms, homing and jerk not negative");
        const StageTemperature& temperature = options.temperature;
        if (!(std::isfinite(temperature.change) && std::isfinite(temperature.time_constant) &&
              temperature.time_constant > 0.0))
            throw ConfigError(place, "the temperature's time constant must be more than 0 s");
        for (const StageFault& fault : options.faults)
            if (!is_usable(fault, axes.size()))
                throw ConfigError(place,
                                  "a fault of an axis, at a time, or with a size that is none");
    }

    // With an entry for every axis.
    static SimulatedStageOptions complete(SimulatedStageOptions options,
                                          const std::vector<Axis>& axes) {
        require_options(axes, options);
        options.errors.resize(axes.size());
        options.power_on_position.resize(axes.size(), 0.0);
        options.servos.resize(axes.size());
        return options;
    }

    static std::vector<StageController> controllers_of(const std::vector<Axis>& axes) {
        std::vector<StageController> controllers;
        for (std::size_t i = 0; i < axes.size(); ++i) {
            if (i == 0 || axes[i].unit != axes[i - 1].unit)
                controllers.push_back({axes[i].unit, i, 0});
            ++controllers.back().count;
        }
        return controllers;
    }

    static AxisDynamics dynamics_of(const SimulatedStageOptions& options,
                                    const std::vector<Axis>& axes, std::size_t axis) {
        const auto in_seconds = [](Duration time) {
            return std::chrono::duration<double>(time).count();
        };
        AxisDynamics dynamics{.acceleration = axes[axis].speed / in_seconds(options.ramp),
                              .servo = options.servos[axis]};
        if (options.jerk.count() > 0)
            dynamics.jerk = dynamics.acceleration / in_seconds(options.jerk);
        return dynamics;
    }

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
    double catch_up() {
        const double t = std::chrono::duration<double>(clock_.now() - power_on_).count();
        while (!pending_.empty()) {
            const auto due = std::ranges::find_if(pending_, [t](const StageFault& fault) {
                return fault.at.when == When::time_ms && fault.at.value * 1e-3 <= t;
            });
            if (due == pending_.end())
                break;
            const StageFault fault = *due;
            pending_.erase(due);
            happen(fault, fault.at.value * 1e-3);
        }
        return t;
    }  // t of now, after the faults that were due by then
    std::span<AxisState> axes_of(std::size_t controller) {
        const StageController& part = controllers_.at(controller);
        return std::span(states_).subspan(part.first, part.count);
    }
    std::size_t index_of(const AxisState& axis) const {
        return static_cast<std::size_t>(&axis - states_.data());
    }
    bool is_homed(const AxisState& axis, double t) const {
        return axis.homed && t >= axis.homing_until;
    }
    bool moves(const AxisState& axis, double t) const {
        return axis.physics.runs(t) || t < axis.homing_until;
    }
    bool any_moves(std::span<const AxisState> axes, double t) const {
        return std::ranges::any_of(axes, [&](const AxisState& axis) { return moves(axis, t); });
    }
    AxisStatus status_of(const AxisState& axis, double t) const {
        const int alarm = alarms_[axis.controller];
        AxisStatus status;
        status.enabled = axis.enabled;
        status.homed = is_homed(axis, t);
        status.homing = axis.homed && t < axis.homing_until;
        status.moving = moves(axis, t) && !axis.claims_arrival;
        status.in_position =
            axis.claims_arrival || (axis.enabled && !status.moving && axis.physics.is_at_target(t));
        status.alarm = alarm;
        status.position = reading(axis, t);
        status.ready = axis.enabled && !status.moving && alarm == StageAlarm::none;
        status.emergency_stop = emergency_stop_;
        status.limit = axis.at_limit;
        return status;
    }
    double reading(const AxisState& axis, double t) const {
        // Noise is a function of the time, so that it does not matter who else reads.
        const std::size_t index = index_of(axis);
        RandomStream random(options_.seed, noise_stream + static_cast<std::uint32_t>(index),
                            static_cast<std::uint64_t>(std::llround(t * 1e9)));
        const double sigma = options_.errors[index].encoder_noise;
        return axis.physics.encoder(t) + (sigma > 0.0 ? sigma * random.normal() : 0.0);
    }
    double drawn_error(std::size_t axis) const {
        RandomStream random(options_.seed, static_cast<std::uint32_t>(axis), motions_);
        return options_.errors[axis].repeatability * random.normal();
    }
    std::vector<double> true_positions_at(double t) const {
        const double kelvin = options_.temperature.at(t);
        std::vector<double> positions;
        for (const AxisState& axis : states_)
            positions.push_back(axis.physics.true_position(t, kelvin));
        return with_lean(options_.errors, std::move(positions));
    }
    int reason_to_refuse(const std::vector<double>& target, const std::vector<double>& speed,
                         std::size_t controller, double t) {
        const std::span<AxisState> axes = axes_of(controller);
        const bool able = std::ranges::all_of(axes, [&](const AxisState& axis) {
            return axis.enabled && is_homed(axis, t) && !moves(axis, t);
        });
        if (!able || alarms_[controller] != StageAlarm::none)
            return StageAlarm::not_ready;
        if (target.size() != axes.size() || speed.size() != axes.size())
            return StageAlarm::outside_travel;
        for (std::size_t i = 0; i < axes.size(); ++i) {
            const Axis& axis = axes_[index_of(axes[i])];
            // Targets come rounded to counts: the last half count beyond a limit is inside.
            const double rounding = axis.kind == Axis::Kind::linear ? 1e-4 : 1e-6;
            const bool inside =
                target[i] >= axis.low - rounding && target[i] <= axis.high + rounding;
            if (!inside || !(speed[i] > 0.0 && speed[i] <= 1.001 * axis.speed))
                return StageAlarm::outside_travel;
        }
        return StageAlarm::none;
    }
    void begin_homing(std::size_t controller, double t) {
        ++motions_;
        double end = t + std::chrono::duration<double>(options_.homing).count();
        for (AxisState& axis : axes_of(controller)) {
            const std::size_t i = index_of(axis);
            axis.claims_arrival = false;
            axis.physics.find_zero(std::clamp(0.0, axes_[i].low, axes_[i].high), axes_[i].speed,
                                   drawn_error(i), t);
            end = std::max(end, axis.physics.ends());
            if (axis.jammed && axis.physics.runs(t))
                axis.physics.seize(t);
        }
        for (AxisState& axis : axes_of(controller)) {
            axis.homed = true;
            axis.homing_until = end;
        }
    }
    void brake(std::size_t controller, double t) {
        for (AxisState& axis : axes_of(controller)) {
            axis.homed = is_homed(axis, t);
            axis.homing_until = 0.0;
            axis.claims_arrival = false;
            axis.physics.brake(t);
        }
    }
    void fail(int code, std::size_t controller, double t) {
        // An alarm that is there already is the cause and stays.
        if (alarms_.at(controller) == StageAlarm::none)
            alarms_[controller] = code;
        brake(controller, t);
    }
    void jam_at(std::size_t index, double t) {
        AxisState& axis = states_.at(index);
        axis.jammed = true;
        if (axis.physics.runs(t))
            axis.physics.seize(t);
    }
    void hit_limit_at(std::size_t index, double t) {
        AxisState& axis = states_.at(index);
        axis.at_limit = true;
        fail(StageAlarm::limit, axis.controller, t);
    }
    void press_emergency_stop_at(double t) {
        emergency_stop_ = true;
        for (std::size_t c = 0; c < controllers_.size(); ++c) {
            alarms_[c] = StageAlarm::emergency_stop;
            brake(c, t);
        }
        for (AxisState& axis : states_)
            axis.enabled = axis.homed = false;
    }
    void happen(const StageFault& fault, double t) {
        switch (fault.kind) {
            case Fault::stuck_axis:
                return jam_at(fault.axis, t);
            case Fault::false_in_position:
                states_[fault.axis].claims_arrival = true;
                return;
            case Fault::encoder_jump:
                return states_[fault.axis].physics.jump_encoder(fault.size);
            case Fault::limit_hit:
                return hit_limit_at(fault.axis, t);
            case Fault::emergency_stop:
                return press_emergency_stop_at(t);
            case Fault::alarm:
                return fail(fault.code, states_[fault.axis].controller, t);
        }
    }
    void fire(When when, int first, int last, double t) {
        // Every fault that waits for one of the values first to last.
        std::vector<StageFault> due;
        std::erase_if(pending_, [&](const StageFault& fault) {
            const bool now =
                fault.at.when == when && fault.at.value >= first && fault.at.value <= last;
            if (now)
                due.push_back(fault);
            return now;
        });
        for (const StageFault& fault : due)
            happen(fault, t);
    }

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
