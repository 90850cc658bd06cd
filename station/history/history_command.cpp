#include <fmt/format.h>

#include "station/history/run_history.h"
#include "station/shell/commands.h"

namespace etalon {
namespace {

constexpr int drift_found = 1;

void print_alarms(std::span<const QuantityHistory> charts) {
    bool any = false;
    for (const QuantityHistory& history : charts)
        if (history.drifts()) {
            fmt::print("drift alarm camera {} {}\n", history.camera, history.quantity);
            any = true;
        }
    if (!any)
        fmt::print("no drift alarm\n");
}

}  // namespace

int run_history(const HistoryArguments& arguments) {
    const std::vector<HistoricRun> runs = read_history(arguments.records);
    const std::vector<QuantityHistory> charts = chart_history(runs);
    if (!arguments.out.empty())
        write_history_report(runs, charts, arguments.out);
    if (arguments.json) {
        fmt::print("{}", history_json(runs, charts));
    } else {
        fmt::print("{}", history_text(runs, charts));
        print_alarms(charts);
        if (!arguments.out.empty())
            fmt::print("report {}\n", (arguments.out / "report.html").string());
    }
    const bool drifts = std::any_of(charts.begin(), charts.end(),
                                    [](const QuantityHistory& chart) { return chart.drifts(); });
    return drifts ? drift_found : 0;
}

}  // namespace etalon
