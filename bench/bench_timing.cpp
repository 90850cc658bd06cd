#include "bench/bench_timing.h"

#include <malloc.h>

#include <cmath>
#include <vector>

#include "core/statistics/median.h"
#include "core/time/cpu_time.h"

namespace etalon {
namespace {

// Seven repetitions at least; of short work more, up to so much time, as its first runs are slower.
constexpr std::size_t repetitions = 7;
constexpr double long_enough_ms = 150.0;
constexpr double long_run_ms = 1000.0;

double run_ms(const std::function<void()>& work) {
    const double start = thread_cpu_ms();
    work();
    return thread_cpu_ms() - start;
}

// After a run that only warms the processor's caches: one, or as many as take 50 ms. Their median.
double add_warm_runs(const std::function<void()>& work, std::vector<double>& times) {
    constexpr double long_enough_ms = 50.0;
    run_ms(work);
    std::vector<double> of_turn;
    double sum = 0.0;
    while (sum < long_enough_ms) {
        of_turn.push_back(run_ms(work));
        sum += of_turn.back();
    }
    times.insert(times.end(), of_turn.begin(), of_turn.end());
    return median(of_turn);
}

}  // namespace

void keep_freed_memory() {
    mallopt(M_MMAP_THRESHOLD, 32 << 20);  // the largest that glibc takes
    mallopt(M_TRIM_THRESHOLD, 1 << 30);
}

double median_cpu_ms(const std::function<void()>& work) {
    const double first = run_ms(work);
    if (first > long_run_ms)
        return first;
    std::vector<double> times;
    double sum = 0.0;
    while (times.size() < repetitions ||
           (sum < long_enough_ms && times.size() < 20 * repetitions)) {
        times.push_back(run_ms(work));
        sum += times.back();
    }
    return median(times);
}

TimesByTurns cpu_ms_by_turns(const std::function<void()>& one, const std::function<void()>& other) {
    constexpr int turns = 9;
    std::vector<double> ones, others;
    double sum = 0.0, squares = 0.0;
    for (int turn = 0; turn < turns; ++turn) {
        const double one_ms = add_warm_runs(one, ones);
        const double log_ratio = std::log(add_warm_runs(other, others) / one_ms);
        sum += log_ratio;
        squares += log_ratio * log_ratio;
    }
    const double variance = std::max(0.0, squares - sum * sum / turns) / (turns - 1);
    return {median(ones), median(others), std::sqrt(variance / turns)};
}

}  // namespace etalon
