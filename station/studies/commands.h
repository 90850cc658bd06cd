// `etalon bench`, `stability` and `study`: station/shell/command.h.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace etalon {

class Command;

struct BenchArguments {
    std::vector<std::string> scenes;  // by name (bench/benchmark_scenes.h); none: all
    std::filesystem::path out;        // folder for bench.csv, table.md, bench.svg, bench.json
    std::optional<int> poses;         // of the cloud: 200, quick 5; 0: no cloud
    std::optional<int> throughput;    // frames: 10000, quick 40; 0: none
    int reference_samples = 0;        // in each of 16 scrambles; 0: the plan's own
    std::filesystem::path against;    // bench.json of another run; none: not compared
    double margin = 0.1;              // by which a ratio may fall
    bool quick = false;               // few settings and samples: a trial of the command
    bool check = false;               // exit code 1 when a promised figure is missed
    bool json = false;
};
int run_bench(const BenchArguments& arguments);

void declare_bench(Command& program);
void declare_stability(Command& program);
void declare_study(Command& program);

}  // namespace etalon
