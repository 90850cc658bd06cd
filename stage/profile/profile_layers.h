// A profile and those that it extends as one mapping: internal to stage/profile/. Every error
// names the file that the faulty value stands in.
#pragma once

#include <set>

#include "stage/profile/profile.h"

namespace etalon {

// Mappings of several files laid over each other, the nearest first. What a nearer one says hides
// what a farther one says; `key: ~` removes the key.
class Layers {
public:
    explicit Layers(std::vector<Value> mappings) : mappings_(std::move(mappings)) {}

    Value at(const std::string& key) const;
    std::optional<Value> find(const std::string& key) const;

    // Mappings that are merged key by key instead of hidden.
    Layers section(const std::string& key) const;
    std::optional<Layers> find_section(const std::string& key) const;

    std::set<std::string> keys() const;  // without removed ones
    Layers with_names() const;           // the keys are names that the files give

private:
    // What the mappings say of a key, the nearest first, up to one that removes it.
    std::vector<Value> said(const std::string& key) const;

    std::vector<Value> mappings_;  // never empty
};

// The parts of a profile's reader. Each checks what it reads as soon as it can, so that an error
// stands at the value that is wrong. poll, position, alarm_code, signals, inputs, target and
// watchdog; needs max_axes.
void read_profile_registers(const Layers& root, StageProfile& profile);

// sequences; needs the registers.
void read_profile_sequences(const Layers& root, StageProfile& profile);

// The words of YAML, in the order of the enumerations.
inline constexpr const char* signal_words[] = {"enabled", "ready",          "homed",
                                               "moving",  "homing",         "in_position",
                                               "alarm",   "emergency_stop", "limit"};
inline constexpr const char* input_words[] = {"remote", "enable", "home", "start", "stop", "reset"};

// The text of the profiles that CMake builds into the library, by name.
const std::map<std::string, std::string>& builtin_profile_texts();

}  // namespace etalon
