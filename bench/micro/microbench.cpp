// Prints a table of the inner loops' speed (items are points or pixels). The whole of it takes some
// 10 s; --benchmark_filter=REGEX picks rows, --benchmark_format=json is for programs.
#include <benchmark/benchmark.h>

#include <string>
#include <vector>

#include "sim/tiles/tile_kernel.h"

int main(int argc, char** argv) {
    // Before the user's options, which therefore win.
    std::string short_run = "--benchmark_min_time=0.1";
    std::vector<char*> arguments(argv, argv + argc);
    arguments.insert(arguments.begin() + 1, short_run.data());
    int count = static_cast<int>(arguments.size());
    benchmark::AddCustomContext("instruction set in use", etalon::tile_kernel_target());
    benchmark::Initialize(&count, arguments.data());
    if (benchmark::ReportUnrecognizedArguments(count, arguments.data()))
        return 2;
    benchmark::RunSpecifiedBenchmarks();
    benchmark::Shutdown();
}
