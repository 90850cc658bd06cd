// `etalon study`: detectors compared on rendered poses; and `etalon study merge`.
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <numeric>

#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "report/json_text.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"
#include "station/studies/commands.h"
#include "station/studies/study_help.txt.h"
#include "study/study_report.h"
#include "study/study_run.h"

namespace etalon {
namespace {

// Needs no device. Exit code 130 when it was interrupted: the same command goes on.
struct StudyArguments {
    std::filesystem::path study, out;
    std::string ablate;  // "tone,noise": variants of the study (study/study_file.h)
    std::string shard;   // "2/5"; empty: all of it
    bool json = false;
};

struct StudyMergeArguments {
    std::vector<std::filesystem::path> shards;
    std::filesystem::path out;
    bool json = false;
};

std::string rate(double part, double whole) {
    return fmt::format("{:.1f} %", whole > 0.0 ? 100.0 * part / whole : 0.0);
}

// CPU time by purpose. Not part of the results: another run takes other times.
std::string times_text(const StudyRun& run, const StudyFile& study) {
    const std::vector<double>& detectors = run.times.detectors;
    const double rest = run.cpu_ms - run.times.render - run.times.sensor -
                        std::accumulate(detectors.begin(), detectors.end(), 0.0) -
                        run.times.estimate;
    std::string text = fmt::format(
        "\n{} poses in {:.1f} s: {:.2f} ms of CPU time a pose, peak memory {:.0f} MiB\n"
        "  rendering {}, sensor {}, corners to poses {}, all else {}\n",
        run.poses, 1e-3 * run.wall_ms, run.cpu_ms / static_cast<double>(run.poses),
        peak_memory_mib(), rate(run.times.render, run.cpu_ms), rate(run.times.sensor, run.cpu_ms),
        rate(run.times.estimate, run.cpu_ms), rate(rest, run.cpu_ms));
    for (std::size_t i = 0; i < study.detectors.size(); ++i)
        text += fmt::format("  {:<22.21} {:>8}  {:.2f} ms a pose\n", study.detectors[i].name,
                            rate(run.times.detectors[i], run.cpu_ms),
                            run.times.detectors[i] / static_cast<double>(run.poses));
    return text;
}

void write_times(const StudyRun& run, const StudyFile& study, const std::filesystem::path& folder) {
    Json detectors = Json::object();
    for (std::size_t i = 0; i < study.detectors.size(); ++i)
        detectors[study.detectors[i].name] = run.times.detectors[i];
    const Json json{{"etalon", "study-times/1"},
                    {"poses", run.poses},
                    {"wall_ms", run.wall_ms},
                    {"cpu_ms", run.cpu_ms},
                    {"render_ms", run.times.render},
                    {"sensor_ms", run.times.sensor},
                    {"estimate_ms", run.times.estimate},
                    {"detectors_ms", detectors}};
    write_text(folder / "times.json", text_of(json) + "\n");
}

void finish(const std::filesystem::path& folder, bool json) {
    const StudyResults results = read_results(folder);
    const StudySummary summary = summarise(results);
    write_study_report(results, summary, folder);
    fmt::print("{}", json ? summary_json(results, summary) : summary_text(results, summary));
}

int run_study_command(const StudyArguments& arguments) {
    // `merge` needs neither, so that the command line cannot require them.
    for (const auto& [name, value] :
         {std::pair("STUDY", arguments.study), {"--out", arguments.out}})
        if (value.empty())
            throw ConfigError({}, std::string(name) + " is required");
    std::stop_source stop;
    const StopOnSignals signals(stop);
    const StudyFile study = read_study(arguments.study);
    const Shard shard = parse_shard(arguments.shard);
    const auto ablations =
        arguments.ablate.empty() ? std::vector<std::string>() : split(arguments.ablate, ',');
    const StudyOptics optics(study, study_variants(study, ablations));
    StudyRecord record(arguments.out, describe(study, arguments.study, optics.variants(), shard));
    StderrProgress progress;
    const StudyRun run = run_study(optics, shard, record, stop.get_token(), progress);
    if (!run.complete) {
        print_stderr("{} of {} poses are done; the same command goes on\n", record.poses_done(),
                     shard.units(static_cast<std::size_t>(study.poses.count)));
        throw Interrupted();
    }
    if (run.poses > 0)
        write_times(run, study, arguments.out);
    if (shard.is_all())
        finish(arguments.out, arguments.json);
    if (!arguments.json && run.poses > 0)
        fmt::print("{}", times_text(run, study));
    if (!arguments.json && shard.is_all())
        print_report(arguments.out);
    else if (!arguments.json)
        fmt::print("shard {}\n", (arguments.out / "results.csv").string());
    return 0;
}

int run_study_merge(const StudyMergeArguments& arguments) {
    merge_shards(arguments.shards, arguments.out);
    const FolderLock lock(arguments.out);
    finish(arguments.out, arguments.json);
    if (!arguments.json)
        print_report(arguments.out);
    return 0;
}

}  // namespace

void declare_study(Command& program) {
    auto [command, asked] = program.add(run_study_command, "study",
                                        "compare detectors on rendered poses", study_help_txt);
    command.option("STUDY", asked->study, "study.yaml: camera, poses, detectors");
    command.option("--out", asked->out, "folder for results and report", "DIR");
    command.option("--ablate", asked->ablate, "also with each of these switched", "NAME,...");
    command.option("--shard", asked->shard, "only part I of N: every N-th pose", "I/N");
    auto [merge, merged] =
        command.add(run_study_merge, "merge", "put the shards of a study together",
                    "All shards, in any order. The result is that of the study in one piece, byte\n"
                    "for byte.\n\n"
                    "Example:\n  etalon study merge part-1 part-2 part-3 --out compared\n");
    merge.required("SHARDS", merged->shards, "folders of `etalon study --shard`");
    merge.required("--out", merged->out, "folder of the whole study", "DIR");
}

}  // namespace etalon
