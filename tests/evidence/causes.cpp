// How often the search for causes names the right one: every kind of error that can be put into a
// simulated run (corners of a station like the demo's, 70 poses), each at the smallest size that a
// run detects (1x: 3.29 standard deviations of it,
// more where it is one of many that are tried), at twice and at five times that, then pairs of
// errors at 5x each, then no error.
//
//     causes [RUNS]      runs of each, 50 where nothing is said; some minutes
//
// Prints the table of docs/causes.md. Right: the first of the ranked explanations is the injected
// error, by its name or one that the run says it cannot tell from it, and nothing else.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <map>
#include <mutex>
#include <thread>

#include "tests/compare/verdict/injected_errors.h"

namespace etalon {
namespace {

struct Tally {
    int runs = 0, right = 0, unnamed = 0, names = 0;  // names: of the groups that were right
    std::map<std::string, int> wrong;
};

bool is_among(const InjectedKind& kind, const CausingError& error) {
    return std::ranges::any_of(
        error.names, [&](const std::string& name) { return name.starts_with(kind.name); });
}

bool is_right(std::span<const InjectedKind> kinds, const Cause& cause) {
    return cause.errors.size() == kinds.size() &&
           std::ranges::all_of(kinds, [&](const InjectedKind& kind) {
               return std::ranges::any_of(
                   cause.errors, [&](const CausingError& error) { return is_among(kind, error); });
           });
}

void count(std::span<const InjectedKind> kinds, const Causes& causes, Tally& tally) {
    ++tally.runs;
    const Cause* named = causes.named();
    if (!named) {
        ++tally.unnamed;
    } else if (is_right(kinds, *named)) {
        ++tally.right;
        for (const CausingError& error : named->errors)
            tally.names += static_cast<int>(error.names.size());
    } else {
        ++tally.wrong[named->text().substr(0, 60)];
    }
}

Tally tally_of(std::span<const InjectedKind> kinds, const std::vector<double>& sizes, int runs) {
    SimulatedRun run = demo_run();
    for (std::size_t k = 0; k < kinds.size(); ++k)
        kinds[k].inject(run, sizes[k]);
    Tally tally;
    std::mutex mutex;
    std::atomic<int> next = 0;
    const auto work = [&] {
        for (int n = next++; n < runs; n = next++) {
            const Causes causes = causes_of(run, 1000 + static_cast<std::uint64_t>(n));
            const std::lock_guard lock(mutex);
            count(kinds, causes, tally);
        }
    };
    std::vector<std::jthread> workers;
    for (unsigned i = 0; i < std::thread::hardware_concurrency(); ++i)
        workers.emplace_back(work);
    workers.clear();
    return tally;
}

// From the uncertainty that a run states for an error that nobody misses; 0 where it was missed.
double detectable_size(const InjectedKind& kind) {
    SimulatedRun run = demo_run();
    kind.inject(run, kind.easily);
    const Causes causes = causes_of(run, 999);
    const Cause* named = causes.named();
    if (!named || !is_right({&kind, 1}, *named))
        return 0.0;
    return kind.sigmas * 0.5 * named->errors.front().expanded_uncertainty;
}

std::string share(const Tally& tally) {
    return fmt::format("{:.0f} % ({:.1f} names)", 100.0 * tally.right / tally.runs,
                       tally.right ? static_cast<double>(tally.names) / tally.right : 0.0);
}

std::string mistakes(const Tally& tally) {
    std::string all = tally.unnamed ? fmt::format("{} unnamed", tally.unnamed) : "";
    for (const auto& [name, times] : tally.wrong)
        all += fmt::format("{}{} {}", all.empty() ? "" : ", ", times, name);
    return all;
}

void print_kind(const InjectedKind& kind, double smallest, int runs) {
    std::vector<std::string> cells{kind.name, fmt::format("{:.3g}", smallest)};
    std::string wrong;
    for (const double times : {1.0, 2.0, 5.0}) {
        const Tally tally = tally_of({&kind, 1}, {times * smallest}, runs);
        cells.push_back(share(tally));
        if (times > 1.0 && !mistakes(tally).empty())
            wrong +=
                fmt::format("{}{:.0f}x: {}", wrong.empty() ? "" : "; ", times, mistakes(tally));
    }
    cells.push_back(wrong);
    fmt::print("| {} |\n", fmt::join(cells, " | "));
    std::fflush(stdout);
}

void print_pair(const InjectedKind& one, double size, const InjectedKind& other, double other_size,
                int runs) {
    const InjectedKind both[] = {one, other};
    const Tally tally = tally_of(both, {5.0 * size, 5.0 * other_size}, runs);
    fmt::print("| {} and {} | {} | {} |\n", one.name, other.name, share(tally), mistakes(tally));
    std::fflush(stdout);
}

void print_tables(int runs) {
    const std::vector<InjectedKind> kinds = all_kinds();
    std::vector<double> smallest;
    fmt::print(
        "| error | 1x | 1x named | 2x named | 5x named | otherwise, at 2x and 5x |\n"
        "|---|---|---|---|---|---|\n");
    for (const InjectedKind& kind : kinds) {
        smallest.push_back(detectable_size(kind));
        if (smallest.back() > 0.0)
            print_kind(kind, smallest.back(), runs);
        else
            fmt::print("| {} | not named even at {} | | | | |\n", kind.name, kind.easily);
    }
    fmt::print("\n| pair, 5x each | both named | otherwise |\n|---|---|---|\n");
    for (std::size_t i = 0; i + 7 < kinds.size(); i += 3)
        if (smallest[i] > 0.0 && smallest[i + 7] > 0.0)
            print_pair(kinds[i], smallest[i], kinds[i + 7], smallest[i + 7], runs);
    const Tally none = tally_of({}, {}, 10 * runs);
    fmt::print("\nwithout an error: {} of {} runs name none; otherwise: {}\n", none.unnamed,
               none.runs, mistakes(none));
}

}  // namespace
}  // namespace etalon

int main(int argc, char** argv) {
    etalon::print_tables(argc > 1 ? std::max(1, std::atoi(argv[1])) : 50);
}
