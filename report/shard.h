// A part of a work of many equal units (poses, runs) that several machines do together: every n-th
// unit, so that the parts take the same time.
#pragma once

#include <cstddef>
#include <string>

namespace etalon {

// Part `index` of `count`: the units index - 1, index - 1 + count, ...
struct Shard {
    std::size_t index = 1, count = 1;

    bool is_all() const { return count == 1; }
    bool holds(std::size_t unit) const { return unit % count == index - 1; }
    std::size_t units(std::size_t of) const { return (of + count - index) / count; }
};

// "2/5", of at most a million; "" is all. Throws ConfigError at --shard for anything else.
Shard parse_shard(const std::string& text);

}  // namespace etalon
