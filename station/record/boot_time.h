// Time across programs. The monotonic clock ends with a program's machine and stands still while
// that is suspended, and the system's clock may be set: how long the machine has been on does
// neither.
#pragma once

#include <optional>
#include <string>

namespace etalon {

struct BootTime {
    std::string boot;      // since which start of the machine; empty: not known
    double seconds = 0.0;  // that it was on, suspended or not
};

BootTime boot_time();  // now

// Nothing where the machine was started anew between the two, or that is not known.
std::optional<double> seconds_between(const BootTime& from, const BootTime& to);

}  // namespace etalon
