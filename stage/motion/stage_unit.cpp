#include "stage/motion/stage_unit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace etalon {
namespace {

constexpr int write_attempts = 3;

// In the order of the signals; an alarm is a code.
constexpr bool AxisStatus::*signal_flags[] = {&AxisStatus::enabled,
                                              &AxisStatus::ready,
                                              &AxisStatus::homed,
                                              &AxisStatus::moving,
                                              &AxisStatus::homing,
                                              &AxisStatus::in_position,
                                              nullptr,
                                              &AxisStatus::emergency_stop,
                                              &AxisStatus::limit};

bool means_motion(Input input) {
    return input == Input::home || input == Input::start;
}

std::uint16_t with_bit(std::uint16_t word, const InputPoint& point, bool on) {
    const auto mask = static_cast<std::uint16_t>(1U << point.bit);
    return static_cast<std::uint16_t>(on != point.inverted ? word | mask : word & ~mask);
}

bool is_given(std::uint16_t word, const InputPoint& point) {
    return ((word >> point.bit & 1) != 0) != point.inverted;
}

const TargetBlock::Field& field_of(const StageProfile& profile, TargetBlock::Field::Is is) {
    for (const TargetBlock& block : profile.target) {
        for (const TargetBlock::Field& field : block.fields) {
            if (field.is == is)
                return field;
        }
    }
    throw ConfigError({"stage profile", 0, "target"}, "has no target or no speed");
}

bool is_counted(const TargetBlock::Field& field) {
    return field.type != NumberType::float32;
}

// Counts that are off by the last digits of a conversion count as whole.
constexpr double count_noise = 1e-6;

// In whole counts, and none of them beyond a soft limit.
double target_number(const StageProfile& profile, const TargetBlock::Field& field, const Axis& axis,
                     double target) {
    const double counts = profile.counts_of(axis, target);
    if (!is_counted(field))
        return counts;
    const auto [low, high] =
        std::minmax({profile.counts_of(axis, axis.low), profile.counts_of(axis, axis.high)});
    return std::max(std::ceil(low - count_noise),
                    std::min(std::floor(high + count_noise), std::round(counts)));
}

double speed_number(const StageProfile& profile, const TargetBlock::Field& field, const Axis& axis,
                    double share) {
    const double number = profile.register_of_speed(axis, share * axis.speed);
    return is_counted(field) ? std::floor(number * (1.0 + 1e-12)) : number;
}

[[noreturn]] void refuse(const Axis& axis, const std::string& message) {
    throw ConfigError({"stage axes", 0, axis.name}, message);
}

void require_speed_fits(const StageProfile& profile, const Axis& axis, double share) {
    const TargetBlock::Field& field = field_of(profile, TargetBlock::Field::Is::speed);
    const double speed = speed_number(profile, field, axis, share);
    const double least = is_counted(field) ? 1.0 : 1e-30, most = range_of(field.type).high;
    if (!(speed >= least && speed <= most))
        refuse(axis, fmt::format("{:.6g} % of its speed is not {} to {} in the speed register",
                                 share * 100.0, is_counted(field) ? "1" : "more than 0", most));
}

// An arrival is told by the counts that are read, and an approach is made in whole ones: the two
// ends of an overrun of two counts are never the same one.
void require_fine_enough(const StageProfile& profile, const Axis& axis) {
    const double count =
        1.0 / std::abs(profile.counts_of(axis, 1.0) - profile.counts_of(axis, 0.0));
    if (count > profile.tolerance(axis) * (1.0 + count_noise))
        refuse(axis, fmt::format("one of its counts, {}, is more than the profile's tolerance, {}: "
                                 "it would never arrive",
                                 as_typed(axis, count), as_typed(axis, profile.tolerance(axis))));
    if (axis.approach != 0 && axis.overrun < 2.0 * count)
        refuse(axis, fmt::format("its overrun before the approach, {}, is less than two of its "
                                 "counts, {}",
                                 as_typed(axis, axis.overrun), as_typed(axis, 2.0 * count)));
}

void require_fits(const StageProfile& profile, const Axis& axis) {
    const TargetBlock::Field& field = field_of(profile, TargetBlock::Field::Is::target);
    const NumberRange target = range_of(field.type), position = range_of(profile.position.type);
    for (const double limit : {axis.low, axis.high}) {
        const double counts = profile.counts_of(axis, limit);
        if (!(counts >= std::max(target.low, position.low) &&
              counts <= std::min(target.high, position.high)))
            refuse(axis, "its soft limits exceed what the controller's registers count");
    }
    if (is_counted(field))
        require_fine_enough(profile, axis);
    require_speed_fits(profile, axis, 1.0);
}

}  // namespace

StageUnit::StageUnit(ModbusLink& link, const StageProfile& profile, int unit,
                     std::vector<Axis> axes)
    : link_(link), profile_(profile), unit_(unit), axes_(std::move(axes)) {
    if (axes_.empty() || axes_.size() > static_cast<std::size_t>(profile.max_axes))
        throw ConfigError({"stage axes"},
                          fmt::format("profile '{}' drives 1 to {} axes, not {}", profile.name,
                                      profile.max_axes, axes_.size()));
    for (const Axis& axis : axes_)
        require_fits(profile, axis);
    for (const auto& [input, point] : profile.inputs) {
        if (point.act == InputPoint::Act::code)
            continue;
        Word& word = words_[{point.space, point.address}];
        word.reads_back = word.reads_back && point.read_back;
    }
}

// ---- reading

