// What the tests of this room move: x, 10 mm/s, and z, 5 mm/s.
#pragma once

#include "stage/axes/axes.h"

namespace etalon {

inline std::vector<Axis> xz() {
    return {{.name = "x", .low = -100.0, .high = 100.0, .speed = 10.0},
            {.name = "z", .low = -50.0, .high = 200.0, .speed = 5.0}};
}

}  // namespace etalon
