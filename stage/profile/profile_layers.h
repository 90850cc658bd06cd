// A profile and those that it extends as one mapping: internal to stage/profile/. Every error
// names the file that the faulty value stands in.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/config/strict_reader.h"

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
    std::vector<Value> mappings_;  // never empty
};

}  // namespace etalon
