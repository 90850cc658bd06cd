// YAML, and JSON as its subset, of people and programs that may mean harm: what a text would cost
// is known before a tree of it is built. Aliases are followed, and count as often as they stand.
//
// For core/config/strict_reader.h.
#pragma once

#include <cstddef>
#include <string>

namespace YAML {
class Node;
}

namespace etalon {

inline constexpr std::size_t max_yaml_bytes = 2u << 20;
inline constexpr std::size_t max_yaml_values = 200'000;  // lists, mappings, their keys and scalars
inline constexpr std::size_t max_yaml_depth = 50;        // lists and mappings in each other

// The text's one document. Throws ConfigError with `file` and line when it is no YAML, is larger
// than these limits allow, or holds an alias of what the alias is part of. Two seconds at worst.
YAML::Node parse_yaml(const std::string& text, const std::string& file);

}  // namespace etalon
