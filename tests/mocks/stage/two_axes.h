// x: 100 mm/s, y: 30 mm/s; with the ramp of 50 ms, 2000 and 600 mm/s^2.
#pragma once

#include "stage/axes/axes.h"

namespace etalon {

inline std::vector<Axis> two_axes() {
    return {{.name = "x", .low = -70.0, .high = 500.0, .speed = 100.0},
            {.name = "y", .low = -50.0, .high = 70.0, .speed = 30.0}};
}

}  // namespace etalon
