// Carrying out sequences: giving inputs, waiting, and looking at every poll for what must end a
// run.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "stage/motion/axis_signals.h"
#include "stage/motion/modbus_stage.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr auto start_time = 500ms;   // in which a start that was not answered must be seen
constexpr double implausible = 1.5;  // times the speed, beyond any overshoot

std::string what_failed(const Condition& failed) {
    return fmt::format("{}{}", failed.on ? "not " : "", name_of(failed.signal));
}

}  // namespace

std::vector<AxisStatus> ModbusStage::poll(int attempts) {
    Statuses all;
    for (StageUnit& unit : units_) {
        const Statuses some = unit.poll(attempts);
        all.insert(all.end(), some.begin(), some.end());
    }
    return all;
}

// What must end the run ends it here.
void ModbusStage::poll(Run& run) {
    const Instant start = clock_.now();
    Statuses axes = poll();
    if (const std::string cause = disturbance(axes_, axes, run.ends, profile_); !cause.empty())
        throw DeviceError(link_.device(), run.request, cause);
    if (!run.target.empty() && !run.now.empty())
        check_plausible(run, axes, clock_.now());
    run.now = std::move(axes);
    for (std::size_t i = 0; i < run.before.size(); ++i)
        run.started[i] = run.started[i] || has_started(run, run.now, i);
    run.polled = start;
    run.fresh = true;
}

// A position that the axis cannot have reached since the last poll is another register's, or the
// encoder jumped.
void ModbusStage::check_plausible(const Run& run, const Statuses& axes, Instant now) const {
    const double seconds = std::chrono::duration<double>(now - run.polled).count();
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const double way = std::abs(axes[i].position - run.now[i].position);
        const double most =
            implausible * axes_[i].speed * seconds + 10.0 * profile_.tolerance(axes_[i]);
        if (!(way <= most))
            throw DeviceError(
                link_.device(), run.request,
                fmt::format("axis {} cannot have come so far in {:.1f} ms: {}, before {}",
                            axes_[i].name, seconds * 1e3, describe(axes), describe(run.now)));
    }
}

void ModbusStage::carry_out(const std::vector<Step>& steps, Run& run) {
    for (const Step& step : steps) {
        if (run.stop.stop_requested())
            throw Interrupted();
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

void ModbusStage::give(const Step& step, Run& run) {
    std::size_t first = 0;
    for (StageUnit& unit : units_) {
        keep_watchdog(false);
        give_to(unit, step, run, first);
        first += unit.axes().size();
    }
    run.fresh = false;
}

void ModbusStage::give_to(StageUnit& unit, const Step& step, Run& run, std::size_t first_axis) {
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
    const bool pulses_bit = step.kind == Step::Kind::pulse &&
                            profile_.inputs.at(step.input).act != InputPoint::Act::code;
    if (pulses_bit)
        unit.set(step.input, false);
}

// The reply to a start is missing and the register does not tell: the axes have to.
void ModbusStage::confirm_start(Run& run, std::size_t first_axis, std::size_t count) {
    const Instant deadline = clock_.now() + start_time;
    for (;;) {
        if (run.stop.stop_requested())
            throw Interrupted();
        keep_watchdog(false);
        poll(run);
        bool started = true;
        for (std::size_t i = first_axis; i < first_axis + count; ++i)
            started = started && has_started(run, run.now, i);
        if (started)
            return;
        if (clock_.now() >= deadline)
            throw DeviceError(link_.device(), run.request,
                              "the start was not answered and no axis was seen to start; it is not "
                              "given again");
        clock_.wait_for(poll_period, run.stop);
    }
}

bool ModbusStage::has_started(const Run& run, const Statuses& axes, std::size_t axis) const {
    const AxisStatus &before = run.before[axis], &now = axes[axis];
    if (now.moving || (before.in_position && !now.in_position))
        return true;
    const double came = std::abs(now.position - before.position);
    if (run.target.empty())
        return before.homed != now.homed || came > profile_.tolerance(axes_[axis]);
    const double way = std::abs(run.target[axis] - before.position);
    return way <= profile_.tolerance(axes_[axis]) || came >= 0.5 * way;
}

void ModbusStage::require_conditions(const Step& step, Run& run) {
    if (!run.fresh)
        poll(run);
    for (std::size_t i = 0; i < axes_.size(); ++i) {
        for (const Condition& condition : step.conditions) {
            if (!holds(run.now[i], condition))
                throw DeviceError(
                    link_.device(), run.request,
                    fmt::format("axis {} is {}", axes_[i].name, what_failed(condition)));
        }
    }
}

void ModbusStage::wait(const Step& step, Run& run) {
    const auto done = [&](const Statuses& axes) {
        return std::ranges::all_of(axes, [&](const AxisStatus& axis) {
            return std::ranges::all_of(step.conditions, [&](const Condition& condition) {
                return holds(axis, condition);
            });
        });
    };
    wait_until(run, done, std::max<Duration>(step.held, profile_.done.settle), step.within);
}

void ModbusStage::wait_done(Run& run) {
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

bool ModbusStage::is_at(const AxisStatus& status, std::size_t axis, double target) const {
    const bool says_so = status.in_position || !profile_.done.in_position;
    return !status.moving && says_so &&
           std::abs(status.position - target) <= profile_.tolerance(axes_[axis]);
}

Duration ModbusStage::time_limit(const Run& run) const {
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

// Until `done` was so in several successive polls and for `held`.
void ModbusStage::wait_until(Run& run, const std::function<bool(const Statuses&)>& done,
                             Duration held, Duration limit) {
    const Instant deadline = clock_.now() + limit;
    int stable = 0;
    Instant stable_since{};
    for (;;) {
        if (run.stop.stop_requested())
            throw Interrupted();
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
            throw DeviceError(
                link_.device(), run.request,
                fmt::format("not done after {} ms: {}{}",
                            std::chrono::duration_cast<std::chrono::milliseconds>(limit).count(),
                            describe(run.now),
                            rests ? "; nothing moves: another program or the operator may have "
                                    "stopped it"
                                  : ""));
        clock_.wait_for(poll_period, run.stop);
    }
}

void ModbusStage::keep_watchdog(bool at_once) {
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

}  // namespace etalon
