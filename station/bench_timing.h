// CPU time and memory of this process, for `etalon bench`. Linux.
#pragma once

#include <functional>

namespace etalon {

double thread_cpu_ms();   // of the calling thread
double process_cpu_ms();  // of all threads

// Largest resident memory so far, MiB (VmHWM).
double peak_memory_mib();

// Median CPU time of `work` in the calling thread, without what it may give to others: limit TBB to
// one thread. `work` runs once before, then seven times; where the first run takes more than a
// second, it is the only one.
double median_cpu_ms(const std::function<void()>& work);

}  // namespace etalon
