// One Modbus unit of a stage and its axes: a profile's registers as status, inputs and targets, and
// how to write them safely. When: stage/motion/modbus_stage.h. One thread.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "stage/link/modbus_link.h"
#include "stage/motion/stage.h"
#include "stage/profile/profile.h"

namespace etalon {

// In the order of the signals; an alarm is a code.
inline constexpr bool AxisStatus::*signal_flags[] = {&AxisStatus::enabled,
                                                     &AxisStatus::ready,
                                                     &AxisStatus::homed,
                                                     &AxisStatus::moving,
                                                     &AxisStatus::homing,
                                                     &AxisStatus::in_position,
                                                     nullptr,
                                                     &AxisStatus::emergency_stop,
                                                     &AxisStatus::limit};

inline bool is_on(const AxisStatus& axis, Signal signal) {  // alarm: any code but 0
    const auto flag = signal_flags[static_cast<std::size_t>(signal)];
    return flag ? axis.*flag : axis.alarm != 0;
}

// What lasts: on where a controller does not say it; of several axes on when it is of all.
constexpr bool is_state(Signal signal) {
    return signal == Signal::enabled || signal == Signal::ready || signal == Signal::homed ||
           signal == Signal::in_position;
}

inline bool holds(const AxisStatus& axis, const Condition& condition) {
    return is_on(axis, condition.signal) == condition.on;
}

// What disturbs axes, in the order in which it is looked for: of a limit switch or an emergency
// stop many controllers raise the alarm of all their axes, which says less and names the wrong one.
inline constexpr Condition pressed{Signal::emergency_stop}, at_limit{Signal::limit},
    alarmed{Signal::alarm}, disabled{Signal::enabled, false};

inline std::string words_for(const Condition& condition, const AxisStatus& axis,
                             const StageProfile& profile) {
    switch (condition.signal) {
        case Signal::emergency_stop:
            return ": emergency stop";
        case Signal::limit:
            return " is at a limit switch";
        case Signal::alarm:
            return ": " + profile.describe_alarm(axis.alarm);
        case Signal::enabled:
            return " is not enabled any more";
        default:
            return fmt::format(" is {}{}", condition.on ? "" : "not ", name_of(condition.signal));
    }
}

// The first of these conditions that holds of an axis: "axis y is at a limit switch"; else empty.
inline std::string disturbance(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                               std::span<const Condition> conditions, const StageProfile& profile) {
    for (const Condition& condition : conditions)
        for (std::size_t i = 0; i < statuses.size(); ++i)
            if (holds(statuses[i], condition))
                return fmt::format("axis {}{}", axes[i].name,
                                   words_for(condition, statuses[i], profile));
    return "";
}

inline constexpr int alarm_without_code = -1;

class StageUnit {
public:
    // Throws ConfigError when the axes do not fit the profile: number, travel, speed, tolerance or
    // approach in counts. The link and the profile must outlive this. Sends nothing.
    StageUnit(ModbusLink& link, const StageProfile& profile, int unit, std::vector<Axis> axes)
        : link_(link), profile_(profile), unit_(unit), axes_(std::move(axes)) {
        if (axes_.empty() || axes_.size() > static_cast<std::size_t>(profile.max_axes))
            throw ConfigError({"stage axes"},
                              fmt::format("profile '{}' drives 1 to {} axes, not {}", profile.name,
                                          profile.max_axes, axes_.size()));
        for (const Axis& axis : axes_)
            require_fits(axis);
        for (const auto& [input, point] : profile.inputs) {
            if (point.act == InputPoint::Act::code)
                continue;
            Word& word = words_[{point.space, point.address}];
            word.reads_back = word.reads_back && point.read_back;
        }
    }

    const std::vector<Axis>& axes() const { return axes_; }
    std::string device() const { return link_.device(unit_); }

    // Reads the poll blocks. Throws DeviceError.
    std::vector<AxisStatus> poll(int attempts = 3) {
        const int more = static_cast<int>(axes_.size()) - 1;
        Blocks blocks;
        for (const PollBlock& block : profile_.poll)
            blocks.push_back(link_.read(unit_, block.space, block.address,
                                        more * block.stride + block.count, attempts));
        std::vector<AxisStatus> statuses;
        for (std::size_t i = 0; i < axes_.size(); ++i)
            statuses.push_back(decode(blocks, i));
        return statuses;
    }

