#include <fmt/format.h>

#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "report/html.h"
#include "report/number_text.h"
#include "report/svg_plot.h"
#include "station/history/run_history.h"
#include "station/record/record_json.h"

namespace etalon {
namespace {

std::string number(const std::optional<double>& value, int digits) {
    return significant(value, digits, "-");
}

std::string method_text() {
    return fmt::format(
        "EWMA of Q statistics, weight {}, alarm beyond {:.3f}: one false alarm in {:.0f} runs of a "
        "chart, on average, for independent normal values.",
        drift_weight, drift_limit, runs_per_false_alarm);
}

bool begins_baseline(const QuantityHistory& history, std::size_t i) {
    return i > 0 && history.runs[i].baseline != history.runs[i - 1].baseline;
}

std::string short_hash(const HistoricRun& run) {
    return run.calibration_sha256.substr(0, 12);
}

std::string title_of(const QuantityHistory& history) {
    return fmt::format("{} / {}", history.quantity, history.unit);
}

std::string table_of(std::span<const HistoricRun> runs, const QuantityHistory& history) {
    constexpr const char* columns = "  {:20}  {:>9}  {:>9}  {:14}  {:>6}";
    std::string text = fmt::format("camera {}, station {}, {}\n{}, limit {} {}\n", history.camera,
                                   history.station, history.marker, history.quantity,
                                   number(history.runs.back().quantity.limit, 4), history.unit) +
                       fmt::format(columns, "run", "value", "U", "outcome", "EWMA") + "\n";
    for (std::size_t i = 0; i < history.runs.size(); ++i) {
        const auto& [index, quantity, baseline, chart] = history.runs[i];
        const HistoricRun& run = runs[index];
        if (begins_baseline(history, i))
            text += fmt::format("  -- calibration {}: a new baseline\n", short_hash(run));
        text += fmt::format(columns, run.started_utc, number(quantity.value, 4),
                            number(quantity.expanded_uncertainty, 3), quantity.outcome,
                            fixed(chart.ewma, 2, "-")) +
                (chart.alarm ? "  DRIFT\n" : "  \n");
    }
    return text + "\n";
}

Json run_entry(const HistoricRun& run, const ChartedRun& charted) {
    return {{"started_utc", run.started_utc},
            {"record", run.folder.string()},
            {"calibration_sha256", run.calibration_sha256},
            {"baseline", charted.baseline},
            {"value", or_null(charted.quantity.value)},
            {"expanded_uncertainty", or_null(charted.quantity.expanded_uncertainty)},
            {"limit", or_null(charted.quantity.limit)},
            {"outcome", charted.quantity.outcome},
            {"q", or_null(charted.chart.q)},
            {"ewma", or_null(charted.chart.ewma)},
            {"alarm", charted.chart.alarm}};
}

Json chart_entry(std::span<const HistoricRun> runs, const QuantityHistory& history) {
    return {{"camera", history.camera},
            {"station", history.station},
            {"marker", history.marker},
            {"quantity", history.quantity},
            {"unit", history.unit},
            {"drifts", history.drifts()},
            {"runs", json_list(history.runs, [&](const ChartedRun& charted) {
                 return run_entry(runs[charted.run], charted);
             })}};
}

Json state_entry(const CameraState& state) {
    return {{"camera", state.camera},
            {"station", state.station},
            {"marker", state.marker},
            {"runs", state.runs},
            {"last_utc", state.last_utc},
            {"last_outcome", state.last_outcome},
            {"due", state.due.empty() ? Json() : Json(state.due)},
            {"is_due", state.is_due},
            {"drifts", state.drifts()},
            {"alarms", state.alarms},
            {"trends", json_list(state.trends, [](const QuantityTrend& each) -> Json {
                 return {{"quantity", each.quantity},
                         {"unit", each.unit},
                         {"runs", each.trend.runs},
                         {"probability", each.trend.probability},
                         {"per_year", or_null(each.trend.per_year)},
                         {"judged", each.is_judged},
                         {"trend", each.is_shown}};
             })}};
}

struct Columns {
    Series values, ewma;
    Series new_calibrations;  // the runs that are the first with another calibration
};

Columns columns_of(std::span<const HistoricRun> runs, const QuantityHistory& history) {
    Columns columns;
    for (std::size_t i = 0; i < history.runs.size(); ++i) {
        const ChartedRun& charted = history.runs[i];
        const std::string note =
            fmt::format("{}, {}", runs[charted.run].started_utc, charted.quantity.outcome);
        const double place = static_cast<double>(i + 1), value = *charted.quantity.value;
        const double u = charted.quantity.expanded_uncertainty.value_or(0.0);
        columns.values.add(place, value, value - u, value + u, note);
        if (begins_baseline(history, i))
            columns.new_calibrations.add(
                place, value,
                fmt::format("{}, calibration {}", note, short_hash(runs[charted.run])));
        if (charted.chart.ewma)
            columns.ewma.add(place, *charted.chart.ewma, note);
    }
    return columns;
}

SvgPlot value_plot(const Columns& columns, const QuantityHistory& history) {
    SvgPlot plot("run", title_of(history));
    plot.add_band(columns.values, Color::gray, "U");
    plot.add_curve(columns.values, Color::blue, "value");
    if (!columns.new_calibrations.empty())
        plot.add_points(columns.new_calibrations, Color::orange, "new calibration");
    if (const auto limit = history.runs.back().quantity.limit)
        plot.add_level(*limit, Color::red, "limit");
    return plot;
}

void add_fleet(HtmlPage& page, std::span<const CameraState> fleet) {
    TableRows rows;
    for (const CameraState& state : fleet)
        rows.push_back({state.camera, state.last_outcome, state.station, state.marker,
                        state.last_utc, fmt::format("{}", state.runs),
                        state.due.empty() ? dash : state.due, state.is_due ? "DUE" : "",
                        state.drifts() ? "DRIFT" : ""});
    page.add_heading("Fleet");
    page.add_table(
        {"camera", "outcome", "station", "marker", "last run", "runs", "due", "is due", "drift"},
        rows);
    page.add_notes({trend_method_text()});
}

void add_chart(HtmlPage& page, std::span<const HistoricRun> runs, const QuantityHistory& history) {
    page.add_heading(fmt::format("Camera {}: {}", history.camera, title_of(history)));
    page.add_facts({{"Station", history.station},
                    {"Marker", history.marker},
                    {"Drift alarm", history.drifts() ? "YES" : "no"}});
    const Columns columns = columns_of(runs, history);
    HtmlPage::Figures figures{
        {value_plot(columns, history).svg(),
         "Values, with U as a band. Look for steps and trends, and how near the limit they come."}};
    if (!columns.ewma.empty()) {
        SvgPlot plot("run", "EWMA of Q");
        plot.add_curve(columns.ewma, Color::orange, "EWMA");
        plot.add_level(drift_limit, Color::red, "alarm");
        plot.add_level(-drift_limit, Color::red, "alarm");
        figures.push_back(
            {plot.svg(),
             "How far they have moved from those before. Beyond the lines it is drift."});
    }
    page.add_figures(figures);
    TableRows rows;
    for (const ChartedRun& charted : history.runs) {
        const HistoricRun& run = runs[charted.run];
        const double u = charted.quantity.expanded_uncertainty.value_or(0.0);
        rows.push_back({run.started_utc, charted.quantity.outcome,
                        value_or_below(*charted.quantity.value, u, 4), significant(u, 3),
                        number(charted.chart.ewma, 3), charted.chart.alarm ? "DRIFT" : "",
                        fmt::format("{}", charted.baseline), short_hash(run)});
    }
    page.add_table({"run", "outcome", "value", "U", "EWMA", "alarm", "baseline", "calibration"},
                   rows);
}

}  // namespace

std::string history_text(std::span<const HistoricRun> runs,
                         std::span<const QuantityHistory> charts) {
    std::string text;
    for (const QuantityHistory& history : charts)
        text += table_of(runs, history);
    return text;
}

std::string fleet_json(std::span<const CameraState> fleet) {
    return text_of({{"method", trend_method_text()}, {"cameras", json_list(fleet, state_entry)}}) +
           "\n";
}

std::string history_json(std::span<const HistoricRun> runs, std::span<const QuantityHistory> charts,
                         std::span<const CameraState> fleet) {
    return text_of({{"etalon", "history/1"},
                    {"method", method_text()},
                    {"trend_method", trend_method_text()},
                    {"runs", runs.size()},
                    {"cameras", json_list(fleet, state_entry)},
                    {"charts", json_list(charts,
                                         [&](const QuantityHistory& history) {
                                             return chart_entry(runs, history);
                                         })}}) +
           "\n";
}

void write_history_report(std::span<const HistoricRun> runs,
                          std::span<const QuantityHistory> charts,
                          std::span<const CameraState> fleet, const std::filesystem::path& folder) {
    ReportFolder report(folder, "history");
    HtmlPage page("Cameras over time", counted(runs.size(), "run"));
    std::vector<std::string> drifting;
    for (const QuantityHistory& history : charts)
        if (history.drifts())
            drifting.push_back(fmt::format("Camera {}: {}", history.camera, title_of(history)));
    const std::size_t alarms = drifting.size();
    std::vector<std::string> due;
    for (const CameraState& state : fleet) {
        for (const QuantityTrend& each : state.trends)
            if (each.is_shown)
                drifting.push_back(
                    fmt::format("Camera {}: {} changes by {:+.3g} {} a year ({} runs, p = {:.2g})",
                                state.camera, each.quantity, each.trend.per_year.value_or(0.0),
                                each.unit, each.trend.runs, each.trend.probability));
        if (state.is_due)
            due.push_back(
                fmt::format("Camera {}: {}", state.camera,
                            state.due.empty() ? "it never passed" : "since " + state.due));
    }
    page.add_verdict(
        drifting.empty() ? "NO ALARM" : "DRIFT",
        fmt::format("{} of {} show an alarm.", alarms, counted(charts.size(), "chart")),
        {{"What drifts", drifting}, {"What is due", due}});
    add_fleet(page, fleet);
    int count = 0;
    for (const QuantityHistory& history : charts) {
        add_chart(page, runs, history);
        write_text(report / fmt::format("chart-{}.svg", ++count),
                   value_plot(columns_of(runs, history), history).svg(/*stand_alone=*/true));
    }
    page.add_notes({method_text() + " A new calibration begins a new baseline, of which the first "
                                    "two runs only tell the mean and the spread."});
    write_text(report / "report.html", page.finish());
    write_text(report / "history.json", history_json(runs, charts, fleet));
    report.finish();
}

}  // namespace etalon
