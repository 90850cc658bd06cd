// Camera and pose files with some bytes wrong: what the readers must refuse or can still read.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/random.h"

namespace etalon::test {

struct DamagedFile {
    std::string name, content;  // .yml: a camera; .csv and .json: poses
};

// One of each, a pure function of the seed: bytes changed, dropped, doubled or swapped for words
// that mean trouble (nan, huge numbers, brackets, control characters), or the end cut off; one
// in four is whole.
std::vector<DamagedFile> damaged_files(std::uint64_t seed);

// The text with up to three of these damages.
std::string damaged(std::string text, RandomStream& random);

}  // namespace etalon::test