    // Reads what the inputs are set to, so that writing one leaves the others of its register.
    void read_inputs() {
        for (auto& [place, word] : words_) {
            if (!word.reads_back || word.certain)
                continue;
            word.value = read(place, 1).front();
            word.certain = word.known = true;
        }
    }

    // As last read or written; false when that is not known, and for codes.
    bool is_on(Input input) const {
        const InputPoint& point = profile_.inputs.at(input);
        const auto found = words_.find({point.space, point.address});
        return point.act != InputPoint::Act::code && found != words_.end() &&
               found->second.certain && is_given(found->second.value, point);
    }

    // What another master wrote to inputs that read back; empty for nothing.
    std::string changed_by_others() {
        for (const auto& [place, word] : words_) {
            if (!word.reads_back || !word.certain)
                continue;
            const std::uint16_t now = read(place, 1).front();
            if (now != word.value)
                return fmt::format("command {} {} reads {:#x} and was left at {:#x}",
                                   is_bits(place.first) ? "coil" : "register", place.second, now,
                                   word.value);
        }
        return "";
    }

    // One input on or off; an edge goes off first. After a missing reply it is read back, and only
    // if nothing was written, written again. Throws UncertainWrite where reading back tells
    // nothing: an input that means motion must not be given again then.
    void set(Input input, bool on) {
        const InputPoint& point = profile_.inputs.at(input);
        const Word& word = words_.at({point.space, point.address});
        const bool known_off = word.certain && !is_given(word.value, point);
        if (on && point.act == InputPoint::Act::edge && !known_off)
            write_level(input, false);
        write_level(input, on);
    }
    void pulse(Input input) {
        const InputPoint& point = profile_.inputs.at(input);
        if (point.act == InputPoint::Act::code)
            return write_verified({point.space, point.address}, {&point.code, 1}, false,
                                  !means_motion(input));
        set(input, true);
        set(input, false);
    }

    // Writes the target blocks, at this share of each axis' speed, and reads back what can be.
    // Throws UncertainWrite for a block that starts the motion.
    void write_target(std::span<const double> target, double speed_share) {
        for (const TargetBlock& block : profile_.target)
            write_block(block, target, speed_share);
    }

    // For stopping: one write, edges of the same register off. A register that was never read is
    // read before; where that fails the motors count as on, since an axis may drop without.
    void set_at_once(Input input, bool on) {
        const InputPoint& point = profile_.inputs.at(input);
        const Place place{point.space, point.address};
        if (point.act == InputPoint::Act::code)
            return link_.write(unit_, place.first, place.second, {&point.code, 1});
        Word& word = words_.at(place);
        get_to_know(place, word);
        for (const auto& [other, edge] : profile_.inputs) {
            if (edge.act == InputPoint::Act::edge && Place{edge.space, edge.address} == place)
                word.value = with_bit(word.value, edge, false);
        }
        word.value = with_bit(word.value, point, on);
        word.certain = false;
        link_.write(unit_, place.first, place.second, {&word.value, 1});
        word.certain = true;
    }

    void feed_watchdog() {
        const auto ms = static_cast<std::uint16_t>(profile_.watchdog->timeout.count());
        write_verified({RegisterSpace::holding_registers, profile_.watchdog->address}, {&ms, 1},
                       true, true);
    }

    // What the speed register makes of it: rounded down. mm/s or rad/s.
    double commanded_speed(const Axis& axis, double speed_share) const {
        const TargetBlock::Field& field = field_of(TargetBlock::Field::Is::speed);
        return profile_.speed_of_register(axis, speed_number(field, axis, speed_share));
    }

    // Throws ConfigError for an axis that would be slower than its register's smallest step.
    void require_speed(double share) const {
        for (const Axis& axis : axes_)
            require_speed_fits(axis, share);
    }

private:
    static constexpr int write_attempts = 3;

    static bool means_motion(Input input) { return input == Input::home || input == Input::start; }

    static std::uint16_t with_bit(std::uint16_t word, const InputPoint& point, bool on) {
        const auto mask = static_cast<std::uint16_t>(1U << point.bit);
        return static_cast<std::uint16_t>(on != point.inverted ? word | mask : word & ~mask);
    }

    static bool is_given(std::uint16_t word, const InputPoint& point) {
        return ((word >> point.bit & 1) != 0) != point.inverted;
    }

