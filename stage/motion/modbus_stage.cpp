#include "stage/motion/modbus_stage.h"

#include <set>

#include "stage/motion/stage_unit.h"

namespace etalon {
namespace {

// How far an axis at rest may be read elsewhere than where it was left: noise and creep.
constexpr double rest_tolerances = 10.0;

// Consecutive axes of the same unit are one controller's.
std::vector<StageUnit> make_units(ModbusLink& link, const StageProfile& profile, int default_unit,
                                  const std::vector<Axis>& axes) {
    std::vector<StageUnit> units;
    std::set<int> seen;
    for (std::size_t first = 0, end = 0; first < axes.size() || units.empty(); first = end) {
        const auto unit_of = [&](std::size_t i) { return axes[i].unit.value_or(default_unit); };
        while (end < axes.size() && unit_of(end) == unit_of(first))
            ++end;
        const int unit = axes.empty() ? default_unit : unit_of(first);
        if (!seen.insert(unit).second)
            throw ConfigError({"stage axes", 0, axes[first].name},
                              fmt::format("the axes of unit {} must stand together", unit));
        units.emplace_back(link, profile, unit,
                           std::vector<Axis>(axes.begin() + static_cast<std::ptrdiff_t>(first),
                                             axes.begin() + static_cast<std::ptrdiff_t>(end)));
    }
    return units;
}

using namespace std::chrono_literals;

constexpr auto start_time = 500ms;   // in which a start that was not answered must be seen
constexpr double implausible = 1.5;  // times the speed, beyond any overshoot
constexpr auto stop_pause = 20ms;    // between attempts to stop

bool all_hold(const AxisStatus& axis, const std::vector<Condition>& conditions) {
    return std::ranges::all_of(conditions, [&](const Condition& c) { return holds(axis, c); });
}

class ModbusStage final : public Stage {
public:
    ModbusStage(const StageLink& link, StageProfile profile, std::vector<Axis> axes, Clock& clock,
                std::unique_ptr<ModbusTransport> transport, Opening opening)
        : profile_(std::move(profile)),
          axes_(std::move(axes)),
          clock_(clock),
          link_(link, clock, std::move(transport)),
          units_(make_units(link_, profile_, link.unit, axes_)) {
        if (opening == Opening::asks_nothing)
            return;
        poll();
        for (StageUnit& unit : units_)
            unit.read_inputs();
    }

    // Stops axes that it enabled; leaves them enabled, since a vertical axis may drop otherwise.
    ~ModbusStage() override {
        if (ever_enabled_)
            stop();
    }

    const std::vector<Axis>& axes() const override { return axes_; }

    // Also resets alarms that are left from before; one that stays is a DeviceError.
    void enable(std::stop_token stop) override {
        require_usable("enable");
        guarded([&] {
            const Statuses axes = poll();
            ever_enabled_ = true;
            if (is_stop_left_on() && !this->stop())
                fail("enable", "an earlier program's stop is still on and cannot be ended");
            if (std::ranges::any_of(axes, [](const AxisStatus& axis) { return axis.alarm != 0; })) {
                Run reset = begin("reset the alarms", {pressed}, stop);
                carry_out(profile_.sequences.reset, reset);
            }
            Run run = begin("enable", {pressed, alarmed}, stop);
            carry_out(profile_.sequences.enable, run);
            state_ = State::enabled;
        });
    }

    // Limit switches may be what the axes look for.
    void home(std::stop_token stop) override {
        require_usable("home");
        if (state_ == State::connected)
            fail("home", "the axes are not enabled");
        guarded([&] {
            state_ = State::enabled;
            left_at_.clear();
            Run run = begin("home", {pressed, alarmed, disabled}, std::move(stop));
            keep_watchdog(true);
            carry_out(profile_.sequences.home, run);
            require_seen_to_home(run);
            state_ = State::homed;
        });
    }

    void resume() override {
        require_usable("resume");
        require_homed(poll());
        if (is_stop_left_on())
            fail("resume", "an earlier program's stop is still on: stop the axes again to end it");
        ever_enabled_ = true;
        state_ = State::homed;
    }

    void take_for_homed() override { taken_for_homed_ = true; }

    void move(std::span<const double> target, std::stop_token stop) override {
        require_usable("move");
        if (state_ != State::homed)
            fail("move", "the axes are not homed");
        require_within_limits(axes_, target, {link_.device(), 0, "move"});
        guarded([&] {
            Run run = begin("move", {pressed, at_limit, alarmed, disabled}, std::move(stop));
            require_own_commands(run);
            require_left_alone(run.request, run.now);
            left_at_.clear();
            run.target = target;
            keep_watchdog(true);
            carry_out(profile_.sequences.move, run);
            for (const AxisStatus& axis : run.now)
                left_at_.push_back(axis.position);
        });
    }

