// The registers of a stage profile in front of a simulated stage: a controller's firmware, by the
// same file that the client reads. No sockets. For one thread.
#pragma once

#include "mocks/stage/simulated_stage.h"
#include "stage/motion/stage_unit.h"

namespace etalon {

class StageRegisters {
public:
    // Of one of the stage's controllers. The stage must outlive this. Throws ConfigError when the
    // controller has more axes than the profile.
    StageRegisters(SimulatedStage& stage, const StageProfile& profile, std::size_t controller = 0)
        : stage_(stage),
          controller_(controller),
          first_axis_(stage.controllers().at(controller).first),
          profile_(profile),
          watchdog_written_(stage.clock().now()) {
        const auto first = stage.axes().begin() + static_cast<std::ptrdiff_t>(first_axis_);
        const std::size_t count = stage.controllers()[controller].count;
        axes_.assign(first, first + static_cast<std::ptrdiff_t>(count));
        if (count > static_cast<std::size_t>(profile.max_axes))
            throw ConfigError({"simulated stage"}, fmt::format("profile '{}' has at most {} axes",
                                                               profile.name, profile.max_axes));
        for (const auto& [input, point] : profile.inputs)
            memory_[{point.space, point.address}] = 0;
        for (const TargetBlock& block : profile.target) {
            for (int i = 0; i < profile.max_axes * block.size(); ++i)
                memory_[{RegisterSpace::holding_registers, block.address + i}] = 0;
        }
        if (profile.watchdog)
            memory_[{RegisterSpace::holding_registers, profile.watchdog->address}] = 0;
        // A motor that only a bit switches off is on from the beginning.
        stage_.enable(!profile.inputs.contains(Input::enable) || is_on(Input::enable), controller);
    }

    // Of coils and discrete inputs 0 or 1. Nothing when one of them does not exist. What is polled
    // of absent axes reads as 0, and so do registers that take codes.
    std::optional<std::vector<std::uint16_t>> read(RegisterSpace space, int address,
                                                   int count) const {
        for (const PollBlock& block : profile_.poll) {
            const int offset = address - block.address;
            const int size = (profile_.max_axes - 1) * block.stride + block.count;
            if (block.space != space || offset < 0 || offset + count > size)
                continue;
            const std::vector<std::uint16_t> image = poll_image(block);
            return std::vector(image.begin() + offset, image.begin() + offset + count);
        }
        std::vector<std::uint16_t> values;
        for (int at = address; at < address + count; ++at) {
            const auto found = memory_.find({space, at});
            if (found == memory_.end())
                return std::nullopt;
            values.push_back(found->second);
        }
        return values;
    }

    // False, and nothing written, when a register does not exist or is read-only. Acts at once.
    bool write(RegisterSpace space, int address, std::span<const std::uint16_t> values) {
        std::vector<Place> written;
        for (std::size_t i = 0; i < values.size(); ++i) {
            written.emplace_back(space, address + static_cast<int>(i));
            if (!memory_.contains(written.back()))
                return false;
        }
        std::map<Input, bool> before;
        for (const auto& entry : profile_.inputs)
            before[entry.first] = is_on(entry.first);
        for (std::size_t i = 0; i < values.size(); ++i)
            memory_[written[i]] = values[i];
        const bool feeds = profile_.watchdog &&
                           std::ranges::count(written, Place{RegisterSpace::holding_registers,
                                                             profile_.watchdog->address}) != 0;
        if (feeds)
            watchdog_written_ = stage_.clock().now();
        obey(before, written);
        for (const auto& [input, point] : profile_.inputs) {
            if (point.act == InputPoint::Act::code)
                memory_[{point.space, point.address}] = 0;
        }
        return true;
    }

    // To be called every few milliseconds: stops the axes, with an alarm, when they move and the
    // watchdog register was not written in time.
    void check_watchdog() {
        if (!profile_.watchdog || !stage_.is_moving(controller_))
            return;
        const std::chrono::milliseconds allowed(
            memory_.at({RegisterSpace::holding_registers, profile_.watchdog->address}));
        const Duration silence = stage_.clock().now() - watchdog_written_;
        if (allowed.count() != 0 && silence > allowed)
            stage_.raise_alarm(StageAlarm::watchdog, controller_);
    }

private:
    // Of a bit that all axes share: states hold of all of them, events of any.
    static bool is_on_together(const std::vector<AxisStatus>& axes, Signal signal) {
        const auto on = [signal](const AxisStatus& axis) { return etalon::is_on(axis, signal); };
        return is_state(signal) ? std::ranges::all_of(axes, on) : std::ranges::any_of(axes, on);
    }

    static bool holds_place(const PollBlock& block, RegisterSpace space, int address) {
        return block.space == space && address >= block.address &&
               address < block.address + block.count;
    }

    static void set_bit(std::uint16_t& word, int bit, bool on) {
        const auto mask = static_cast<std::uint16_t>(1U << bit);
        word = static_cast<std::uint16_t>(on ? word | mask : word & ~mask);
    }

    using Place = std::pair<RegisterSpace, int>;