std::vector<AxisStatus> StageUnit::poll(int attempts) {
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

AxisStatus StageUnit::decode(const Blocks& blocks, std::size_t axis) const {
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

// The profile's reader made sure that a block holds it.
std::uint16_t StageUnit::polled(const Blocks& blocks, RegisterSpace space, int address,
                                std::size_t axis) const {
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        const PollBlock& block = profile_.poll[b];
        const int offset = address - block.address;
        if (block.space == space && offset >= 0 && offset < block.count)
            return blocks[b].at(static_cast<std::size_t>(offset) +
                                axis * static_cast<std::size_t>(block.stride));
    }
    throw ConfigError({"stage profile", 0, "poll"}, fmt::format("does not hold {}", address));
}

double StageUnit::polled_number(const Blocks& blocks, const PolledNumber& number,
                                std::size_t axis) const {
    std::vector<std::uint16_t> registers;
    for (int i = 0; i < registers_of(number.type); ++i)
        registers.push_back(polled(blocks, number.space, number.address + i, axis));
    return number_from_registers(registers, number.type, profile_.word_order);
}

bool StageUnit::polled_signal(const Blocks& blocks, Signal signal, std::size_t axis) const {
    const auto bits = profile_.signals.find(signal);
    if (bits == profile_.signals.end())
        return is_state(signal);
    return std::ranges::any_of(bits->second, [&](const SignalBit& bit) {
        const std::uint16_t word = polled(blocks, bit.space, bit.address, axis);
        return ((word >> bit.bit & 1) != 0) != bit.inverted;
    });
}

// ---- writing

std::vector<std::uint16_t> StageUnit::read(Place place, int count) {
    return link_.read(unit_, place.first, place.second, count);
}

void StageUnit::read_inputs() {
    for (auto& [place, word] : words_) {
        if (!word.reads_back || word.certain)
            continue;
        word.value = read(place, 1).front();
        word.certain = word.known = true;
    }
}

// With one attempt, for stopping.
void StageUnit::get_to_know(Place place, Word& word) {
    if (word.known || !word.reads_back)
        return;
    try {
        word.value = link_.read(unit_, place.first, place.second, 1, 1).front();
        word.known = true;
    } catch (const DeviceError&) {
        for (const auto& [input, point] : profile_.inputs) {
            const bool is_here =
                point.act == InputPoint::Act::level && Place{point.space, point.address} == place;
            if (is_here && (input == Input::enable || input == Input::remote))
                word.value = with_bit(word.value, point, true);
        }
    }
}

bool StageUnit::is_on(Input input) const {
    const InputPoint& point = profile_.inputs.at(input);
    const auto found = words_.find({point.space, point.address});
    return point.act != InputPoint::Act::code && found != words_.end() && found->second.certain &&
           is_given(found->second.value, point);
}

std::string StageUnit::changed_by_others() {
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

// Where the reply is missing: reads back before anything is written again.
void StageUnit::write_verified(Place place, std::span<const std::uint16_t> values, bool reads_back,
                               bool repeatable) {
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

void StageUnit::write_level(Input input, bool on) {
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

void StageUnit::set(Input input, bool on) {
    const InputPoint& point = profile_.inputs.at(input);
    const Word& word = words_.at({point.space, point.address});
    const bool known_off = word.certain && !is_given(word.value, point);
    if (on && point.act == InputPoint::Act::edge && !known_off)
        write_level(input, false);
    write_level(input, on);
}

void StageUnit::pulse(Input input) {
    const InputPoint& point = profile_.inputs.at(input);
    if (point.act == InputPoint::Act::code)
        return write_verified({point.space, point.address}, {&point.code, 1}, false,
                              !means_motion(input));
    set(input, true);
    set(input, false);
}

void StageUnit::set_at_once(Input input, bool on) {
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

void StageUnit::write_target(std::span<const double> target, double speed_share) {
    for (const TargetBlock& block : profile_.target)
        write_block(block, target, speed_share);
}

void StageUnit::write_block(const TargetBlock& block, std::span<const double> target,
                            double speed_share) {
    using Is = TargetBlock::Field::Is;
    std::vector<std::uint16_t> registers;
    for (std::size_t i = 0; i < axes_.size(); ++i) {
        for (const TargetBlock::Field& field : block.fields) {
            const double number = field.is == Is::constant ? field.constant
                                  : field.is == Is::target
                                      ? target_number(profile_, field, axes_[i], target[i])
                                      : speed_number(profile_, field, axes_[i], speed_share);
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

void StageUnit::feed_watchdog() {
    const auto ms = static_cast<std::uint16_t>(profile_.watchdog->timeout.count());
    write_verified({RegisterSpace::holding_registers, profile_.watchdog->address}, {&ms, 1}, true,
                   true);
}

void StageUnit::require_speed(double share) const {
    for (const Axis& axis : axes_)
        require_speed_fits(profile_, axis, share);
}

double StageUnit::commanded_speed(const Axis& axis, double speed_share) const {
    const TargetBlock::Field& field = field_of(profile_, TargetBlock::Field::Is::speed);
    return profile_.speed_of_register(axis, speed_number(profile_, field, axis, speed_share));
}

bool is_on(const AxisStatus& axis, Signal signal) {
    const auto flag = signal_flags[static_cast<std::size_t>(signal)];
    return flag ? axis.*flag : axis.alarm != 0;
}

namespace {

std::string words(const Condition& condition, const AxisStatus& axis, const StageProfile& profile) {
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

}  // namespace

std::string disturbance(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                        std::span<const Condition> conditions, const StageProfile& profile) {
    for (const Condition& condition : conditions)
        for (std::size_t i = 0; i < statuses.size(); ++i)
            if (holds(statuses[i], condition))
                return fmt::format("axis {}{}", axes[i].name,
                                   words(condition, statuses[i], profile));
    return "";
}

}  // namespace etalon
