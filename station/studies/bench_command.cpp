// `etalon bench`: error against run time, for every method and setting.
#include <fmt/format.h>

#include "bench/bench_report.h"
#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "sim/scene/pose_volume.h"
#include "station/shell/command.h"
#include "station/studies/commands.h"

namespace etalon {
namespace {

constexpr int quick_poses = 5;
constexpr int quick_throughput = 40;
constexpr std::uint64_t throughput_seed = 21;

// All scenes, or those asked for by name; an unknown one is refused before anything is measured.
std::vector<BenchmarkScene> chosen_scenes(const std::vector<std::string>& names) {
    if (names.empty())
        return benchmark_scenes();
    std::vector<BenchmarkScene> scenes;
    for (const std::string& name : names)
        scenes.push_back(benchmark_scene(name));
    return scenes;
}

BenchPlan plan_of(const BenchArguments& arguments) {
    BenchPlan plan = arguments.quick ? quick_plan() : BenchPlan{};
    if (const int samples = arguments.reference_samples; samples > 0) {
        if (samples < 64 || samples > 1 << 24 || (samples & (samples - 1)) != 0)
            throw ConfigError({"--reference-samples"},
                              fmt::format("{} is not a power of two from 64 to 2^24", samples));
        plan.reference_samples = samples;
        plan.cloud_reference_samples = std::max(64, samples / 4);
    }
    return plan;
}

void say(const std::string& words) {
    print_stderr("{}\n", words);
    std::fflush(stderr);
}

// The throughput first: its peak of memory is then its own.
BenchResult measure(const BenchArguments& arguments, const std::vector<BenchmarkScene>& scenes) {
    const BenchPlan plan = plan_of(arguments);
    const BenchmarkScene webcam = benchmark_scene("webcam-500");
    const int frames = arguments.throughput.value_or(arguments.quick ? quick_throughput : 10000);
    const int poses = arguments.poses.value_or(arguments.quick ? quick_poses : 200);
    BenchResult result;
    if (frames > 0) {
        const CellGrid& grid = webcam.scene.markers.front().grid;
        say(fmt::format("throughput: {} frames", frames));
        result.throughput =
            measure_throughput(webcam, study_poses(webcam.camera, grid, frames, throughput_seed));
        say("throughput from near focus to far");
        result.wide_throughput =
            measure_throughput(webcam, volume_poses(webcam.camera, grid, frames, throughput_seed));
    }
    for (const BenchmarkScene& scene : scenes) {
        say(scene.name);
        result.scenes.push_back(measure_scene(scene, plan));
    }
    if (poses > 0)
        result.cloud = measure_cloud(webcam, poses, plan, [&](int done) {
            if (done % 50 == 0 || done == poses)
                say(fmt::format("cloud: {} of {} poses", done, poses));
        });
    return result;
}

void write_files(const std::filesystem::path& folder, const BenchResult& result) {
    write_text(folder / "bench.csv", bench_csv(result));
    write_text(folder / "table.md", bench_markdown(result));
    write_text(folder / "bench.svg", bench_plot(result.scenes));
    write_text(folder / "bench.json", bench_json(result) + "\n");
}

bool print_checks(const std::vector<BenchCheck>& checks, std::FILE* stream) {
    bool all = true;
    std::fputs("\npromised figures:\n", stream);
    for (const BenchCheck& check : checks) {
        std::fputs(
            fmt::format("  {:<4} {}: {}\n", check.reached ? "ok" : "FAIL", check.what, check.figure)
                .c_str(),
            stream);
        all = all && check.reached;
    }
    return all;
}

bool print_against(const BenchBefore& before, const BenchResult& result, double margin,
                   std::FILE* stream) {
    const std::vector<SpeedChange> changes = speed_changes(before, result, margin);
    std::fputs(("\n" + against_text(before, changes)).c_str(), stream);
    if (changes.empty())
        throw ConfigError({"--against"}, "has none of the scenes that were measured");
    return std::ranges::none_of(changes, &SpeedChange::is_slower);
}

}  // namespace

int run_bench(const BenchArguments& arguments) {
    const std::vector<BenchmarkScene> scenes = chosen_scenes(arguments.scenes);
    plan_of(arguments);
    std::optional<BenchBefore> before;
    if (!arguments.against.empty())
        before = read_bench(arguments.against);
    std::error_code ignored;  // said now, not in six minutes
    if (!arguments.out.empty() &&
        std::filesystem::equivalent(arguments.against, arguments.out / "bench.json", ignored))
        throw ConfigError({"--against"}, "is the file of --out, which is written again");
    std::optional<FolderLock> lock;
    if (!arguments.out.empty())
        lock.emplace(claim_folder(arguments.out));
    keep_freed_memory();
    const BenchResult result = measure(arguments, scenes);
    if (!arguments.out.empty())
        write_files(arguments.out, result);
    if (arguments.json)
        std::puts(bench_json(result).c_str());
    else
        std::fputs(bench_text(result).c_str(), stdout);
    std::FILE* const words = arguments.json ? stderr : stdout;
    const bool reached = print_checks(bench_checks(result), words);
    const bool as_fast = !before || print_against(*before, result, arguments.margin, words);
    return (arguments.check && !reached) || !as_fast ? 1 : 0;
}

void declare_bench(Command& program) {
    auto [command, asked] =
        program.add(run_bench, "bench", "measure the renderer: error against run time",
                    "Every method and setting on 15 scenes and a cloud of poses against the\n"
                    "reference integrator, and frames per second beside the published method.\n"
                    "About six minutes on two cores. Explained in docs/performance.md.\n\n"
                    "Example:\n  etalon bench --scene webcam-500 --poses 0 --out bench\n");
    command.option("--scene", asked->scenes, "a scene; may be repeated (default: all)", "NAME");
    command.option("--out", asked->out, "folder for bench.csv, table.md, bench.svg", "DIR");
    command.option("--poses", asked->poses, "poses of the cloud (default 200; 0: none)", "N")
        .whole();
    command
        .option("--throughput", asked->throughput,
                "frames to render in memory (default 10000; 0: none)", "N")
        .whole();
    command
        .option("--reference-samples", asked->reference_samples,
                "in each of 16 scrambles (default 16384)", "N")
        .whole();
    command.flag("--quick", asked->quick, "few settings and samples, to try the command");
    command.option(
        "--against", asked->against,
        "bench.json of another run: exit code 1 when a\nratio to the published method fell",
        "FILE");
    command.option("--margin", asked->margin, "by which a ratio may fall (default 0.1)", "PART")
        .in_range(0.0, 0.9);
    command.flag("--check", asked->check, "exit code 1 when a promised figure is missed");
}

}  // namespace etalon
