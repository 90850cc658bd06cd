#include "stage/modbus_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr auto poll_period = 5ms;  // at most 200 polls a second
constexpr auto stop_time = 2s;     // stop() takes no longer
constexpr int write_attempts = 3;
constexpr int alarm_without_code = -1;
constexpr double deg_per_rad = 180.0 / std::numbers::pi;

void require_counts(const StageProfile& profile, const std::vector<Axis>& axes) {
    constexpr double most = std::numeric_limits<std::int32_t>::max();
    if (axes.empty() || axes.size() > static_cast<std::size_t>(profile.max_axes))
        throw ConfigError({"stage axes"}, fmt::format("profile '{}' drives 1 to {} axes, not {}",
                                                      profile.name, profile.max_axes, axes.size()));
    for (const Axis& axis : axes) {
        const double counts = profile.counts_per_unit(axis);
        const double reach = std::max(std::abs(axis.low), std::abs(axis.high));
        if (!(reach * counts <= most))
            throw ConfigError({"stage axes", 0, axis.name}, "its limits exceed 32-bit counts");
        if (!(axis.speed * counts >= 1.0 && axis.speed * counts <= most))
            throw ConfigError({"stage axes", 0, axis.name},
                              "its speed is not 1 to 2147483647 counts per second");
    }
}

void append(std::vector<std::uint16_t>& registers, int offset, double counts) {
    const auto [high, low] = registers_from_int32(static_cast<std::int32_t>(std::llround(counts)));
    registers[static_cast<std::size_t>(offset)] = high;
    registers[static_cast<std::size_t>(offset) + 1] = low;
}

bool any_moves(const std::vector<AxisStatus>& axes) {
    return std::ranges::any_of(axes, &AxisStatus::moving);
}

}  // namespace

ModbusStage::ModbusStage(const StageLink& link, StageProfile profile, std::vector<Axis> axes,
                         Clock& clock, std::unique_ptr<ModbusTransport> transport)
    : link_settings_(link),
      profile_(std::move(profile)),
      axes_(std::move(axes)),
      clock_(clock),
      link_(link, clock, std::move(transport)) {
    require_counts(profile_, axes_);
    poll();
    const std::uint16_t command = read(profile_.command.address, 1).front();
    drives_on_ = command >> profile_.command.enable & 1;
}

ModbusStage::~ModbusStage() {
    if (ever_enabled_)
        stop();
}

std::string ModbusStage::trace() const {
    return etalon::describe(link_.last_exchanges());
}

void ModbusStage::set_trace(std::function<void(const std::string&)> line) {
    if (!line)
        return link_.set_trace({});
    link_.set_trace(
        [line = std::move(line), origin = clock_.now()](const ModbusExchange& exchange) {
            line(etalon::describe(exchange, origin));
        });
}

std::vector<std::uint16_t> ModbusStage::read(int address, int count, int attempts) {
    return link_.read(link_settings_.unit, RegisterSpace::holding_registers, address, count,
                      attempts);
}

void ModbusStage::write(int address, std::span<const std::uint16_t> values) {
    link_.write(link_settings_.unit, RegisterSpace::holding_registers, address, values);
}

std::vector<AxisStatus> ModbusStage::status() {
    return poll();
}

std::vector<double> ModbusStage::position() {
    std::vector<double> positions;
    for (const AxisStatus& axis : poll())
        positions.push_back(axis.position);
    return positions;
}

