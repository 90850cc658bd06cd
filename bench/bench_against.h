// One run of `etalon bench` held against an older one, from its bench.json: what got slower? Judged
// are ratios to the published method, each measured by turns in its own run, so that the two runs
// may be of different machines and days. CPU times are for reading only.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bench/bench_report.h"

namespace etalon {

// The default on one scene, before and now.
struct SpeedChange {
    std::string scene;
    double cpu_ms_before = 0.0, cpu_ms_now = 0.0;
    std::optional<double> ratio_before, ratio_now;  // nothing where there is nothing to compare with
    // The ratio fell by more than the margin, and by more than three standard errors of both.
    bool is_slower = false;
};

struct BenchBefore {
    std::string machine, compiler;
    struct Scene {
        std::string name;
        double cpu_ms = 0.0;
        std::optional<double> ratio;
        double ratio_error = 0.0;
    };
    std::vector<Scene> scenes;
};

// Throws ConfigError with file, line and key for what is no bench.json of this version.
BenchBefore read_bench(const std::filesystem::path& path);

// Of the scenes that both have, in the order of `now`. `margin`: 0.1 lets a ratio fall by a tenth.
std::vector<SpeedChange> speed_changes(const BenchBefore& before, const BenchResult& now,
                                       double margin);

// For a terminal of 80 columns.
std::string against_text(const BenchBefore& before, const std::vector<SpeedChange>& changes);

}  // namespace etalon
