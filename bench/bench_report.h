// What `etalon bench` says: tables, plot, the Pareto front in words, the promised figures.
#pragma once

#include "bench/bench_methods.h"

namespace etalon {

struct BenchResult {
    std::vector<BenchScene> scenes;
    std::optional<BenchScene> cloud;
    std::optional<Throughput> throughput;       // at study_poses(): what is promised
    std::optional<Throughput> wide_throughput;  // at volume_poses(), focus included
};

// A promised figure, as measured.
struct BenchCheck {
    std::string what;    // "webcam-500: time ratio to published n256"
    std::string figure;  // "17.3, at least 15"
    bool reached = false;
};
std::vector<BenchCheck> bench_checks(const BenchResult& result);

// One row a measurement; the table of docs/performance.md; per scene RMS against CPU time, log-log.
std::string bench_csv(const BenchResult& result);
std::string bench_markdown(const BenchResult& result);
std::string bench_plot(const std::vector<BenchScene>& scenes);
// With the machine, the compiler and its flags. bench/bench_report.h reads it back.
std::string bench_json(const BenchResult& result);

// For a terminal of 80 columns: everything but the checks.
std::string bench_text(const BenchResult& result);

// Which settings nothing else beats in both time and error; and whether `default` is among them.
// Errors below the reference's standard error count as equal: nobody can tell them apart.
std::string pareto_words(const BenchScene& scene);

// One run of `etalon bench` held against an older one, from its bench.json: what got slower? Judged
// are ratios to the published method, each measured by turns in its own run, so that the two runs
// may be of different machines and days. CPU times are for reading only.

struct SpeedChange {
    BenchScene before, now;
    // The ratio fell by more than the margin, and by more than three standard errors of both.
    bool is_slower = false;
};

struct BenchBefore {
    std::string machine, compiler;
    std::vector<BenchScene> scenes;  // with the rows whose ratio is judged
};

// Throws ConfigError with file, line and key for what is no bench.json of this version.
BenchBefore read_bench(const std::filesystem::path& path);

// Of the scenes that both have, in the order of `now`. `margin`: 0.1 lets a ratio fall by a tenth.
std::vector<SpeedChange> speed_changes(const BenchBefore& before, const BenchResult& now,
                                       double margin);

// For a terminal of 80 columns.
std::string against_text(const BenchBefore& before, const std::vector<SpeedChange>& changes);

}  // namespace etalon