    void limit_speed(double share) override {
        if (!(share > 0.0 && share <= 1.0))
            throw ConfigError({"stage speed"},
                              fmt::format("a share of {} is not in (0, 1]", share));
        for (const StageUnit& unit : units_)
            unit.require_speed(share);
        speed_share_ = share;
    }

    std::vector<double> position() override {
        constexpr const char* request = "read the positions";
        const Statuses axes = poll();
        const std::string cause =
            disturbance(axes_, axes, std::array{pressed, at_limit, alarmed}, profile_);
        if (!cause.empty())
            fail(request, cause);
        require_left_alone(request, axes);
        std::vector<double> positions;
        for (const AxisStatus& axis : axes)
            positions.push_back(axis.position);
        return positions;
    }

    std::vector<AxisStatus> status() override { return poll(); }

    bool stop() noexcept override {
        try {
            left_at_.clear();
            const bool stopped = stop_by(clock_.now() + stop_time());
            link_.hurry({});
            if (!stopped)
                state_ = State::faulted;
            return stopped;
        } catch (const std::exception&) {
            state_ = State::faulted;
            return false;
        }
    }

    std::string trace() const override { return etalon::describe(link_.last_exchanges()); }

    void set_trace(std::function<void(const std::string&)> line) override {
        if (!line)
            return link_.set_trace({});
        link_.set_trace(
            [line = std::move(line), origin = clock_.now()](const ModbusExchange& exchange) {
                line(etalon::describe(exchange, origin));
            });
    }

private:
    // At most 200 polls a second.
    static constexpr std::chrono::milliseconds poll_period{5};

    enum class State { connected, enabled, homed, faulted };
    using Statuses = std::vector<AxisStatus>;

    // One sequence that is being carried out.
    struct Run {
        const char* request;          // "move", for errors
        std::vector<Condition> ends;  // end it as soon as a poll shows one of an axis
        std::stop_token stop;
        std::span<const double> target = {};  // of a move
        Statuses before = {};                 // when it began
        std::vector<bool> started = {};       // axes that were seen to start since then
        Statuses now = {};                    // the last poll
        Instant polled{};                     // when that began
        bool fresh = false;                   // nothing was written since then
    };

    [[noreturn]] void fail(const char* request, const std::string& cause) const {
        throw DeviceError(link_.device(), request, cause);
    }

    void require_usable(const char* request) const {
        if (state_ == State::faulted)
            fail(request, "the stage is faulted since an earlier error; only stopping is allowed");
    }

    // Runs `action`; whatever it throws goes on only after the axes were told to stop.
    void guarded(const std::function<void()>& action) {
        try {
            action();
        } catch (const Interrupted&) {
            if (!stop())
                fail("stop", "interrupted; the stop was NOT confirmed");
            throw;
        } catch (const DeviceError& error) {
            state_ = State::faulted;
            const char* outcome =
                stop() ? "; the axes were stopped" : "; the stop was NOT confirmed";
            throw DeviceError(error.device(), error.request(), error.cause() + outcome);
        } catch (const std::exception&) {
            state_ = State::faulted;
            stop();
            throw;
        }
    }

    Run begin(const char* request, std::vector<Condition> ends, std::stop_token stop) {
        throw_if_stopped(stop);
        Run run{request, std::move(ends), std::move(stop)};
        run.started.resize(axes_.size());
        poll(run);
        run.before = run.now;
        return run;
    }

    // An encoder that jumped, or a stage that was pushed, has lost its zero.
    void require_left_alone(const char* request, const Statuses& axes) const {
        for (std::size_t i = 0; i < left_at_.size(); ++i) {
            if (std::abs(axes[i].position - left_at_[i]) <=
                rest_tolerances * profile_.tolerance(axes_[i]))
                continue;
            Statuses left = axes;
            for (std::size_t k = 0; k < left.size(); ++k)
                left[k].position = left_at_[k];
            fail(request, fmt::format("the axes are not where they were left: {}, not {}",
                                      describe(axes), describe(left)));
        }
    }

    // A stop that was not ours: the next start would undo it.
    void require_own_commands(const Run& run) {
        for (StageUnit& unit : units_)
            if (const std::string change = unit.changed_by_others(); !change.empty())
                throw DeviceError(unit.device(), run.request,
                                  "another program or the operator stopped the stage: " + change);
    }