    const TargetBlock::Field& field_of(TargetBlock::Field::Is is) const {
        for (const TargetBlock& block : profile_.target) {
            for (const TargetBlock::Field& field : block.fields) {
                if (field.is == is)
                    return field;
            }
        }
        throw ConfigError({"stage profile", 0, "target"}, "has no target or no speed");
    }

    static bool is_counted(const TargetBlock::Field& field) {
        return field.type != NumberType::float32;
    }

    // Counts that are off by the last digits of a conversion count as whole.
    static constexpr double count_noise = 1e-6;

    // In whole counts, and none of them beyond a soft limit.
    double target_number(const TargetBlock::Field& field, const Axis& axis, double target) const {
        const double counts = profile_.counts_of(axis, target);
        if (!is_counted(field))
            return counts;
        const auto [low, high] =
            std::minmax({profile_.counts_of(axis, axis.low), profile_.counts_of(axis, axis.high)});
        return std::max(std::ceil(low - count_noise),
                        std::min(std::floor(high + count_noise), std::round(counts)));
    }

    double speed_number(const TargetBlock::Field& field, const Axis& axis, double share) const {
        const double number = profile_.register_of_speed(axis, share * axis.speed);
        return is_counted(field) ? std::floor(number * (1.0 + 1e-12)) : number;
    }

    [[noreturn]] static void refuse(const Axis& axis, const std::string& message) {
        throw ConfigError({"stage axes", 0, axis.name}, message);
    }

    void require_speed_fits(const Axis& axis, double share) const {
        const TargetBlock::Field& field = field_of(TargetBlock::Field::Is::speed);
        const double speed = speed_number(field, axis, share);
        const double least = is_counted(field) ? 1.0 : 1e-30, most = range_of(field.type).high;
        if (!(speed >= least && speed <= most))
            refuse(axis, fmt::format("{:.6g} % of its speed is not {} to {} in the speed register",
                                     share * 100.0, is_counted(field) ? "1" : "more than 0", most));
    }

    // Arrival and approach are told by whole counts: both ends of an overrun must differ.
    void require_fine_enough(const Axis& axis) const {
        const double count =
            1.0 / std::abs(profile_.counts_of(axis, 1.0) - profile_.counts_of(axis, 0.0));
        if (count > profile_.tolerance(axis) * (1.0 + count_noise))
            refuse(axis,
                   fmt::format("one of its counts, {}, is more than the profile's tolerance, {}: "
                               "it would never arrive",
                               as_typed(axis, count), as_typed(axis, profile_.tolerance(axis))));
        if (axis.approach != 0 && axis.overrun < 2.0 * count)
            refuse(axis, fmt::format("its overrun before the approach, {}, is less than two of its "
                                     "counts, {}",
                                     as_typed(axis, axis.overrun), as_typed(axis, 2.0 * count)));
    }

    void require_fits(const Axis& axis) const {
        const TargetBlock::Field& field = field_of(TargetBlock::Field::Is::target);
        const NumberRange target = range_of(field.type),
                          position = range_of(profile_.position.type);
        for (const double limit : {axis.low, axis.high}) {
            const double counts = profile_.counts_of(axis, limit);
            if (!(counts >= std::max(target.low, position.low) &&
                  counts <= std::min(target.high, position.high)))
                refuse(axis, "its soft limits exceed what the controller's registers count");
        }
        if (is_counted(field))
            require_fine_enough(axis);
        require_speed_fits(axis, 1.0);
    }

    using Place = std::pair<RegisterSpace, int>;
    struct Word {
        std::uint16_t value = 0;  // as last written or read
        bool certain = false;
        bool known = false;  // was read or written once
        bool reads_back = true;
    };

