#include <fmt/format.h>

#include "core/program/print_stderr.h"
#include "station/history/run_index.h"
#include "station/record/run_record.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

struct HistoryArguments {
    std::vector<std::filesystem::path> records;
    std::filesystem::path index;  // in place of records: the folder whose index is used
    std::filesystem::path out;    // folder of the report; empty: none
    bool json = false;
};

constexpr int drift_found = 1;

void print_alarms(std::span<const QuantityHistory> charts, std::span<const CameraState> fleet) {
    bool any = false;
    for (const CameraState& state : fleet) {
        if (state.is_due)
            fmt::print("due camera {} {}\n", state.camera, state.due.empty() ? "now" : state.due);
        for (const QuantityTrend& each : state.trends)
            if (each.is_shown) {
                fmt::print("trend camera {} {}\n", state.camera, each.quantity);
                any = true;
            }
    }
    for (const QuantityHistory& history : charts)
        if (history.drifts()) {
            fmt::print("drift alarm camera {} {}\n", history.camera, history.quantity);
            any = true;
        }
    if (!any)
        fmt::print("no drift alarm\n");
}

int run_history(const HistoryArguments& arguments) {
    if (arguments.records.empty() && arguments.index.empty())
        throw ConfigError({"DIR"}, "is required, or --index FOLDER");
    std::vector<HistoricRun> runs;
    if (arguments.index.empty()) {
        runs = read_history(arguments.records);
    } else {
        RunIndex index(arguments.index);
        const IndexUpdate update = index.update();
        for (const std::string& refused : update.refused)  // one must not hide a fleet
            print_stderr("etalon: left out: {}\n", refused);
        print_stderr("{} runs in {}, {} re-read\n", update.runs,
                     (arguments.index / run_index_file).string(), update.read);
        runs = index.runs();
    }
    const std::vector<QuantityHistory> charts = chart_history(runs);
    const std::vector<CameraState> fleet = fleet_of(runs, charts, utc_now().substr(0, 10));
    if (!arguments.out.empty())
        write_history_report(runs, charts, fleet, arguments.out);
    if (arguments.json) {
        fmt::print("{}", history_json(runs, charts, fleet));
    } else {
        fmt::print("{}{}", fleet_text(fleet), history_text(runs, charts));
        print_alarms(charts, fleet);
        print_report(arguments.out);
    }
    return std::ranges::any_of(fleet, &CameraState::drifts) ? drift_found : 0;
}

}  // namespace

void declare_history(Command& program) {
    auto [command, asked] =
        program.add(run_history, "history", "control chart of a camera over its runs",
                    "Reads the run.json of every record and charts each judged quantity of each\n"
                    "camera over time: a self-starting EWMA chart, which gives one false alarm in\n"
                    "373 runs. A new calibration begins a new baseline. A trend since then is\n"
                    "tested for at 1 % a camera. Prints the fleet with what is due\n"
                    "(due_after_days in limits.yaml), a table of each chart, and\n"
                    "`drift alarm camera SERIAL QUANTITY`, `trend camera SERIAL QUANTITY` or\n"
                    "`no drift alarm`, and `due camera SERIAL DAY`; exit code 1 when a quantity\n"
                    "drifts. --out writes report.html, an SVG of each chart and JSON.\n");
    const Option records =
        command.option("DIR", asked->records, "records, or folders that hold records");
    command
        .option("--index", asked->index,
                "in place of DIR: the records in this folder, by an index that is kept\n"
                "there, brought up to date and can be deleted at any time",
                "FOLDER")
        .excludes(records);
    command.option("--out", asked->out, "folder of the report", "DIR");
}

}  // namespace etalon
