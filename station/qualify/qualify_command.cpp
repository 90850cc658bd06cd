#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <ctime>

#include "core/file/file_writing.h"
#include "core/process/subprocess.h"
#include "core/program/print_stderr.h"
#include "station/qualify/runner.h"
#include "station/record/run_json.h"
#include "station/record/run_record.h"
#include "station/setup/plan.h"
#include "station/setup/station_lock.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

struct QualifyArguments {
    std::filesystem::path station, out;
    std::filesystem::path calibration;  // in place of the one that the station names
    std::filesystem::path resume;       // in place of out: the record to resume
    std::vector<std::string> twin;  // arguments of the etalon-twin to start for the run; or none
    std::string operator_name;      // for the record
    bool homed = false;             // as the operator says: Stage::take_for_homed()
    bool few_poses = false;         // too few for a verdict
    bool json = false;
};
struct ReportArguments {
    std::filesystem::path record;
    bool json = false;
};

void announce(const RecordedRun& recorded, Progress& progress) {
    const QualifyResult& result = recorded.result;
    progress.note(fmt::format("{}: begun {}, {} of {} poses are there", result.station.id,
                              result.started_utc, result.poses.size(), result.plan.poses.size()));
    for (const std::string& dropped : recorded.dropped)
        progress.note("dropped: " + dropped);
}

// What the photographs show, and the most probable cause: a line each.
std::string found_lines(const QualifyResult& result) {
    std::string lines;
    if (!result.analysis)
        return lines;
    if (result.analysis->pixels)
        for (const std::string& finding : result.analysis->pixels->findings)
            lines += "finding " + finding + "\n";
    const Cause* cause = result.analysis->causes ? result.analysis->causes->named() : nullptr;
    if (cause)
        lines += fmt::format("cause {} ({:.0f} %)\n", cause->text(), 100.0 * cause->probability);
    return lines;
}

int print_result(const QualifyResult& result, bool json) {
    const bool has_verdict = result.reason.empty();
    if (!has_verdict)
        print_stderr("etalon: {}\netalon: the record of this run is in {}\n", result.reason,
                     result.folder.string());
    if (json)
        fmt::print("{}", run_json(result));
    else if (has_verdict)
        fmt::print("verdict {}\n{}report {}\n", name(result.outcome), found_lines(result),
                   (result.folder / "report.html").string());
    return exit_code(result.outcome);
}

DeviceOpeners devices(const StationFile& station, const QualifyArguments& arguments, Clock& clock,
                      Progress& progress, const std::stop_token& stop) {
    DeviceOpeners open = station_devices(station, arguments.homed, clock, progress, stop);
    open.operator_name = arguments.operator_name;
    return open;
}

std::string holder(const QualifyArguments& arguments) {
    return stage_holder("a qualification", arguments.operator_name);
}

// The record has its own; what is given beside it must not be ignored.
void require_recorded(const QualifyArguments& arguments, const std::vector<InputFile>& inputs) {
    if (arguments.station.empty() && arguments.calibration.empty())
        return;
    const std::filesystem::path station =
        arguments.station.empty() ? arguments.resume / inputs.front().copy : arguments.station;
    require_same_inputs(inputs, read_station(station, arguments.calibration).inputs);
}

QualifyResult resume(const QualifyArguments& arguments, Clock& clock, Progress& progress,
                     const std::stop_token& stop) {
    const FolderLock lock(arguments.resume);
    const RecordedRun recorded = read_record(arguments.resume, progress, stop);
    announce(recorded, progress);
    const StationFile& station = recorded.result.station;
    require_recorded(arguments, station.inputs);
    const StationLock stage_lock(station.stage, holder(arguments));
    return resume_qualification(recorded, devices(station, arguments, clock, progress, stop), clock,
                                progress, stop);
}

// Said before anything moves.
void require_enough_poses(const StationFile& station) {
    const PlanRequest& plan = station.plan;
    const int training = plan.poses - hold_out_poses(plan),
              hold_out = hold_out_poses(plan) + plan.repeats;
    if (training < min_training_poses || hold_out < min_hold_out_poses)
        throw ConfigError(plan.place,
                          fmt::format("{} training and {} hold-out poses are too few for a "
                                      "verdict, which needs {} and {}: plan more, or measure "
                                      "them all the same with --few-poses",
                                      training, hold_out, min_training_poses, min_hold_out_poses));
}

QualifyResult begin(const QualifyArguments& arguments, Clock& clock, Progress& progress,
                    const std::stop_token& stop) {
    const StationFile station = read_station(arguments.station, arguments.calibration);
    if (!arguments.few_poses)
        require_enough_poses(station);
    const StationLock stage_lock(station.stage, holder(arguments));
    return run_qualification(station, arguments.out,
                             devices(station, arguments, clock, progress, stop), clock, progress,
                             stop);
}

// The simulated devices of a run, which end with it.
std::unique_ptr<Subprocess> started_twin(const std::vector<std::string>& arguments) {
    std::vector<std::string> command = {(program_folder() / "etalon-twin").string()};
    command.insert(command.end(), arguments.begin(), arguments.end());
    SubprocessOptions options;
    options.inherits_stderr = true;
    try {
        return std::make_unique<Subprocess>(command, std::move(options));
    } catch (const std::system_error& error) {
        throw DeviceError("twin", "start",
                          fmt::format("{}: {}; a build without Aravis has no twin", command[0],
                                      error.code().message()));
    }
}

