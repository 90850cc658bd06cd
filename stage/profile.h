// A stage controller as data: which registers hold what, how the axes are enabled, homed, moved and
// stopped, and when a move is done. The same profile drives the client (stage/modbus_stage.h) and
// the twin's server, and is read from YAML (`etalon: stage-profile/1`, stage/profiles/).
//
// All registers are 16-bit holding registers, addresses as on the wire; 32-bit values are signed,
// high word first. Reading is not for the inner loop: profiles are read once.
#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "stage/axes.h"

namespace etalon {

struct StageProfile {
    std::string name;
    int max_axes = 0;

    // Counts of positions and targets; of speeds, the same per second.
    double counts_per_mm = 0.0, counts_per_deg = 0.0;

    // Status and position of all axes, read in one request. Axis i's group begins at
    // address + i * stride; the members are offsets in the group.
    struct Poll {
        int address = 0, stride = 0;
        int status = 0, alarm = 0, position = 0;  // 16, 16 and 32 bits
    } poll;

    // Bit numbers of the status register, 0 = least significant.
    struct StatusBits {
        int enabled = 0, homed = 0, moving = 0, in_position = 0, alarm = 0;
    } status_bits;

    // Target and speed of all axes, written in one request.
    struct Move {
        int address = 0, stride = 0;
        int target = 0, speed = 0;  // 32 bits each
    } move;

    // One register for all axes, by bit numbers. enable and stop act as long as they are 1; home,
    // start and reset act when they go from 0 to 1.
    struct Command {
        int address = 0;
        int enable = 0, home = 0, start = 0, stop = 0, reset = 0;
    } command;

    // Holds the milliseconds that the controller will still move without hearing from its master;
    // 0: for ever. Written anew while a move lasts.
    struct Watchdog {
        int address = 0;
        std::chrono::milliseconds timeout{0};
    };
    std::optional<Watchdog> watchdog;

    // A move is done when every axis is in position, none moves, each position is within the
    // tolerance of its target, all that in `stable_polls` successive polls, and `settle` has
    // passed.
    struct Done {
        double tolerance_mm = 0.0, tolerance_deg = 0.0;
        int stable_polls = 1;
        std::chrono::milliseconds settle{0};
    } done;

    // Time limits. A move may take distance / speed * move_factor + move_margin.
    struct Limits {
        std::chrono::milliseconds enable{0}, home{0}, move_margin{0};
        double move_factor = 1.0;
    } limits;

    std::map<int, std::string> alarms;  // the maker's words for alarm codes, as far as known

    double counts_per_unit(const Axis& axis) const;  // counts per mm or per rad
    double tolerance(const Axis& axis) const;        // mm or rad
    std::string describe_alarm(int code) const;      // "alarm 3 (watchdog expired)"
};

// Throws ConfigError (file, line, key) for anything missing, unknown or contradictory: groups that
// overlap or do not fit into one request, bits used twice, registers beyond 65535.
StageProfile read_stage_profile(const std::filesystem::path& path);
StageProfile stage_profile_from_text(const std::string& text, const std::string& name);

// A profile that is built into the library, by its name ("generic"); no file is needed.
// Throws ConfigError when there is none of this name.
StageProfile builtin_stage_profile(const std::string& name);
std::vector<std::string> builtin_stage_profile_names();

}  // namespace etalon
