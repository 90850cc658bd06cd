#include "mocks/stage_registers.h"

#include <fmt/format.h>

#include <cmath>

#include "stage/modbus_link.h"

namespace etalon {
namespace {

// Whether `address` is one of `count` registers from `first`; then `offset` says which.
bool is_in(int address, int first, std::size_t count, std::size_t& offset) {
    offset = static_cast<std::size_t>(address - first);
    return address >= first && offset < count;
}

}  // namespace

StageRegisters::StageRegisters(SimulatedStage& stage, const StageProfile& profile)
    : stage_(stage),
      profile_(profile),
      move_(static_cast<std::size_t>(profile.max_axes * profile.move.stride)),
      watchdog_written_(stage.clock().now()) {
    if (stage.axes().size() > static_cast<std::size_t>(profile.max_axes))
        throw ConfigError({"simulated stage"}, fmt::format("profile '{}' has at most {} axes",
                                                           profile.name, profile.max_axes));
}

std::uint16_t StageRegisters::status_word(const AxisStatus& axis) const {
    const auto& bits = profile_.status_bits;
    const auto bit = [](bool set, int number) { return set ? 1U << number : 0U; };
    return static_cast<std::uint16_t>(bit(axis.enabled, bits.enabled) |
                                      bit(axis.homed, bits.homed) | bit(axis.moving, bits.moving) |
                                      bit(axis.in_position, bits.in_position) |
                                      bit(axis.alarm != 0, bits.alarm));
}

void StageRegisters::write_poll_group(std::vector<std::uint16_t>& image, const AxisStatus& axis,
                                      std::size_t index) const {
    const auto& map = profile_.poll;
    std::uint16_t* group = &image[index * static_cast<std::size_t>(map.stride)];
    const double counts = axis.position * profile_.counts_per_unit(stage_.axes()[index]);
    const auto [high, low] = registers_from_int32(static_cast<std::int32_t>(std::llround(counts)));
    group[map.status] = status_word(axis);
    group[map.alarm] = static_cast<std::uint16_t>(axis.alarm);
    group[map.position] = high;
    group[map.position + 1] = low;
}

std::vector<std::uint16_t> StageRegisters::poll_image() const {
    std::vector<std::uint16_t> image(
        static_cast<std::size_t>(profile_.max_axes * profile_.poll.stride));
    const std::vector<AxisStatus> axes = stage_.status();
    for (std::size_t i = 0; i < axes.size(); ++i)
        write_poll_group(image, axes[i], i);
    return image;
}

std::optional<std::vector<std::uint16_t>> StageRegisters::read(int address, int count) const {
    const std::vector<std::uint16_t> poll = poll_image();
    std::vector<std::uint16_t> values;
    for (int at = address; at < address + count; ++at) {
        std::size_t offset = 0;
        if (is_in(at, profile_.poll.address, poll.size(), offset))
            values.push_back(poll[offset]);
        else if (is_in(at, profile_.move.address, move_.size(), offset))
            values.push_back(move_[offset]);
        else if (at == profile_.command.address)
            values.push_back(command_);
        else if (profile_.watchdog && at == profile_.watchdog->address)
            values.push_back(watchdog_ms_);
        else
            return std::nullopt;
    }
    return values;
}

bool StageRegisters::write(int address, std::span<const std::uint16_t> values) {
    std::vector<std::uint16_t> move = move_;
    std::optional<std::uint16_t> command, watchdog;
    for (std::size_t i = 0; i < values.size(); ++i) {
        const int at = address + static_cast<int>(i);
        std::size_t offset = 0;
        if (is_in(at, profile_.move.address, move.size(), offset))
            move[offset] = values[i];
        else if (at == profile_.command.address)
            command = values[i];
        else if (profile_.watchdog && at == profile_.watchdog->address)
            watchdog = values[i];
        else
            return false;
    }
    move_ = move;
    if (watchdog) {
        watchdog_ms_ = *watchdog;
        watchdog_written_ = stage_.clock().now();
    }
    if (command)
        obey(*command);
    return true;
}

void StageRegisters::obey(std::uint16_t command) {
    const auto& bits = profile_.command;
    const auto level = [&](int bit) { return (command >> bit & 1) != 0; };
    const auto rises = [&](int bit) { return level(bit) && (command_ >> bit & 1) == 0; };
    const bool homes = rises(bits.home), starts = rises(bits.start), resets = rises(bits.reset);
    command_ = command;
    stage_.enable(level(bits.enable));
    if (level(bits.stop)) {
        stage_.stop();  // and neither homes nor starts
        return;
    }
    if (resets)
        stage_.reset();
    if (homes)
        stage_.home();
    if (starts)
        start();
}

void StageRegisters::start() {
    const auto& map = profile_.move;
    std::vector<double> target, speed;
    for (std::size_t i = 0; i < stage_.axes().size(); ++i) {
        const std::uint16_t* group = &move_[i * static_cast<std::size_t>(map.stride)];
        const double counts = profile_.counts_per_unit(stage_.axes()[i]);
        const auto value = [&](int at) {
            return int32_from_registers(group[at], group[at + 1]) / counts;
        };
        target.push_back(value(map.target));
        speed.push_back(value(map.speed));
    }
    stage_.start(target, speed);
}

void StageRegisters::check_watchdog() {
    if (watchdog_ms_ == 0 || !stage_.is_moving())
        return;
    const Duration silence = stage_.clock().now() - watchdog_written_;
    if (silence > std::chrono::milliseconds(watchdog_ms_))
        stage_.raise_alarm(StageAlarm::watchdog);
}

}  // namespace etalon