    void require_homed(const Statuses& axes) const {
        if (!profile_.has(Signal::homed) && !taken_for_homed_)
            fail("resume",
                 "the controller does not tell whether its axes are homed: say that they "
                 "are (--homed), if they were homed since they were switched on");
        const auto refuse = [&](std::size_t i, const std::string& what) {
            fail("resume", fmt::format("axis {} {}", axes_[i].name, what));
        };
        for (std::size_t i = 0; i < axes.size(); ++i) {
            if (axes[i].alarm != 0)
                refuse(i, "has " + profile_.describe_alarm(axes[i].alarm));
            if (axes[i].emergency_stop)
                refuse(i, "is in emergency stop");
            if (axes[i].moving || axes[i].homing)
                refuse(i, "moves");
            if (!axes[i].enabled)
                refuse(i, "is not enabled: home the axes first");
            if (!axes[i].homed)
                refuse(i, "is not homed: home the axes first");
        }
    }

    // Rest alone is no homing: a controller that does not tell may have ignored it.
    void require_seen_to_home(const Run& run) const {
        if (profile_.has(Signal::homed) || taken_for_homed_)
            return;
        const auto still = std::ranges::find(run.started, false);
        if (still != run.started.end())
            fail(
                run.request,
                fmt::format("axis {} did not move, and its controller does not tell whether it is "
                            "homed: it may stand at its zero, or not have obeyed. Look at it, then "
                            "say that it is homed: --homed with qualify, stage move or stage jog",
                            axes_[static_cast<std::size_t>(still - run.started.begin())].name));
    }

    // By a program that ended before its stop was confirmed. It may suppress homing and starts.
    bool is_stop_left_on() const {
        return profile_.inputs.contains(Input::stop) &&
               std::ranges::any_of(units_,
                                   [](const StageUnit& unit) { return unit.is_on(Input::stop); });
    }

    std::string describe(const Statuses& axes) const {
        std::string text;
        for (std::size_t i = 0; i < axes.size(); ++i) {
            const bool linear = axes_[i].kind == Axis::Kind::linear;
            const double shown = linear ? axes[i].position : axes[i].position * deg_per_rad;
            text += fmt::format("{}{} at {:.4f} {}{}", i == 0 ? "" : ", ", axes_[i].name, shown,
                                linear ? "mm" : "deg", axes[i].moving ? " and moving" : "");
        }
        return text;
    }

    Statuses poll(int attempts = 3) {
        Statuses all;
        for (StageUnit& unit : units_)
            std::ranges::copy(unit.poll(attempts), std::back_inserter(all));
        return all;
    }

    // What must end the run ends it here.
    void poll(Run& run) {
        const Instant start = clock_.now();
        Statuses axes = poll();
        if (const std::string cause = disturbance(axes_, axes, run.ends, profile_); !cause.empty())
            fail(run.request, cause);
        if (!run.target.empty() && !run.now.empty())
            check_plausible(run, axes, clock_.now());
        run.now = std::move(axes);
        for (std::size_t i = 0; i < run.before.size(); ++i)
            run.started[i] = run.started[i] || has_started(run, i);
        run.polled = start;
        run.fresh = true;
    }

    void carry_out(const std::vector<Step>& steps, Run& run) {
        for (const Step& step : steps) {
            throw_if_stopped(run.stop);
            switch (step.kind) {
                case Step::Kind::require:
                    require_conditions(step, run);
                    break;
                case Step::Kind::wait:
                    wait(step, run);
                    break;
                case Step::Kind::wait_done:
                    wait_done(run);
                    break;
                default:
                    give(step, run);
            }
        }
    }

    void give(const Step& step, Run& run) {
        std::size_t first = 0;
        for (StageUnit& unit : units_) {
            keep_watchdog(false);
            give_to(unit, step, run, first);
            first += unit.axes().size();
        }
        run.fresh = false;
    }

    void give_to(StageUnit& unit, const Step& step, Run& run, std::size_t first_axis) {
        const std::size_t count = unit.axes().size();
        try {
            switch (step.kind) {
                case Step::Kind::set:
                    return unit.set(step.input, true);
                case Step::Kind::clear:
                    return unit.set(step.input, false);
                case Step::Kind::pulse:
                    return unit.pulse(step.input);
                default:
                    return unit.write_target(run.target.subspan(first_axis, count), speed_share_);
            }
        } catch (const UncertainWrite&) {
            if (!starts_motion(profile_, step))
                throw;
        }
        confirm_start(run, first_axis, count);
        if (pulses_bit(step))
            unit.set(step.input, false);
    }