    // What one poll read of one axis.
    using Blocks = std::vector<std::vector<std::uint16_t>>;
    AxisStatus decode(const Blocks& blocks, std::size_t axis) const {
        AxisStatus status;
        for (std::size_t i = 0; i < std::size(signal_flags); ++i)
            if (signal_flags[i])
                status.*signal_flags[i] = polled_signal(blocks, static_cast<Signal>(i), axis);
        status.moving = status.moving || status.homing;
        if (polled_signal(blocks, Signal::alarm, axis)) {
            const double code =
                profile_.alarm_code ? polled_number(blocks, *profile_.alarm_code, axis) : 0.0;
            status.alarm = code != 0.0 ? static_cast<int>(code) : alarm_without_code;
        }
        status.position =
            profile_.position_of(axes_[axis], polled_number(blocks, profile_.position, axis));
        if (!std::isfinite(status.position))
            throw DeviceError(device(), "read the position",
                              fmt::format("axis {} reads back no number", axes_[axis].name));
        return status;
    }
    std::uint16_t polled(const Blocks& blocks, RegisterSpace space, int address,
                         std::size_t axis) const {
        // The profile's reader made sure that a block holds it.
        for (std::size_t b = 0; b < blocks.size(); ++b) {
            const PollBlock& block = profile_.poll[b];
            const int offset = address - block.address;
            if (block.space == space && offset >= 0 && offset < block.count)
                return blocks[b].at(static_cast<std::size_t>(offset) +
                                    axis * static_cast<std::size_t>(block.stride));
        }
        throw ConfigError({"stage profile", 0, "poll"}, fmt::format("does not hold {}", address));
    }
    double polled_number(const Blocks& blocks, const PolledNumber& number, std::size_t axis) const {
        std::vector<std::uint16_t> registers;
        for (int i = 0; i < registers_of(number.type); ++i)
            registers.push_back(polled(blocks, number.space, number.address + i, axis));
        return number_from_registers(registers, number.type, profile_.word_order);
    }
    bool polled_signal(const Blocks& blocks, Signal signal, std::size_t axis) const {
        const auto bits = profile_.signals.find(signal);
        if (bits == profile_.signals.end())
            return is_state(signal);
        return std::ranges::any_of(bits->second, [&](const SignalBit& bit) {
            const std::uint16_t word = polled(blocks, bit.space, bit.address, axis);
            return ((word >> bit.bit & 1) != 0) != bit.inverted;
        });
    }

    void get_to_know(Place place, Word& word) {
        // With one attempt, for stopping.
        if (word.known || !word.reads_back)
            return;
        try {
            word.value = link_.read(unit_, place.first, place.second, 1, 1).front();
            word.known = true;
        } catch (const DeviceError&) {
            for (const auto& [input, point] : profile_.inputs) {
                const bool is_here = point.act == InputPoint::Act::level &&
                                     Place{point.space, point.address} == place;
                if (is_here && (input == Input::enable || input == Input::remote))
                    word.value = with_bit(word.value, point, true);
            }
        }
    }
    void write_level(Input input, bool on) {
        const InputPoint& point = profile_.inputs.at(input);
        const Place place{point.space, point.address};
        Word& word = words_.at(place);
        if (!word.certain)
            read_inputs();
        word.value = with_bit(word.value, point, on);
        word.certain = false;
        word.known = true;
        write_verified(place, {&word.value, 1}, word.reads_back, !(on && means_motion(input)));
        word.certain = true;
    }
    void write_block(const TargetBlock& block, std::span<const double> target, double speed_share) {
        using Is = TargetBlock::Field::Is;
        std::vector<std::uint16_t> registers;
        for (std::size_t i = 0; i < axes_.size(); ++i) {
            for (const TargetBlock::Field& field : block.fields) {
                const double number = field.is == Is::constant ? field.constant
                                      : field.is == Is::target
                                          ? target_number(field, axes_[i], target[i])
                                          : speed_number(field, axes_[i], speed_share);
                append_number(registers, number, field.type, profile_.word_order);
            }
        }
        const Place place{RegisterSpace::holding_registers, block.address};
        write_verified(place, registers, block.read_back && !block.starts, !block.starts);
        if (block.starts || !block.read_back)
            return;
        if (read(place, static_cast<int>(registers.size())) != registers)
            throw DeviceError(device(), "write the targets", "they read back differently");
    }
    void write_verified(Place place, std::span<const std::uint16_t> values, bool reads_back,
                        bool repeatable) {
        // Where the reply is missing: reads back before anything is written again.
        for (int attempt = 1;; ++attempt) {
            try {
                return link_.write(unit_, place.first, place.second, values);
            } catch (const UncertainWrite&) {
                if (reads_back &&
                    std::ranges::equal(read(place, static_cast<int>(values.size())), values))
                    return;
                if (attempt == write_attempts || !(reads_back || repeatable))
                    throw;
            }
        }
    }
    std::vector<std::uint16_t> read(Place place, int count) {
        return link_.read(unit_, place.first, place.second, count);
    }

    ModbusLink& link_;
    const StageProfile& profile_;
    int unit_;
    std::vector<Axis> axes_;
    std::map<Place, Word> words_;  // of the inputs that are bits
};

}  // namespace etalon
