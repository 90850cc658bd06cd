#include "stage/profile/profile_layers.h"

#include <algorithm>

namespace etalon {
namespace {

bool is_removal(const Value& value) {
    return !value.is_mapping() && !value.is_list() && !value.is_scalar();
}

// A hidden value has no effect, but is no unknown one either.
void pass_over(const Value& value) {
    if (value.is_mapping()) {
        for (const std::string& key : value.keys())
            pass_over(value.at(key));
    } else if (value.is_list()) {
        for (const Value& item : value.items())
            pass_over(item);
    }
}

}  // namespace

std::vector<Value> Layers::said(const std::string& key) const {
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

std::optional<Value> Layers::find(const std::string& key) const {
    const std::vector<Value> values = said(key);
    if (values.empty())
        return std::nullopt;
    std::for_each(values.begin() + 1, values.end(), pass_over);
    return values.front();
}

Value Layers::at(const std::string& key) const {
    if (auto value = find(key))
        return *value;
    return mappings_.front().at(key);  // throws, or is the removal, which has no use
}

std::optional<Layers> Layers::find_section(const std::string& key) const {
    const std::vector<Value> sections = said(key);
    for (const Value& section : sections)
        if (!section.is_mapping())
            section.fail("must be a mapping (key: value)");
    return sections.empty() ? std::nullopt : std::optional(Layers(sections));
}

Layers Layers::section(const std::string& key) const {
    if (auto found = find_section(key))
        return *found;
    at(key).fail("must be a mapping (key: value)");
}

std::set<std::string> Layers::keys() const {
    std::set<std::string> all;
    for (const Value& mapping : mappings_)
        for (const std::string& key : mapping.keys())
            if (find(key))
                all.insert(key);
    return all;
}

Layers Layers::with_names() const {
    std::vector<Value> named;
    for (const Value& mapping : mappings_)
        named.push_back(mapping.with_names());
    return Layers(std::move(named));
}

}  // namespace etalon
