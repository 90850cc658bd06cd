// How often the search for causes names the right one: every kind of error that can be put into a
// simulated run, each at the smallest size that a run detects (1x: 3.29 standard deviations of it,
// more where it has several numbers or is one of many that are tried), at twice and at five times
// that, then pairs of errors at 5x each, then no error. What corners show is simulated as corners
// (a station like the demo's, 70 poses), what pixels show as photographs.
//
//     causes [RUNS]      runs of each, 50 where nothing is said; half an hour
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

#include "tests/compare/match/photographed_run.h"
#include "tests/compare/qualification/injected_errors.h"

namespace etalon {
namespace {

// The corners of a run, and photographs where an error shows in pixels.
struct Truth {
    SimulatedRun run = demo_run();
    std::optional<test::PhotographedTruth> photographed = {};
};

struct Kind {
    std::string name;
    double easily = 0.0, sigmas = 0.0;  // as InjectedKind has them
    std::function<void(Truth&, double size)> inject;
};

Kind pixel_kind(const std::string& name, double easily,
                const std::function<void(test::PhotographedTruth&, double size)>& change) {
    return {name, easily, 3.29, [change](Truth& truth, double size) {
                if (!truth.photographed)
                    truth.photographed.emplace();
                change(*truth.photographed, size);
            }};
}

// A curve as the model has it between black and the tag's white at 0.8 of the scale; corners move
// with their edges, as a camera without a lens section has them: blurred by 0.5 px.
void bend_tone(Truth& truth, double size) {
    if (!truth.photographed)
        truth.photographed.emplace();
    const double bent = size / (0.8 - 0.2 * size);
    Transfer& curve = truth.photographed->camera.sensor->transfer;
    curve.kind = Transfer::Kind::table;
    for (int i = 0; i <= 200; ++i) {
        const double s = i / 200.0;
        curve.table.emplace_back(s, s * (1.0 + bent * (1.0 - s)));
    }
    seen_also(truth.run, [size](const Corners& corners) {
        return edges_moved_inwards(corners, size * 0.5 / std::sqrt(std::numbers::pi));
    });
}

std::vector<Kind> pixel_kinds() {
    using Photographed = test::PhotographedTruth;
    constexpr double white_gray = 0.8 * (255.0 - 9.0);
    return {
        pixel_kind("f-number", 0.3,
                   [](Photographed& truth, double size) {
                       truth.camera.lens->f_number *= std::exp(size);
                   }),
        pixel_kind("focus distance", 2e-4,
                   [](Photographed& truth, double size) {
                       double& focus = truth.camera.lens->focus_distance_mm;
                       focus = 1.0 / (1.0 / focus + size);
                   }),
        pixel_kind("blur", 0.2, [](Photographed& truth, double size) { truth.blur_px2 += size; }),
        {"tone curve", 0.1, 3.29, bend_tone},
        pixel_kind("noise", 0.3,
                   [](Photographed& truth, double size) {
                       truth.camera.sensor->gain_e_per_dn /= std::pow(1.0 + size, 2);
                       truth.camera.sensor->read_noise_e /= 1.0 + size;
                   }),
        pixel_kind("background", 10.0,
                   [](Photographed& truth, double size) { truth.background += size / white_gray; }),
        pixel_kind("black level", 5.0, [](Photographed& truth, double size) {
            truth.camera.sensor->black_dn += size;
        })};
}

std::vector<Kind> every_kind() {
    std::vector<Kind> all;
    for (const InjectedKind& kind : all_kinds())
        all.push_back(
            {kind.name, kind.easily, kind.sigmas,
             [inject = kind.inject](Truth& truth, double size) { inject(truth.run, size); }});
    for (const Kind& kind : pixel_kinds())
        all.push_back(kind);
    return all;
}

Causes causes_of(Truth truth, std::uint64_t seed) {
    truth.run.look_for_causes = true;
    QualificationInput input = input_of(truth.run, seed);
    if (truth.photographed)
        input.pixels = test::photographed(*truth.photographed, seed);
    return qualify(input).causes.value();
}

struct Tally {
    int runs = 0, right = 0, unnamed = 0, names = 0;  // names: of the groups that were right
    std::map<std::string, int> wrong;
};

bool is_among(const Kind& kind, std::span<const std::string> names) {
    return std::ranges::any_of(
        names, [&](const std::string& name) { return name.starts_with(kind.name); });
}

bool is_right(std::span<const Kind> kinds, const Cause& cause) {
    const auto is_in_errors = [&](const Kind& kind) {
        return std::ranges::any_of(
            cause.errors, [&](const CausingError& error) { return is_among(kind, error.names); });
    };
    const auto is_all_of = [&](std::span<const std::string> names) {
        return names.size() == kinds.size() &&
               std::ranges::all_of(kinds, [&](const Kind& kind) { return is_among(kind, names); });
    };
    return cause.errors.size() == kinds.size() && (std::ranges::all_of(kinds, is_in_errors) ||
                                                   std::ranges::any_of(cause.instead, is_all_of));
}

void count(std::span<const Kind> kinds, const Causes& causes, Tally& tally) {
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

Tally tally_of(std::span<const Kind> kinds, const std::vector<double>& sizes, int runs) {
    Truth truth;
    for (std::size_t k = 0; k < kinds.size(); ++k)
        kinds[k].inject(truth, sizes[k]);
    Tally tally;
    std::mutex mutex;
    std::atomic<int> next = 0;
    const auto work = [&] {
        for (int n = next++; n < runs; n = next++) {
            const Causes causes = causes_of(truth, 1000 + static_cast<std::uint64_t>(n));
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
double detectable_size(const Kind& kind) {
    Truth truth;
    kind.inject(truth, kind.easily);
    const Causes causes = causes_of(truth, 999);
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

void print_kind(const Kind& kind, double smallest, int runs) {
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

void print_pair(const Kind& one, double size, const Kind& other, double other_size, int runs) {
    const Kind both[] = {one, other};
    const Tally tally = tally_of(both, {5.0 * size, 5.0 * other_size}, runs);
    fmt::print("| {} and {} | {} | {} |\n", one.name, other.name, share(tally), mistakes(tally));
    std::fflush(stdout);
}

void print_tables(int runs) {
    const std::vector<Kind> kinds = every_kind();
    std::vector<double> smallest;
    fmt::print(
        "| error | 1x | 1x named | 2x named | 5x named | otherwise, at 2x and 5x |\n"
        "|---|---|---|---|---|---|\n");
    for (const Kind& kind : kinds) {
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