int run_qualify(const QualifyArguments& arguments) {
    // What the command line cannot say by itself.
    for (const auto& [option, value] :
         {std::pair("STATION", &arguments.station), {"--out", &arguments.out}})
        if (arguments.resume.empty() && value->empty())
            throw ConfigError({option}, "is required, unless a run is resumed with --resume DIR");
    std::unique_ptr<Subprocess> twin;
    if (!arguments.twin.empty()) {
        twin = started_twin(arguments.twin);
        std::string ready;  // what it prints when both devices listen
        while (!ready.ends_with('\n') && !twin->has_closed_output())
            ready += twin->read_output(no_time_limit);
        if (ready.empty()) {  // it has said why
            twin->wait_for(no_time_limit);
            return twin->result().exit_code;
        }
        print_stderr("{}", ready);
    }
    std::stop_source stop;
    const StopOnSignals signals(stop);
    SteadyClock clock;
    Progress progress(stderr, isatty(STDERR_FILENO) != 0, clock);
    const auto run = arguments.resume.empty() ? begin : resume;
    return print_result(run(arguments, clock, progress, stop.get_token()), arguments.json);
}

int run_report(const ReportArguments& arguments) {
    std::stop_source stop;
    const StopOnSignals signals(stop);
    StderrProgress progress;
    const FolderLock lock(arguments.record);
    const RecordedRun recorded = read_record(arguments.record, progress, stop.get_token());
    announce(recorded, progress);
    return print_result(analyse_record(recorded, progress, stop.get_token()), arguments.json);
}

struct DemoArguments {
    std::filesystem::path out;
    std::vector<std::string> twin;  // more arguments for etalon-twin
    bool json = false;
};

int run_demo(const DemoArguments& arguments) {
    QualifyArguments run;
    run.station = installed_file("examples/demo/station.yaml");
    run.out = arguments.out;
    if (run.out.empty())
        run.out = fmt::format("etalon-demo-{:%Y%m%d-%H%M%S}", fmt::localtime(std::time(nullptr)));
    run.twin = {installed_file("examples/demo/twin.yaml").string()};
    run.twin.insert(run.twin.end(), arguments.twin.begin(), arguments.twin.end());
    run.json = arguments.json;
    return run_qualify(run);
}

}  // namespace

void declare_qualify(Command& program) {
    auto [command, asked] = program.add(
        run_qualify, "qualify", "qualify a camera on a motorised stage: the main job",
        "Moves the marker through the planned poses, takes photographs, renders the\n"
        "same poses from the camera's calibration and compares. Prints\n"
        "`verdict PASS` (FAIL, INCONCLUSIVE) and `report DIR/report.html`; between\n"
        "them a line `finding ...` for each way in which photographs and renders\n"
        "differ, and `cause ...` where one is more probable than not. DIR is the\n"
        "record: run.json, poses.csv, events.jsonl, frames/, report.html. It must not\n"
        "exist or be empty, and keeps what was measured however the run ends.\n"
        "Ctrl-C stops the axes and ends the run.\n\n"
        "`etalon qualify --resume DIR` goes on with a run that did not come to its\n"
        "end: the poses that DIR has are kept, the rest of the plan is measured. It\n"
        "works from DIR's own copies of station.yaml and calibration; where STATION or\n"
        "--calibration is given too, it must be the same.\n\n"
        "An axis whose controller does not tell whether it is homed must be seen to\n"
        "move when it is homed, or you say that it stands at its zero: --homed.\n\n"
        "Everything that the run needs is said in station.yaml: examples/demo has one\n"
        "with every key explained.\n");
    command.option("STATION", asked->station, "station.yaml: devices, marker, plan, limits");
    const Option out = command.option("--out", asked->out, "folder of the record", "DIR");
    command.option("--resume", asked->resume, "in place of --out: go on with this record", "DIR")
        .excludes(out);
    command
        .option("--twin", asked->twin,
                "start etalon-twin with this file for the\nrun: needs no device", "FILE")
        .one_each();
    command.option("--calibration", asked->calibration, "in place of the one that STATION names",
                   "CAMERA");
    command.option("--operator", asked->operator_name, "who runs it: for the record", "NAME");
    command.flag("--homed", asked->homed, homed_help);
    command.flag("--few-poses", asked->few_poses,
                 "measure too few poses for a verdict all the same");
}

void declare_report(Command& program) {
    auto [command, asked] = program.add(
        run_report, "report", "analyse the record of a run again",
        "From the raw frames, the stage's readings and the copies of station.yaml and\n"
        "calibration in DIR, each checked by its SHA-256: writes run.json, poses.csv,\n"
        "junit.xml, renders and report.html again. The same build writes the same\n"
        "bytes. What this build found in the frames before it takes from pixels.jsonl;\n"
        "delete that file to have it found again. Prints what `etalon qualify` prints,\n"
        "with its exit code.\n");
    command.required("DIR", asked->record, "folder of the record");
}

// `etalon demo`: the main job on a machine without devices, with the files that are installed.

void declare_demo(Command& program) {
    auto [command, asked] = program.add(
        run_demo, "demo", "qualify a simulated camera: needs no device",
        "Starts etalon-twin, a stage (Modbus TCP, port 1502) and a camera (GigE Vision)\n"
        "on 127.0.0.1, runs `etalon qualify` on them, and ends the twin again. Prints\n"
        "what `etalon qualify` prints, with its exit code. Takes a minute and a half.\n\n"
        "The files are examples/demo, installed in PREFIX/share/etalon: copy them to\n"
        "give the simulated camera errors (twin.yaml), and run\n"
        "`etalon qualify station.yaml --twin twin.yaml --out DIR`.\n");
    command.option("--out", asked->out, "folder of the record (default etalon-demo-TIME)", "DIR");
    command.option("TWIN", asked->twin,
                   "arguments for etalon-twin, after `--`: `etalon demo -- --seed 3`", "...");
}

}  // namespace etalon