std::vector<AxisStatus> ModbusStage::poll(int attempts) {
    const auto& map = profile_.poll;
    const auto& bits = profile_.status_bits;
    const int count = static_cast<int>(axes_.size()) * map.stride;
    const auto registers = read(map.address, count, attempts);
    std::vector<AxisStatus> statuses;
    for (std::size_t i = 0; i < axes_.size(); ++i) {
        const std::uint16_t* group = &registers[i * static_cast<std::size_t>(map.stride)];
        const auto bit = [word = group[map.status]](int number) {
            return (word >> number & 1) != 0;
        };
        AxisStatus status{bit(bits.enabled), bit(bits.homed), bit(bits.moving),
                          bit(bits.in_position)};
        if (bit(bits.alarm))
            status.alarm = group[map.alarm] != 0 ? group[map.alarm] : alarm_without_code;
        status.position = int32_from_registers(group[map.position], group[map.position + 1]) /
                          profile_.counts_per_unit(axes_[i]);
        statuses.push_back(status);
    }
    return statuses;
}

void ModbusStage::require_usable(const char* request) const {
    if (state_ == State::faulted)
        throw DeviceError(link_.device(), request,
                          "the stage is faulted since an earlier error; only stopping is allowed");
}

void ModbusStage::require_no_alarm(const std::vector<AxisStatus>& axes, const char* request) const {
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (axes[i].alarm == 0)
            continue;
        const std::string alarm = axes[i].alarm == alarm_without_code
                                      ? "alarm without a code"
                                      : profile_.describe_alarm(axes[i].alarm);
        throw DeviceError(link_.device(), request,
                          fmt::format("axis {}: {}", axes_[i].name, alarm));
    }
}

void ModbusStage::require_healthy(const std::vector<AxisStatus>& axes, const char* request) const {
    require_no_alarm(axes, request);
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (!axes[i].enabled)
            throw DeviceError(link_.device(), request,
                              fmt::format("axis {} is not enabled any more", axes_[i].name));
    }
}

void ModbusStage::require_ready(const std::vector<AxisStatus>& axes) const {
    require_healthy(axes, "move");
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (!axes[i].homed || axes[i].moving)
            throw DeviceError(link_.device(), "move",
                              fmt::format("axis {} is {}", axes_[i].name,
                                          axes[i].homed ? "moving already" : "not homed"));
    }
}

// Runs `action`; whatever it throws goes on only after the axes were told to stop.
void ModbusStage::guarded(const std::function<void()>& action) {
    try {
        action();
    } catch (const Interrupted&) {
        if (!stop())
            state_ = State::faulted;
        throw;
    } catch (const DeviceError& error) {
        state_ = State::faulted;
        const char* outcome = stop() ? "; the axes were stopped" : "; the stop was NOT confirmed";
        throw DeviceError(error.device(), error.request(), error.cause() + outcome);
    } catch (const std::exception&) {
        state_ = State::faulted;
        stop();
        throw;
    }
}

std::uint16_t ModbusStage::command_word(std::initializer_list<int> bits) const {
    unsigned word = drives_on_ ? 1U << profile_.command.enable : 0U;
    for (const int bit : bits)
        word |= 1U << bit;
    return static_cast<std::uint16_t>(word);
}

void ModbusStage::set_command(std::initializer_list<int> bits) {
    write_and_verify(profile_.command.address, {command_word(bits)});
}

// Writes, and where the reply is missing reads back before anything is written again.
void ModbusStage::write_and_verify(int address, const std::vector<std::uint16_t>& values) {
    for (int attempt = 1;; ++attempt) {
        try {
            return write(address, values);
        } catch (const UncertainWrite&) {
            if (read(address, static_cast<int>(values.size())) == values)
                return;
            if (attempt == write_attempts)
                throw;
        }
    }
}

void ModbusStage::keep_watchdog(bool at_once) {
    if (!profile_.watchdog)
        return;
    const auto& watchdog = *profile_.watchdog;
    const Instant now = clock_.now();
    if (!at_once && now - watchdog_written_ < watchdog.timeout / 4)
        return;
    write_and_verify(watchdog.address, {static_cast<std::uint16_t>(watchdog.timeout.count())});
    watchdog_written_ = now;
}

