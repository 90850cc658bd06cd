#include "core/time/cpu_time.h"

#include <time.h>

#include <fstream>
#include <string>

namespace etalon {
namespace {

double clock_ms(clockid_t clock) {
    timespec t;
    clock_gettime(clock, &t);
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

}  // namespace

double thread_cpu_ms() {
    return clock_ms(CLOCK_THREAD_CPUTIME_ID);
}

double process_cpu_ms() {
    return clock_ms(CLOCK_PROCESS_CPUTIME_ID);
}

double peak_memory_mib() {
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;)
        if (double kib = 0.0; word == "VmHWM:" && status >> kib)
            return kib / 1024.0;
    return 0.0;
}

}  // namespace etalon
