// A stage controller as data: which registers hold what, and the steps that enable, home, move and
// stop its axes. Drives the client (stage/motion/modbus_stage.h) and the twin's controller
// (mocks/stage/stage_registers.h). YAML (`etalon: stage-profile/1`, stage/profiles/); keys:
// docs/stage.md.
//
// One Modbus unit with up to max_axes axes. Addresses are as on the wire (0-based), of the first
// axis.
#pragma once

#include <map>

#include "stage/axes/axes.h"
#include "stage/link/register_numbers.h"
#include "stage/link/stage_link.h"

namespace etalon {

// ---- reading: one poll is one or more blocks, each one request per unit

struct PollBlock {
    RegisterSpace space = RegisterSpace::holding_registers;
    int address = 0;
    int count = 0;   // of one axis
    int stride = 0;  // axis i's members are i * stride further; 0: common to all axes
};

// A number of one axis in a poll block.
struct PolledNumber {
    RegisterSpace space = RegisterSpace::holding_registers;  // or input_registers
    int address = 0;
    NumberType type = NumberType::int32;
};

// What a controller says about each axis.
enum class Signal {
    enabled,         // the motor is on
    ready,           // takes a command for motion
    homed,           // knows its zero
    moving,          // must be available: without it no stop could be confirmed
    homing,          // moving, to find its zero
    in_position,     // rests at its target
    alarm,           // must be available
    emergency_stop,  // pressed
    limit            // a limit switch is reached
};

// One bit of a poll block; of coils and discrete inputs `bit` is 0.
struct SignalBit {
    RegisterSpace space = RegisterSpace::holding_registers;
    int address = 0, bit = 0;
    bool inverted = false;
};

// ---- writing

// What a controller is told, for all axes of its unit at once.
enum class Input {
    remote,  // obey the bus instead of other inputs
    enable,
    home,
    start,
    stop,
    reset  // clear alarms
};

struct InputPoint {
    enum class Act {
        level,  // acts as long as its bit is on
        edge,   // acts when its bit goes from off to on
        code    // acts whenever this code is written to the register
    };
    RegisterSpace space = RegisterSpace::holding_registers;  // or coils
    int address = 0, bit = 0;
    bool inverted = false;  // on is 0
    Act act = Act::level;
    std::uint16_t code = 0;
    bool read_back = true;  // false: write-only, or reads as something else, as codes do
};

// What a motion is told: registers that are written in one request (function 16). Axis i's fields
// follow those of axis i - 1 without a gap.
struct TargetBlock {
    struct Field {
        enum class Is { target, speed, constant };
        Is is = Is::constant;
        NumberType type = NumberType::int32;
        double constant = 0.0;
    };
    int address = 0;
    std::vector<Field> fields;
    bool starts = false;     // writing it starts the motion
    bool read_back = false;  // reads as it was written

    int size() const;  // registers of one axis
};

// ---- sequences

struct Condition {
    Signal signal{};
    bool on = true;
};

struct Step {
    enum class Kind {
        set,        // the input on
        clear,      // the input off
        pulse,      // on and at once off again; a code is written once
        write,      // the target blocks, in their order
        wait,       // until the conditions hold of every axis, as long as `held` demands
        wait_done,  // until the move is done, see StageProfile::Done
        require     // that the conditions hold of every axis now
    };
    Kind kind = Kind::require;
    Input input{};                                 // of set, clear and pulse
    std::vector<Condition> conditions;             // of wait and require
    std::chrono::milliseconds within{0}, held{0};  // of wait
};

struct StageProfile {
    std::string name, about;
    std::vector<std::string> confirmed;    // by the vendor's manual
    std::vector<std::string> unconfirmed;  // from elsewhere
    int max_axes = 0;

    LinkDefaults link;  // what the controller's interface is usually set to

    WordOrder word_order = WordOrder::high_first;

    // counts = offset + sign * counts per unit * position. Without counts per unit here each axis
    // of station.yaml says its own; an axis that does has the last word.
    struct Counts {
        std::optional<double> per_mm, per_deg;
        double sign = 1.0, offset = 0.0;
    } counts;

    // What 1 in a speed register means: `step` counts per second or turns per minute.
    struct Speed {
        enum class Unit { counts_per_s, rpm };
        Unit unit = Unit::counts_per_s;
        double step = 1.0;
    } speed;

    std::vector<PollBlock> poll;
    PolledNumber position;
    std::optional<PolledNumber> alarm_code;
    // On as soon as one of its bits is. A signal that is not here is unavailable: `enabled`,
    // `ready`, `homed` and `in_position` then count as on, the others as off.
    std::map<Signal, std::vector<SignalBit>> signals;
    std::map<Input, InputPoint> inputs;  // those that the controller has
    std::vector<TargetBlock> target;

    struct Sequences {
        std::vector<Step> enable, reset, home, move, stop;
    } sequences;

    // The milliseconds that the controller moves on without hearing from its master; 0: for ever.
    struct Watchdog {
        int address = 0;
        std::chrono::milliseconds timeout{0};
    };
    std::optional<Watchdog> watchdog;  // without one a motion outlives a killed program

    // A move is done when no axis moves, each is within the tolerance, in position (if asked for)
    // and was seen to start (if asked for: moving, out of position, half the way, or a way within
    // the tolerance), in `stable_polls` successive polls and for `settle`.
    struct Done {
        bool in_position = true, start_seen = false;
        double tolerance_mm = 0.0, tolerance_deg = 0.0;
        int stable_polls = 1;
        std::chrono::milliseconds settle{0};
    } done;

    // A move may take distance / speed * move_factor + move_margin.
    struct Limits {
        double move_factor = 1.0;
        std::chrono::milliseconds move_margin{0};
    } limits;

    std::map<int, std::string> alarms;  // the maker's words for alarm codes, as far as known

    // mm or rad, mm/s or rad/s. Throw ConfigError for an axis without the counts or lead it needs.
    double counts_of(const Axis& axis, double position) const;
    double position_of(const Axis& axis, double counts) const;
    double register_of_speed(const Axis& axis, double speed) const;
    double speed_of_register(const Axis& axis, double number) const;

    double tolerance(const Axis& axis) const;    // mm or rad
    std::string describe_alarm(int code) const;  // "alarm 3 (watchdog expired)"
    bool has(Signal signal) const { return signals.contains(signal); }
};

// Whether this step sets an axis in motion.
bool starts_motion(const StageProfile& profile, const Step& step);

const char* name_of(Signal signal);  // as in YAML: "in_position"
const char* name_of(Input input);

// Throws ConfigError (file, line, key) for anything missing, unknown or contradictory
// (docs/stage.md). `extends` is looked for beside the file, then among the built-in ones.
StageProfile read_stage_profile(const std::filesystem::path& path);
StageProfile stage_profile_from_text(const std::string& text, const std::string& name);

// Built into the library ("generic"). Throws ConfigError when there is none of this name.
StageProfile builtin_stage_profile(const std::string& name);
std::vector<std::string> builtin_stage_profile_names();  // without the bases

// What station.yaml and people may name: a built-in profile, or a file that ends in .yaml.
StageProfile named_stage_profile(const std::string& name);

}  // namespace etalon
