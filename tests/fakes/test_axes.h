// Axes of stages that tests move.
#pragma once

#include "stage/profile/profile.h"

namespace etalon {

// x: 100 mm/s, y: 30 mm/s; with the ramp of 50 ms, 2000 and 600 mm/s^2.
inline std::vector<Axis> two_axes() {
    return {{.name = "x", .low = -70.0, .high = 500.0, .speed = 100.0},
            {.name = "y", .low = -50.0, .high = 70.0, .speed = 30.0}};
}

// x: 10 mm/s, z: 5 mm/s.
inline std::vector<Axis> xz() {
    return {{.name = "x", .low = -100.0, .high = 100.0, .speed = 10.0},
            {.name = "z", .low = -50.0, .high = 200.0, .speed = 5.0}};
}

// Fast, so that they need little time. x: 200 mm/s over 700 mm; rz: 2 rad/s.
inline std::vector<Axis> fast_axes() {
    return {{.name = "x", .low = -7.0, .high = 700.0, .speed = 200.0},
            {.name = "rz", .kind = Axis::Kind::rotary, .low = -1.0, .high = 2.0, .speed = 2.0}};
}

// With what a profile leaves to its axes: 800 pulses per mm and 5 mm per turn; 100 per degree,
// counting backwards, and 90 degrees per turn; a unit each where a unit has one axis.
inline std::vector<Axis> axes_for(const StageProfile& profile,
                                  std::vector<Axis> axes = fast_axes()) {
    if (profile.max_axes == 1) {
        axes[0].unit = 3;
        axes[1].unit = 5;
    }
    if (!profile.counts.per_mm) {
        axes[0].counts_per_unit = 800.0;
        axes[0].lead = 5.0;
        axes[1].counts_per_unit = -100.0 * 180.0 / std::numbers::pi;
        axes[1].lead = 0.5 * std::numbers::pi;
    }
    return axes;
}

}  // namespace etalon