    bool pulses_bit(const Step& step) const {
        return step.kind == Step::Kind::pulse &&
               profile_.inputs.at(step.input).act != InputPoint::Act::code;
    }

    // The reply to a start is missing and the register does not tell: the axes have to.
    void confirm_start(Run& run, std::size_t first_axis, std::size_t count) {
        const Instant deadline = clock_.now() + start_time;
        for (;;) {
            throw_if_stopped(run.stop);
            keep_watchdog(false);
            poll(run);
            bool started = true;
            for (std::size_t i = first_axis; i < first_axis + count; ++i)
                started = started && has_started(run, i);
            if (started)
                return;
            if (clock_.now() >= deadline)
                fail(run.request,
                     "the start was not answered and no axis was seen to start; it is not "
                     "given again");
            clock_.wait_for(poll_period, run.stop);
        }
    }

    void require_conditions(const Step& step, Run& run) {
        if (!run.fresh)
            poll(run);
        for (std::size_t i = 0; i < axes_.size(); ++i) {
            for (const Condition& condition : step.conditions) {
                if (!holds(run.now[i], condition))
                    fail(run.request,
                         fmt::format("axis {} is {}{}", axes_[i].name, condition.on ? "not " : "",
                                     name_of(condition.signal)));
            }
        }
    }

    void wait(const Step& step, Run& run) {
        const auto done = [&](const Statuses& axes) {
            return std::ranges::all_of(
                axes, [&](const AxisStatus& axis) { return all_hold(axis, step.conditions); });
        };
        wait_until(run, done, std::max<Duration>(step.held, profile_.done.settle), step.within);
    }

    void wait_done(Run& run) {
        const auto done = [&](const Statuses& axes) {
            bool all = true;
            for (std::size_t i = 0; i < axes.size(); ++i) {
                const bool started = run.started[i] || !profile_.done.start_seen;
                all = all && started && is_at(axes[i], i, run.target[i]);
            }
            return all;
        };
        wait_until(run, done, profile_.done.settle, time_limit(run));
    }

    // Until `done` was so in several successive polls and for `held`.
    void wait_until(Run& run, const std::function<bool(const Statuses&)>& done, Duration held,
                    Duration limit) {
        const Instant deadline = clock_.now() + limit;
        int stable = 0;
        Instant stable_since{};
        for (;;) {
            throw_if_stopped(run.stop);
            keep_watchdog(false);
            poll(run);
            const Instant now = clock_.now();
            stable = done(run.now) ? stable + 1 : 0;
            if (stable == 1)
                stable_since = now;
            if (stable >= profile_.done.stable_polls && now - stable_since >= held)
                return;
            const bool rests = std::ranges::none_of(run.now, &AxisStatus::moving);
            if (stable == 0 && rests)
                require_own_commands(run);
            if (now >= deadline)
                fail(run.request,
                     fmt::format(
                         "not done after {} ms: {}{}",
                         std::chrono::duration_cast<std::chrono::milliseconds>(limit).count(),
                         describe(run.now),
                         rests ? "; nothing moves: another program or the operator may have "
                                 "stopped it"
                               : ""));
            clock_.wait_for(poll_period, run.stop);
        }
    }

    // An impossible position is another register's, or the encoder jumped.
    void check_plausible(const Run& run, const Statuses& axes, Instant now) const {
        const double seconds = std::chrono::duration<double>(now - run.polled).count();
        for (std::size_t i = 0; i < axes.size(); ++i) {
            const double way = std::abs(axes[i].position - run.now[i].position);
            const double most =
                implausible * axes_[i].speed * seconds + 10.0 * profile_.tolerance(axes_[i]);
            if (!(way <= most))
                fail(run.request,
                     fmt::format("axis {} cannot have come so far in {:.1f} ms: {}, before {}",
                                 axes_[i].name, seconds * 1e3, describe(axes), describe(run.now)));
        }
    }

    bool has_started(const Run& run, std::size_t axis) const {
        const AxisStatus &before = run.before[axis], &now = run.now[axis];
        if (now.moving || (before.in_position && !now.in_position))
            return true;
        const double came = std::abs(now.position - before.position);
        if (run.target.empty())
            return before.homed != now.homed || came > profile_.tolerance(axes_[axis]);
        const double way = std::abs(run.target[axis] - before.position);
        return way <= profile_.tolerance(axes_[axis]) || came >= 0.5 * way;
    }

