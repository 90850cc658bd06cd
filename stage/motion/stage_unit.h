// One Modbus unit of a stage and the axes that it drives: a profile's registers as status, inputs
// and targets. Knows how to write safely; when to write what is stage/motion/modbus_stage.h's part.
// One thread.
#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "stage/link/modbus_link.h"
#include "stage/motion/stage.h"
#include "stage/profile/profile.h"

namespace etalon {

inline constexpr int alarm_without_code = -1;

class StageUnit {
public:
    // Throws ConfigError when the axes do not fit the profile: their number, or travel, speed,
    // tolerance and approach in the counts of its registers. The link and the profile must outlive
    // this. Sends nothing.
    StageUnit(ModbusLink& link, const StageProfile& profile, int unit, std::vector<Axis> axes);

    const std::vector<Axis>& axes() const { return axes_; }
    std::string device() const { return link_.device(unit_); }

    // Reads the poll blocks. Throws DeviceError.
    std::vector<AxisStatus> poll(int attempts = 3);

    // Reads what the inputs are set to, so that writing one leaves the others of its register.
    void read_inputs();

    // As last read or written; false when that is not known, and for codes.
    bool is_on(Input input) const;

    // What of the inputs that read back is not as this object left it: another master wrote there.
    // Empty where nothing is.
    std::string changed_by_others();

    // One input on or off; an edge that is on already goes off first. A missing reply is followed
    // by reading back, and only if that shows that nothing was written, by writing again. Throws
    // UncertainWrite where reading back tells nothing: the same input must not be given again then
    // if it means motion. Other inputs are repeated.
    void set(Input input, bool on);
    void pulse(Input input);

    // Writes the target blocks, at this share of each axis' speed, and reads back what can be.
    // Throws UncertainWrite for a block that starts the motion.
    void write_target(std::span<const double> target, double speed_share);

    // One write and no question: for stopping. Edges of the same register go off. Only a register
    // that was never read is read before; where that fails the motors are taken to be on, since an
    // axis whose motor goes off may drop.
    void set_at_once(Input input, bool on);

    void feed_watchdog();

    // What the speed register makes of it: rounded down. mm/s or rad/s.
    double commanded_speed(const Axis& axis, double speed_share) const;

    // Throws ConfigError for an axis that would be slower than its register's smallest step.
    void require_speed(double share) const;

private:
    using Place = std::pair<RegisterSpace, int>;
    struct Word {
        std::uint16_t value = 0;  // as last written or read
        bool certain = false;
        bool known = false;  // was read or written once
        bool reads_back = true;
    };

    // What one poll read of one axis.
    using Blocks = std::vector<std::vector<std::uint16_t>>;
    AxisStatus decode(const Blocks& blocks, std::size_t axis) const;
    std::uint16_t polled(const Blocks& blocks, RegisterSpace space, int address,
                         std::size_t axis) const;
    double polled_number(const Blocks& blocks, const PolledNumber& number, std::size_t axis) const;
    bool polled_signal(const Blocks& blocks, Signal signal, std::size_t axis) const;

    void get_to_know(Place place, Word& word);
    void write_level(Input input, bool on);
    void write_block(const TargetBlock& block, std::span<const double> target, double speed_share);
    void write_verified(Place place, std::span<const std::uint16_t> values, bool reads_back,
                        bool repeatable);
    std::vector<std::uint16_t> read(Place place, int count);

    ModbusLink& link_;
    const StageProfile& profile_;
    int unit_;
    std::vector<Axis> axes_;
    std::map<Place, Word> words_;  // of the inputs that are bits
};

// A profile's signals as the fields of AxisStatus.

bool is_on(const AxisStatus& axis, Signal signal);  // alarm: any code but 0

// What lasts, in contrast to what happens: on where a controller does not say it, and of several
// axes on when it is of all of them.
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

// The first of these conditions that holds of an axis, in words: "axis y is at a limit switch".
// Empty where none does. The profile has the words for alarms' codes.
std::string disturbance(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                        std::span<const Condition> conditions, const StageProfile& profile);

}  // namespace etalon