void ModbusStage::wait_until(const Done& done, Duration limit, const char* request,
                             std::stop_token stop) {
    const Instant deadline = clock_.now() + limit;
    int stable = 0;
    Instant stable_since{};
    for (;;) {
        if (stop.stop_requested())
            throw Interrupted();
        keep_watchdog(false);
        const std::vector<AxisStatus> axes = poll();
        const Instant now = clock_.now();
        stable = done(axes) ? stable + 1 : 0;
        if (stable == 1)
            stable_since = now;
        if (stable >= profile_.done.stable_polls && now - stable_since >= profile_.done.settle)
            return;
        if (now >= deadline) {
            const auto allowed = std::chrono::duration_cast<std::chrono::milliseconds>(limit);
            throw DeviceError(
                link_.device(), request,
                fmt::format("not done after {} ms: {}", allowed.count(), describe(axes)));
        }
        clock_.wait_for(poll_period, stop);
    }
}

std::string ModbusStage::describe(const std::vector<AxisStatus>& axes) const {
    std::string text;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const bool linear = axes_[i].kind == Axis::Kind::linear;
        const double shown = linear ? axes[i].position : axes[i].position * deg_per_rad;
        text += fmt::format("{}{} at {:.4f} {}{}", i == 0 ? "" : ", ", axes_[i].name, shown,
                            linear ? "mm" : "deg", axes[i].moving ? " and moving" : "");
    }
    return text;
}

void ModbusStage::reset_alarms(std::stop_token stop) {
    set_command({});
    set_command({profile_.command.reset});
    const auto no_alarm = [](const std::vector<AxisStatus>& axes) {
        return std::ranges::all_of(axes, [](const AxisStatus& axis) { return axis.alarm == 0; });
    };
    wait_until(no_alarm, profile_.limits.enable, "reset the alarms", stop);
    set_command({});
}

void ModbusStage::enable(std::stop_token stop) {
    require_usable("enable");
    guarded([&] {
        const auto before = poll();
        if (std::ranges::any_of(before, [](const AxisStatus& axis) { return axis.alarm != 0; }))
            reset_alarms(stop);
        ever_enabled_ = drives_on_ = true;
        set_command({});
        const auto all_enabled = [this](const std::vector<AxisStatus>& axes) {
            require_no_alarm(axes, "enable");
            return std::ranges::all_of(axes, &AxisStatus::enabled);
        };
        wait_until(all_enabled, profile_.limits.enable, "enable", stop);
        state_ = State::enabled;
    });
}

void ModbusStage::home(std::stop_token stop) {
    require_usable("home");
    if (state_ == State::connected)
        throw DeviceError(link_.device(), "home", "the axes are not enabled");
    guarded([&] {
        state_ = State::enabled;
        require_healthy(poll(), "home");
        keep_watchdog(true);
        set_command({});
        set_command({profile_.command.home});
        const auto homed = [this](const std::vector<AxisStatus>& axes) {
            require_healthy(axes, "home");
            return !any_moves(axes) && std::ranges::all_of(axes, &AxisStatus::homed);
        };
        wait_until(homed, profile_.limits.home, "home", stop);
        set_command({});
        state_ = State::homed;
    });
}

void ModbusStage::move(std::span<const double> target, std::stop_token stop) {
    require_usable("move");
    if (state_ != State::homed)
        throw DeviceError(link_.device(), "move", "the axes are not homed");
    require_within_limits(axes_, target, {link_.device(), 0, "move"});
    guarded([&] { run_move(target, stop); });
}

void ModbusStage::limit_speed(double share) {
    if (!(share > 0.0 && share <= 1.0))
        throw ConfigError({"stage speed"}, fmt::format("a share of {} is not in (0, 1]", share));
    speed_share_ = share;
}