    bool is_at(const AxisStatus& status, std::size_t axis, double target) const {
        const bool says_so = status.in_position || !profile_.done.in_position;
        return !status.moving && says_so &&
               std::abs(status.position - target) <= profile_.tolerance(axes_[axis]);
    }

    Duration time_limit(const Run& run) const {
        double seconds = 0.0;
        std::size_t i = 0;
        for (const StageUnit& unit : units_) {
            for (const Axis& axis : unit.axes()) {
                const double way = std::abs(run.target[i] - run.before[i].position);
                seconds = std::max(seconds, way / unit.commanded_speed(axis, speed_share_));
                ++i;
            }
        }
        return duration_of(seconds * profile_.limits.move_factor) + profile_.limits.move_margin;
    }

    void keep_watchdog(bool at_once) {
        if (!profile_.watchdog)
            return;
        const Instant now = clock_.now();
        const bool due =
            watchdog_written_ && now - *watchdog_written_ >= profile_.watchdog->timeout / 4;
        if (!at_once && !due)
            return;
        for (StageUnit& unit : units_)
            unit.feed_watchdog();
        watchdog_written_ = now;
    }

    // All of stopping, fresh connections included.
    Duration stop_time() const {
        Duration time{};
        for (const Step& step : profile_.sequences.stop)
            time += step.within;
        return time;
    }

    bool stop_by(Instant deadline) {
        while (!stop_once(deadline)) {
            if (clock_.now() + stop_pause >= deadline)
                return false;
            clock_.wait_for(stop_pause, {});
        }
        return true;
    }

    // Steps after the confirmation only tidy up: the axes rest already.
    bool stop_once(Instant deadline) {
        bool told = true, confirmed = false;
        for (const Step& step : profile_.sequences.stop) {
            if (step.kind != Step::Kind::wait) {
                told = tell(step, deadline) && told;
            } else {
                if (!confirmed && !(told && confirm(step, deadline)))
                    return false;
                confirmed = true;
            }
        }
        return confirmed;
    }

    // A stop is harmless to repeat, so it is written without reading back. A unit that does not
    // answer, or a trace that cannot be written, keeps none of the others from being told.
    bool tell(const Step& step, Instant deadline) {
        bool all = true;
        for (StageUnit& unit : units_) {
            try {
                // A silent one may not use up the others' time.
                const Instant now = clock_.now();
                link_.hurry(now + (deadline - now) / static_cast<int>(units_.size()));
                unit.set_at_once(step.input, step.kind != Step::Kind::clear);
                if (pulses_bit(step))
                    unit.set_at_once(step.input, false);
            } catch (const std::exception&) {
                link_.close();
                all = false;
            }
        }
        return all;
    }

    bool confirm(const Step& step, Instant deadline) {
        const auto rests = [&](const AxisStatus& axis) { return all_hold(axis, step.conditions); };
        for (int resting = 0; resting < profile_.done.stable_polls;) {
            if (clock_.now() >= deadline)
                return false;
            link_.hurry(deadline);
            try {
                resting = std::ranges::all_of(poll(1), rests) ? resting + 1 : 0;
            } catch (const std::exception&) {
                link_.close();
                return false;
            }
            clock_.wait_for(poll_period, {});
        }
        return true;
    }

    StageProfile profile_;
    std::vector<Axis> axes_;
    Clock& clock_;
    ModbusLink link_;
    std::vector<StageUnit> units_;  // in the order of the axes
    State state_ = State::connected;
    bool ever_enabled_ = false;  // by this object
    bool taken_for_homed_ = false;
    double speed_share_ = 1.0;     // of each axis' speed
    std::vector<double> left_at_;  // by the last homing or move; empty: unknown
    std::optional<Instant> watchdog_written_;
};

}  // namespace

std::unique_ptr<Stage> open_modbus_stage(const StageLink& link, StageProfile profile,
                                         std::vector<Axis> axes, Clock& clock,
                                         std::unique_ptr<ModbusTransport> transport,
                                         Opening opening) {
    return std::make_unique<ModbusStage>(link, std::move(profile), std::move(axes), clock,
                                         std::move(transport), opening);
}

std::unique_ptr<Stage> open_stage(const StageLink& link, const std::string& profile,
                                  std::vector<Axis> axes, Clock& clock, Opening opening) {
    return open_modbus_stage(link, named_stage_profile(profile), std::move(axes), clock, nullptr,
                             opening);
}

}  // namespace etalon
