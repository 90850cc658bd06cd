#include "station/record/boot_time.h"

#include <ctime>
#include <fstream>

namespace etalon {

BootTime boot_time() {
    BootTime now;
    std::ifstream("/proc/sys/kernel/random/boot_id") >> now.boot;
    timespec time{};
    if (clock_gettime(CLOCK_BOOTTIME, &time) != 0)
        return {};
    now.seconds = static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
    return now;
}

std::optional<double> seconds_between(const BootTime& from, const BootTime& to) {
    if (from.boot.empty() || from.boot != to.boot)
        return std::nullopt;
    return to.seconds - from.seconds;
}

}  // namespace etalon
