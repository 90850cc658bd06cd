// A profile and those that it extends as one mapping. Errors name the value's own file.
#pragma once

#include <algorithm>
#include <set>

#include "stage/profile/profile.h"

namespace etalon {

// Mappings laid over each other, the nearest first, which hides the farther; `key: ~` removes it.
class Layers {
public:
    explicit Layers(std::vector<Value> mappings) : mappings_(std::move(mappings)) {}

    Value at(const std::string& key) const {
        if (auto value = find(key))
            return *value;
        return mappings_.front().at(key);  // throws, or is the removal, which has no use
    }
    std::optional<Value> find(const std::string& key) const {
        const std::vector<Value> values = said(key);
        if (values.empty())
            return std::nullopt;
        std::for_each(values.begin() + 1, values.end(), pass_over);
        return values.front();
    }

    // Mappings that are merged key by key instead of hidden.
    Layers section(const std::string& key) const {
        if (auto found = find_section(key))
            return *found;
        at(key).fail("must be a mapping (key: value)");
    }
    std::optional<Layers> find_section(const std::string& key) const {
        const std::vector<Value> sections = said(key);
        for (const Value& section : sections)
            if (!section.is_mapping())
                section.fail("must be a mapping (key: value)");
        return sections.empty() ? std::nullopt : std::optional(Layers(sections));
    }

    std::set<std::string> keys() const {
        std::set<std::string> all;
        for (const Value& mapping : mappings_)
            for (const std::string& key : mapping.keys())
                if (find(key))
                    all.insert(key);
        return all;
    }  // without removed ones
    Layers with_names() const {
        std::vector<Value> named;
        for (const Value& mapping : mappings_)
            named.push_back(mapping.with_names());
        return Layers(std::move(named));
    }  // the keys are names that the files give

private:
    static bool is_removal(const Value& value) {
        return !value.is_mapping() && !value.is_list() && !value.is_scalar();
    }

    // A hidden value has no effect, but is no unknown one either.
    static void pass_over(const Value& value) {
        if (value.is_mapping()) {
            for (const std::string& key : value.keys())
                pass_over(value.at(key));
        } else if (value.is_list()) {
            for (const Value& item : value.items())
                pass_over(item);
        }
    }

    // What the mappings say of a key, the nearest first, up to one that removes it.
    std::vector<Value> said(const std::string& key) const {
        std::vector<Value> values;
        bool removed = false;
        for (const Value& mapping : mappings_) {
            const auto value = mapping.find(key);
            if (!value)
                continue;
            removed = removed || is_removal(*value);
            if (removed)
                pass_over(*value);
            else
                values.push_back(*value);
        }
        return values;
    }

    std::vector<Value> mappings_;  // never empty
};

// The parts of a profile's reader. Each checks what it reads at once, at the value that is wrong.
// poll, position, alarm_code, signals, inputs, target and watchdog; needs max_axes.
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
