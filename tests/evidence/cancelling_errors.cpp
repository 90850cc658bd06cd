// How often a run passes though its camera by itself is beyond its limits, because errors of stage
// or marker cancel the camera's in the judged field; and how many passes honest runs lose to the
// conditions that prevent it.
//
//     cancelling_errors [RUNS [SEED]]      2000 and 1 where nothing is said; some minutes
//
// Every pair and triple of one error of the camera with one or two of marker and stage that cancel
// it to less than 0.3 of the limits, at its best; the camera by itself is 1 to 3 times at its
// limits. Honest: everything that the station declares is off as it declares. Prints the table of
// docs/causes.md.
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <cstdlib>
#include <map>
#include <mutex>

#include "tests/compare/qualification/cancelling_errors.h"

namespace etalon {
namespace {

struct Tally {
    int runs = 0, pass = 0, fail = 0, inconclusive = 0, by_field = 0;
    std::map<std::string, int> passed, not_met;
};

void count(const Qualification& result, const std::string& name, Tally& tally) {
    ++tally.runs;
    tally.pass += result.verdict == Outcome::pass;
    tally.fail += result.verdict == Outcome::fail;
    tally.inconclusive += result.verdict == Outcome::inconclusive;
    tally.by_field += passes_by_field_alone(result);
    if (result.verdict == Outcome::pass)
        ++tally.passed[name];
    if (passes_by_field_alone(result))
        for (const AcceptanceCondition& each : result.conditions)
            if (each.state == AcceptanceCondition::State::not_met ||
                each.state == AcceptanceCondition::State::not_checked)
                ++tally.not_met[each.name];
}

void print(const char* what, const Tally& tally) {
    fmt::print("| {} | {} | {} | {} | {} | {} |\n", what, tally.runs, tally.by_field, tally.pass,
               tally.fail, tally.inconclusive);
    for (const auto& [name, times] : tally.not_met)
        fmt::print("  withheld by {}: {}\n", name, times);
    for (const auto& [name, times] : tally.passed)
        if (!name.empty())
            fmt::print("  passed: {} ({})\n", name, times);
}

template <class One>
Tally tally_of(int runs, const One& one) {
    Tally tally;
    std::mutex mutex;
    tbb::parallel_for(0, runs, [&](int n) {
        const auto [result, name] = one(static_cast<std::uint64_t>(n));
        const std::lock_guard lock(mutex);
        count(result, name, tally);
    });
    return tally;
}

void print_tables(int runs, std::uint64_t seed) {
    using Named = std::pair<Qualification, std::string>;
    const KnownRun known;
    const CancellingErrors errors;
    fmt::print(
        "{} sets cancel\n\n| runs | of them | PASS by the field | PASS | FAIL | "
        "INCONCLUSIVE |\n|---|---|---|---|---|---|\n",
        errors.sets().size());
    print("cancelling", tally_of(runs, [&](std::uint64_t n) {
              RandomStream random(seed, 300, n);
              const auto which = static_cast<std::size_t>(
                  random.uniform() * static_cast<double>(errors.sets().size()));
              const CancellingSet& set = errors.sets()[which];
              const double times = 1.0 + 2.0 * random.uniform();
              return Named{known.judged(errors.run(set, times), seed + n),
                           fmt::format("{} at {:.2f}x", errors.name(set), times)};
          }));
    print("honest", tally_of(runs, [&](std::uint64_t n) {
              return Named{known.judged(honest_run(seed + n), seed + n), ""};
          }));
}

}  // namespace
}  // namespace etalon

int main(int argc, char** argv) {
    etalon::print_tables(argc > 1 ? std::max(1, std::atoi(argv[1])) : 2000,
                         argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1);
}
