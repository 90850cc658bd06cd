// `etalon qualify` on the command line, and what is asked before it (`plan`, `oc`) and after it
// (`report`, `history`).
#include <CLI/CLI.hpp>

#include "station/shell/command_line.h"
#include "station/shell/commands.h"

namespace etalon {
namespace {

void add_qualify_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<QualifyArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_qualify, "qualify",
        "qualify a camera on a motorised stage: the main job",
        "Moves the marker through the planned poses, takes photographs, renders the\n"
        "same poses from the camera's calibration and compares. Prints\n"
        "`verdict PASS` (FAIL, INCONCLUSIVE) and `report DIR/report.html`. DIR is the\n"
        "record: run.json, poses.csv, events.jsonl, frames/, report.html. It must not\n"
        "exist or be empty, and keeps what was measured however the run ends.\n"
        "Ctrl-C stops the axes and ends the run.\n\n"
        "`etalon qualify --resume DIR` goes on with a run that did not come to its\n"
        "end: the poses that DIR has are kept, the rest of the plan is measured. It\n"
        "works from DIR's own copies of station.yaml and calibration; where STATION is\n"
        "given too, it must be the same.\n\n"
        "Everything that the run needs is said in station.yaml: examples/demo has one\n"
        "with every key explained.\n");
    sub->add_option("STATION", arguments->station, "station.yaml: devices, marker, plan, limits")
        ->type_name("");
    CLI::Option* out =
        sub->add_option("--out", arguments->out, "folder of the record")->type_name("DIR");
    sub->add_option("--resume", arguments->resume, "in place of --out: go on with this record")
        ->excludes(out)
        ->type_name("DIR");
}

void add_plan_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<PlanArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_plan, "plan",
        "what a station's plan will see, before anything moves",
        "Renders and detects every pose of the plan, with noise, and simulates 20 runs:\n"
        "run time, the expected U of each judged quantity, the smallest size of each\n"
        "error that is detected, which errors cannot be told apart and which cannot be\n"
        "seen at all. The station file needs camera_mount, the calibration a sensor.\n"
        "Some ten seconds. Explained in docs/operating-characteristic.md.\n");
    sub->add_option("STATION", arguments->station, "station.yaml")->required()->type_name("");
}

void add_oc_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<OcArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_oc, "oc", "operating characteristic: what its PASS means",
        "Simulates thousands of runs with errors of known size put in, and prints how\n"
        "often each judged quantity comes out as PASS and FAIL. 1x is the size whose\n"
        "field just reaches the quantity's limit. About 40 ms of CPU a run; --runs 200\n"
        "for a first look. Explained in docs/operating-characteristic.md.\n\n"
        "Example:\n  etalon oc examples/demo/station.yaml --error \"focal length\"\n");
    sub->add_option("STATION", arguments->station, "station.yaml")->required()->type_name("");
    sub->add_option("--runs", arguments->runs, "of each error and size (default 2000)")
        ->check(within(1, 1000000))
        ->type_name("N");
    sub->add_option("--error", arguments->errors,
                    "an error by its name; may be repeated\n(default: all, one of each group)")
        ->allow_extra_args(false)
        ->type_name("NAME");
    sub->add_option("--out", arguments->out, "folder for the curves (SVG) and the JSON")
        ->type_name("DIR");
}

void add_report_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<ReportArguments>();
    CLI::App* sub =
        add_command(app, run, arguments, run_report, "report", "analyse the record of a run again",
                    "From the raw frames, the stage's readings and the copies of station.yaml and\n"
                    "calibration in DIR, each checked by its SHA-256: writes run.json, poses.csv,\n"
                    "junit.xml, renders and report.html anew. The same build writes the same\n"
                    "bytes. Prints what `etalon qualify` prints, with its exit code.\n");
    sub->add_option("DIR", arguments->record, "folder of the record")->required()->type_name("");
}

void add_history_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<HistoryArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_history, "history", "control chart of a camera over its runs",
        "Reads the run.json of every record and charts each judged quantity of each\n"
        "camera over time: a self-starting EWMA chart, which gives one false alarm in\n"
        "373 runs. A new calibration begins a new baseline. Prints a table, and\n"
        "`drift alarm camera SERIAL QUANTITY` or `no drift alarm`; exit code 1 when a\n"
        "quantity drifts. --out writes report.html, an SVG of each chart and JSON.\n");
    sub->add_option("DIR", arguments->records, "records, or folders that hold records")
        ->required()
        ->type_name("");
    sub->add_option("--out", arguments->out, "folder of the report")->type_name("DIR");
}

}  // namespace

void add_qualify_commands(CLI::App& app, Run& run) {
    add_qualify_command(app, run);
    add_plan_command(app, run);
    add_oc_command(app, run);
    add_report_command(app, run);
    add_history_command(app, run);
}

}  // namespace etalon
