// How long work takes, and memory kept for it, for `etalon bench`. glibc.
#pragma once

#include <functional>

namespace etalon {

// From now on this process keeps the memory that it frees. glibc would hand every image of some MiB
// back to the kernel and have its pages cleared again in the next frame: 1.5 of the published
// method's 6 ms, and none of the default plan's, which holds one image at a time.
void keep_freed_memory();

// Median CPU time of `work` in the calling thread, without what it may give to others: limit TBB to
// one thread. `work` runs once before, then seven times, or for 150 ms if that is more (at most 140
// times); where the first run takes more than a second, it is the only one.
double median_cpu_ms(const std::function<void()>& work);

// The same of two whose ratio is wanted, by turns, so that what slows the machine for a while slows
// both: nine turns of one warm run each, or of 50 ms if that is more.
struct TimesByTurns {
    double one_ms = 0.0, other_ms = 0.0;
    double ratio_error = 0.0;  // relative standard error of their ratio, by the turns' own ratios
};
TimesByTurns cpu_ms_by_turns(const std::function<void()>& one, const std::function<void()>& other);

}  // namespace etalon