    std::vector<std::uint16_t> poll_image(const PollBlock& block) const {
        std::vector<std::uint16_t> image(
            static_cast<std::size_t>((profile_.max_axes - 1) * block.stride + block.count));
        const std::vector<AxisStatus> axes = status();
        for (std::size_t i = 0; i < axes.size(); ++i) {
            const double counts = profile_.counts_of(axes_[i], axes[i].position);
            show_number(image, block, profile_.position, i, counts);
            if (profile_.alarm_code)
                show_number(image, block, *profile_.alarm_code, i, axes[i].alarm);
        }
        show_signals(image, block, axes);
        return image;
    }
    void show_number(std::vector<std::uint16_t>& image, const PollBlock& block,
                     const PolledNumber& number, std::size_t axis, double value) const {
        if (!holds_place(block, number.space, number.address))
            return;
        std::vector<std::uint16_t> registers;
        append_number(registers, value, number.type, profile_.word_order);
        const auto at = static_cast<std::size_t>(number.address - block.address) +
                        axis * static_cast<std::size_t>(block.stride);
        std::ranges::copy(registers, image.begin() + static_cast<std::ptrdiff_t>(at));
    }
    void show_signals(std::vector<std::uint16_t>& image, const PollBlock& block,
                      const std::vector<AxisStatus>& axes) const {
        // A signal with several bits shows on the first; the others are off.
        for (const auto& [signal, bits] : profile_.signals) {
            for (std::size_t b = 0; b < bits.size(); ++b) {
                if (!holds_place(block, bits[b].space, bits[b].address))
                    continue;
                for (std::size_t i = 0; i < axes.size(); ++i) {
                    const bool on = b == 0 && (block.stride == 0 ? is_on_together(axes, signal)
                                                                 : etalon::is_on(axes[i], signal));
                    const auto at = static_cast<std::size_t>(bits[b].address - block.address) +
                                    i * static_cast<std::size_t>(block.stride);
                    set_bit(image[at], bits[b].bit, on != bits[b].inverted);
                }
            }
        }
    }

    bool is_on(Input input) const {
        const auto found = profile_.inputs.find(input);
        if (found == profile_.inputs.end() || found->second.act == InputPoint::Act::code)
            return false;
        const InputPoint& point = found->second;
        return ((memory_.at({point.space, point.address}) >> point.bit & 1) != 0) != point.inverted;
    }  // as the memory says; a controller without the input: false
    bool acts(Input input, bool was_on, std::span<const Place> written) const {
        // A level as long as it is on, an edge when it rises, a code when it is written.
        const auto found = profile_.inputs.find(input);
        if (found == profile_.inputs.end())
            return false;
        const InputPoint& point = found->second;
        const Place place{point.space, point.address};
        if (point.act == InputPoint::Act::code)
            return std::ranges::count(written, place) != 0 && memory_.at(place) == point.code;
        return is_on(input) && (point.act == InputPoint::Act::level || !was_on);
    }
    void obey_enable(bool given) {
        const auto enable = profile_.inputs.find(Input::enable);
        if (enable != profile_.inputs.end() && enable->second.act == InputPoint::Act::level)
            stage_.enable(is_on(Input::enable), controller_);
        else if (given)
            stage_.enable(true, controller_);
    }
    void obey(const std::map<Input, bool>& before, std::span<const Place> written) {
        const auto given = [&](Input input) {
            const auto was = before.find(input);
            return acts(input, was != before.end() && was->second, written);
        };
        const bool obeys = !profile_.inputs.contains(Input::remote) || is_on(Input::remote);
        if (obeys)
            obey_enable(given(Input::enable));
        if (given(Input::stop))
            return stage_.stop(controller_);  // and neither homes nor starts
        if (!obeys)
            return;
        if (given(Input::reset))
            stage_.reset(controller_);
        if (given(Input::home))
            stage_.home(controller_);
        if (given(Input::start) || starts_by(written))
            start();
    }
    bool starts_by(std::span<const Place> written) const {
        // Whether a target was written that starts its motion.
        for (const TargetBlock& block : profile_.target) {
            const auto in_block = [&](const Place& place) {
                const int offset = place.second - block.address;
                return place.first == RegisterSpace::holding_registers && offset >= 0 &&
                       offset < profile_.max_axes * block.size();
            };
            if (block.starts && std::ranges::any_of(written, in_block))
                return true;
        }
        return false;
    }
    void start() {
        std::vector<double> target, speed;
        if (decode_target(target, speed))
            stage_.start(target, speed, controller_);
        else
            stage_.raise_alarm(StageAlarm::outside_travel, controller_);
    }
    bool decode_target(std::vector<double>& target, std::vector<double>& speed) const {
        // False when a constant is not as the profile says: the motion would be of another kind.
        using Is = TargetBlock::Field::Is;
        for (const TargetBlock& block : profile_.target) {
            int address = block.address;
            for (const Axis& axis : axes_) {
                for (const TargetBlock::Field& field : block.fields) {
                    std::vector<std::uint16_t> registers;
                    for (int i = 0; i < registers_of(field.type); ++i)
                        registers.push_back(
                            memory_.at({RegisterSpace::holding_registers, address++}));
                    const double number =
                        number_from_registers(registers, field.type, profile_.word_order);
                    if (field.is == Is::target)
                        target.push_back(profile_.position_of(axis, number));
                    else if (field.is == Is::speed)
                        speed.push_back(profile_.speed_of_register(axis, number));
                    else if (std::abs(number - field.constant) > 1e-6 * std::abs(field.constant))
                        return false;
                }
            }
        }
        return true;
    }

    std::vector<AxisStatus> status() const {
        const std::vector<AxisStatus> all = stage_.status();
        const auto first = all.begin() + static_cast<std::ptrdiff_t>(first_axis_);
        return {first, first + static_cast<std::ptrdiff_t>(axes_.size())};
    }  // of its axes

    SimulatedStage& stage_;
    std::size_t controller_;
    std::vector<Axis> axes_;
    std::size_t first_axis_;  // of the stage's
    StageProfile profile_;
    std::map<Place, std::uint16_t> memory_;  // everything that can be written
    Instant watchdog_written_;
};

}  // namespace etalon
