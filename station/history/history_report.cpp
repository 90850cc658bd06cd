#include <fmt/format.h>

#include "core/text.h"
#include "report/html.h"
#include "report/svg_plot.h"
#include "station/history/run_history.h"
#include "station/record/record_json.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

std::string number(const std::optional<double>& value, int digits, const char* missing = "-") {
    return value ? fmt::format("{:.{}g}", *value, digits) : missing;
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

// ---- table

std::string heading(const QuantityHistory& history) {
    return fmt::format("camera {}, station {}, {}\n{}, limit {} {}\n", history.camera,
                       history.station, history.marker, history.quantity,
                       number(history.runs.back().quantity.limit, 4), history.unit);
}

std::string row(const HistoricRun& run, const ChartedRun& charted) {
    return fmt::format("  {:20}  {:>9}  {:>9}  {:14}  {:>6}  {}\n", run.started_utc,
                       number(charted.quantity.value, 4),
                       number(charted.quantity.expanded_uncertainty, 3), charted.quantity.outcome,
                       charted.chart.ewma ? fmt::format("{:.2f}", *charted.chart.ewma) : "-",
                       charted.chart.alarm ? "DRIFT" : "");
}

std::string table_of(std::span<const HistoricRun> runs, const QuantityHistory& history) {
    std::string text = heading(history);
    text += fmt::format("  {:20}  {:>9}  {:>9}  {:14}  {:>6}\n", "run", "value", "U", "outcome",
                        "EWMA");
    for (std::size_t i = 0; i < history.runs.size(); ++i) {
        const HistoricRun& run = runs[history.runs[i].run];
        if (begins_baseline(history, i))
            text += fmt::format("  -- calibration {}: a new baseline\n", short_hash(run));
        text += row(run, history.runs[i]);
    }
    return text + "\n";
}

// ---- JSON

RecordJson optional_json(const std::optional<double>& value) {
    return value ? RecordJson(*value) : RecordJson();
}

RecordJson run_entry(const HistoricRun& run, const ChartedRun& charted) {
    return {{"started_utc", run.started_utc},
            {"record", run.folder.string()},
            {"calibration_sha256", run.calibration_sha256},
            {"baseline", charted.baseline},
            {"value", optional_json(charted.quantity.value)},
            {"expanded_uncertainty", optional_json(charted.quantity.expanded_uncertainty)},
            {"limit", optional_json(charted.quantity.limit)},
            {"outcome", charted.quantity.outcome},
            {"q", optional_json(charted.chart.q)},
            {"ewma", optional_json(charted.chart.ewma)},
            {"alarm", charted.chart.alarm}};
}

RecordJson chart_entry(std::span<const HistoricRun> runs, const QuantityHistory& history) {
    RecordJson list = RecordJson::array();
    for (const ChartedRun& charted : history.runs)
        list.push_back(run_entry(runs[charted.run], charted));
    return {{"camera", history.camera},
            {"station", history.station},
            {"marker", history.marker},
            {"quantity", history.quantity},
            {"unit", history.unit},
            {"drifts", history.drifts()},
            {"runs", list}};
}

// ---- pictures

struct Columns {
    std::vector<double> number, value, low, high, ewma, ewma_number;
    std::vector<std::string> notes, ewma_notes;
    // The runs that are the first with another calibration.
    std::vector<double> new_number, new_value;
    std::vector<std::string> new_notes;
};

Columns columns_of(std::span<const HistoricRun> runs, const QuantityHistory& history) {
    Columns columns;
    for (std::size_t i = 0; i < history.runs.size(); ++i) {
        const ChartedRun& charted = history.runs[i];
        const std::string note =
            fmt::format("{}, {}", runs[charted.run].started_utc, charted.quantity.outcome);
        const double u = charted.quantity.expanded_uncertainty.value_or(0.0);
        columns.number.push_back(static_cast<double>(i + 1));
        columns.value.push_back(*charted.quantity.value);
        columns.low.push_back(*charted.quantity.value - u);
        columns.high.push_back(*charted.quantity.value + u);
        columns.notes.push_back(note);
        if (begins_baseline(history, i)) {
            columns.new_number.push_back(static_cast<double>(i + 1));
            columns.new_value.push_back(*charted.quantity.value);
            columns.new_notes.push_back(
                fmt::format("{}, calibration {}", note, short_hash(runs[charted.run])));
        }
        if (!charted.chart.ewma)
            continue;
        columns.ewma_number.push_back(static_cast<double>(i + 1));
        columns.ewma.push_back(*charted.chart.ewma);
        columns.ewma_notes.push_back(note);
    }
    return columns;
}

SvgPlot value_plot(const Columns& columns, const QuantityHistory& history) {
    SvgPlot plot("run", title_of(history));
    plot.add_band(columns.number, columns.low, columns.high, Ink::gray, "U");
    plot.add_line(columns.number, columns.value, Ink::blue, "value");
    plot.add_points(columns.number, columns.value, Ink::blue, "", columns.notes);
    if (!columns.new_number.empty())
        plot.add_points(columns.new_number, columns.new_value, Ink::orange, "new calibration",
                        columns.new_notes);
    if (const auto limit = history.runs.back().quantity.limit)
        plot.add_level(*limit, Ink::red, "limit");
    return plot;
}

SvgPlot drift_plot(const Columns& columns) {
    SvgPlot plot("run", "EWMA of Q");
    plot.add_line(columns.ewma_number, columns.ewma, Ink::orange, "EWMA");
    plot.add_points(columns.ewma_number, columns.ewma, Ink::orange, "", columns.ewma_notes);
    plot.add_level(drift_limit, Ink::red, "alarm");
    plot.add_level(-drift_limit, Ink::red, "alarm");
    return plot;
}

void add_chart(HtmlPage& page, std::span<const HistoricRun> runs, const QuantityHistory& history) {
    page.add_heading(fmt::format("Camera {}: {}", history.camera, title_of(history)));
    page.add_facts({{"Station", history.station},
                    {"Marker", history.marker},
                    {"Drift alarm", history.drifts() ? "YES" : "no"}});
    const Columns columns = columns_of(runs, history);
    page.add_figures({{value_plot(columns, history).svg(), "Values, with U as a band."},
                      {drift_plot(columns).svg(), "How far they have moved from those before."}});
    std::vector<std::vector<std::string>> rows;
    for (const ChartedRun& charted : history.runs) {
        const HistoricRun& run = runs[charted.run];
        rows.push_back({run.started_utc, number(charted.quantity.value, 4),
                        number(charted.quantity.expanded_uncertainty, 3), charted.quantity.outcome,
                        number(charted.chart.ewma, 3), charted.chart.alarm ? "DRIFT" : "",
                        fmt::format("{}", charted.baseline), short_hash(run)});
    }
    page.add_table({"run", "value", "U", "outcome", "EWMA", "alarm", "baseline", "calibration"},
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

std::string history_json(std::span<const HistoricRun> runs,
                         std::span<const QuantityHistory> charts) {
    RecordJson list = RecordJson::array();
    for (const QuantityHistory& history : charts)
        list.push_back(chart_entry(runs, history));
    return text_of({{"etalon", "history/1"},
                    {"method", method_text()},
                    {"runs", runs.size()},
                    {"charts", list}},
                   2) +
           "\n";
}

void write_history_report(std::span<const HistoricRun> runs,
                          std::span<const QuantityHistory> charts,
                          const std::filesystem::path& folder) {
    make_record_folders(folder, {""});
    HtmlPage page("Cameras over time", fmt::format("{} runs", runs.size()));
    page.add_paragraph(method_text() +
                       " A new calibration begins a new baseline, of which the first two runs only "
                       "tell the mean and the spread.");
    int count = 0;
    for (const QuantityHistory& history : charts) {
        add_chart(page, runs, history);
        write_text(folder / fmt::format("chart-{}.svg", ++count),
                   value_plot(columns_of(runs, history), history).svg(/*stand_alone=*/true));
    }
    write_text(folder / "report.html", page.finish());
    write_text(folder / "history.json", history_json(runs, charts));
}

}  // namespace etalon