void ModbusStage::run_move(std::span<const double> target, std::stop_token stop) {
    if (stop.stop_requested())
        throw Interrupted();
    const auto before = poll();
    require_ready(before);
    keep_watchdog(true);
    set_command({});
    write_targets(target);
    set_command({profile_.command.start});
    const auto arrived = [&](const std::vector<AxisStatus>& axes) {
        require_healthy(axes, "move");
        return is_at(axes, target);
    };
    wait_until(arrived, time_limit(before, target), "move", stop);
    set_command({});
}

void ModbusStage::write_targets(std::span<const double> target) {
    const auto& map = profile_.move;
    std::vector<std::uint16_t> registers(axes_.size() * static_cast<std::size_t>(map.stride));
    for (std::size_t i = 0; i < axes_.size(); ++i) {
        const double counts = profile_.counts_per_unit(axes_[i]);
        const int group = static_cast<int>(i) * map.stride;
        append(registers, group + map.target, target[i] * counts);
        append(registers, group + map.speed, speed_share_ * axes_[i].speed * counts);
    }
    write_and_verify(map.address, registers);
    if (read(map.address, static_cast<int>(registers.size())) != registers)
        throw DeviceError(link_.device(), "write the targets", "they read back differently");
}

bool ModbusStage::is_at(const std::vector<AxisStatus>& axes, std::span<const double> target) const {
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const double error = std::abs(axes[i].position - target[i]);
        if (axes[i].moving || !axes[i].in_position || !(error <= profile_.tolerance(axes_[i])))
            return false;
    }
    return true;
}

Duration ModbusStage::time_limit(const std::vector<AxisStatus>& axes,
                                 std::span<const double> target) const {
    double seconds = 0.0;
    for (std::size_t i = 0; i < axes.size(); ++i)
        seconds = std::max(seconds, std::abs(target[i] - axes[i].position) /
                                        (speed_share_ * axes_[i].speed));
    const std::chrono::duration<double> motion(seconds * profile_.limits.move_factor);
    return std::chrono::duration_cast<Duration>(motion) + profile_.limits.move_margin;
}

bool ModbusStage::stop() noexcept {
    try {
        const bool stopped = stop_by(clock_.now() + stop_time);
        link_.set_response_timeout(link_settings_.response_timeout);
        if (!stopped)
            state_ = State::faulted;
        return stopped;
    } catch (const std::exception&) {
        state_ = State::faulted;
        return false;
    }
}

// The existing connection first; after each failure a fresh one, as long as there is time.
bool ModbusStage::stop_by(Instant deadline) {
    for (;;) {
        try {
            return stop_and_confirm(deadline);
        } catch (const DeviceError&) {
            link_.close();
        }
        if (clock_.now() + 4 * poll_period >= deadline)
            return false;
        clock_.wait_for(4 * poll_period, {});
    }
}

// A stop is a level and harmless to repeat, so it is written without reading back.
bool ModbusStage::stop_and_confirm(Instant deadline) {
    limit_requests_to(deadline);
    const std::uint16_t word = command_word({profile_.command.stop});
    write(profile_.command.address, std::span(&word, 1));
    for (int resting = 0; resting < profile_.done.stable_polls;) {
        if (clock_.now() >= deadline)
            return false;
        limit_requests_to(deadline);
        resting = any_moves(poll(1)) ? 0 : resting + 1;
        clock_.wait_for(poll_period, {});
    }
    return true;
}

// A request may have to connect first, so each of the two gets half of what is left.
void ModbusStage::limit_requests_to(Instant deadline) {
    const auto half =
        std::chrono::duration_cast<std::chrono::milliseconds>((deadline - clock_.now()) / 2);
    link_.set_response_timeout(
        std::clamp<std::chrono::milliseconds>(half, 5ms, link_settings_.response_timeout));
}

std::unique_ptr<Stage> open_stage(const StageLink& link, const std::string& profile,
                                  std::vector<Axis> axes, Clock& clock) {
    return std::make_unique<ModbusStage>(link, builtin_stage_profile(profile), std::move(axes),
                                         clock);
}

}  // namespace etalon
