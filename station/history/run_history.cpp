#include "station/history/run_history.h"

#include <fmt/format.h>

#include "core/file/text.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

std::optional<double> number_or_null(const JsonEntry& entry) {
    if (entry.is_null())
        return std::nullopt;
    return entry.number();
}

std::vector<HistoricQuantity> read_quantities(const JsonEntry& run) {
    std::vector<HistoricQuantity> quantities;
    if (!run.has("measurements"))
        return quantities;  // it ended before
    for (const JsonEntry& item : run.at("measurements").items())
        quantities.push_back({item.at("name").text(), item.at("unit").text(),
                              number_or_null(item.at("value")),
                              number_or_null(item.at("expanded_uncertainty")),
                              number_or_null(item.at("limit")), item.at("outcome").text()});
    return quantities;
}

std::string calibration_of(const JsonEntry& run) {
    for (const JsonEntry& input : run.at("inputs").items())
        if (input.at("role").text() == "calibration")
            return input.at("sha256").text();
    run.at("inputs").fail("has no calibration");
}

// Of the last session; records of before 2026-11-26 do not have it.
std::string operator_of(const JsonEntry& run) {
    if (!run.has("sessions") || run.at("sessions").items().empty())
        return {};
    const JsonEntry last = run.at("sessions").items().back();
    return last.has("operator") ? last.at("operator").text() : "";
}

bool is_record(const Path& folder) {
    std::error_code ignored;
    return std::filesystem::is_regular_file(folder / "run.json", ignored);
}

std::vector<Path> records_in(const Path& folder) {
    if (is_record(folder))
        return {folder};
    std::vector<Path> records;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error))
        if (is_record(entry.path()))
            records.push_back(entry.path());
    if (error || records.empty())
        throw ConfigError({folder.string()}, "holds no record of a run (run.json)");
    return records;
}

void refuse_the_same_run_twice(const std::vector<HistoricRun>& runs) {
    for (std::size_t i = 1; i < runs.size(); ++i)
        if (runs[i].started_utc == runs[i - 1].started_utc && runs[i].camera == runs[i - 1].camera)
            throw ConfigError({runs[i].folder.string()},
                              fmt::format("is the same run as {}", runs[i - 1].folder.string()));
}

// Each stretch of runs with one calibration by itself.
void chart(QuantityHistory& history) {
    for (auto begin = history.runs.begin(); begin != history.runs.end();) {
        const auto end = std::find_if(begin, history.runs.end(), [&](const ChartedRun& run) {
            return run.baseline != begin->baseline;
        });
        std::vector<double> values;
        for (auto run = begin; run != end; ++run)
            values.push_back(*run->quantity.value);
        for (const ChartPoint& point : drift_chart(values))
            (begin++)->chart = point;
    }
}

bool has_verdict(const HistoricRun& run) {
    return run.outcome == "PASS" || run.outcome == "FAIL" || run.outcome == "INCONCLUSIVE";
}

// What belongs together.
auto setup_of(const auto& one) {
    return std::tie(one.camera, one.station, one.marker);
}

// From the last PASS on; a camera whose limits ask for it and that never passed is due at once.
void find_due_day(std::span<const HistoricRun> runs, const std::string& today, CameraState& state) {
    for (const HistoricRun& run : runs) {
        if (setup_of(state) != setup_of(run) || !has_verdict(run) || !run.due_after_days)
            continue;
        if (run.outcome == "PASS")
            state.due = date_of_days(days_of_date(run.started_utc.substr(0, 10)).value() +
                                     *run.due_after_days);
        state.is_due = state.due.empty() || state.due <= today;
    }
}

// The runs since the latest calibration.
Trend latest_trend(std::span<const HistoricRun> runs, const QuantityHistory& history) {
    constexpr double day_s = 86400.0;
    std::vector<TimedValue> values;
    for (const ChartedRun& charted : history.runs)
        if (charted.baseline == history.runs.back().baseline)
            values.push_back({utc_seconds(runs[charted.run].started_utc).value() / day_s,
                              *charted.quantity.value});
    return trend_of(values);
}

constexpr const char* state_columns = "  {:11} {:9} {:10} {:12} {:>4}  {:10} {}";

std::string state_line(const CameraState& state) {
    std::string words;  // "DUE ALARM TREND", as much of it as there is
    for (const auto& [word, is_so] :
         {std::pair(" DUE", state.is_due),
          {" ALARM", !state.alarms.empty()},
          {" TREND", std::ranges::any_of(state.trends, &QuantityTrend::is_shown)}})
        words += is_so ? word : "";
    const std::string due = !state.due.empty() ? state.due : state.is_due ? "now" : "-";
    std::string line =
        fmt::format(state_columns, state.camera, state.station, state.last_utc.substr(0, 10),
                    state.last_outcome, state.runs, due, trimmed(words));
    line.erase(line.find_last_not_of(' ') + 1);
    return line + "\n";
}

}  // namespace

HistoricRun read_run(const Path& folder, const std::string& run_json) {
    const JsonEntry json(run_json, {(folder / "run.json").string(), 0, ""});
    if (json.at("etalon").text() != "run/1")
        json.at("etalon").fail("must be 'run/1'");
    HistoricRun run;
    run.folder = folder;
    run.started_utc = json.at("started_utc").text();
    if (!utc_seconds(run.started_utc))
        json.at("started_utc").fail("must be a time as 2026-03-07T14:05:09Z");
    run.outcome = json.at("outcome").text();
    run.reason = json.has("reason") ? json.at("reason").text() : "";
    run.operator_name = operator_of(json);
    run.camera = json.at("camera").at("serial").text();
    if (run.camera.empty())
        run.camera = json.at("camera").at("uri").text();
    run.station = json.at("station").text();
    run.marker = json.at("marker").text();
    run.limits = json.at("limits").text();
    run.calibration_sha256 = calibration_of(json);
    if (json.has("due_after_days") && !json.at("due_after_days").is_null())
        run.due_after_days = static_cast<int>(json.at("due_after_days").integer(1, 36500));
    run.quantities = read_quantities(json);
    return run;
}

std::vector<HistoricRun> read_history(std::span<const Path> folders) {
    std::vector<HistoricRun> runs;
    for (const Path& folder : folders)
        for (const Path& record : records_in(folder))
            runs.push_back(read_run(record, read_text(record / "run.json")));
    // ISO 8601 in one time zone: the order of the texts is that of the times.
    std::ranges::sort(runs, {}, [](const HistoricRun& run) {
        return std::tie(run.started_utc, run.camera, run.folder);
    });
    refuse_the_same_run_twice(runs);
    return runs;
}

std::vector<QuantityHistory> chart_history(std::span<const HistoricRun> runs) {
    std::vector<QuantityHistory> histories;
    for (std::size_t i = 0; i < runs.size(); ++i)
        for (const HistoricQuantity& quantity : runs[i].quantities) {
            if (!quantity.value)
                continue;
            auto history = std::ranges::find_if(histories, [&](const QuantityHistory& one) {
                return setup_of(one) == setup_of(runs[i]) && one.quantity == quantity.name;
            });
            if (history == histories.end())
                history = histories.insert(history, {runs[i].camera, runs[i].station,
                                                     runs[i].marker, quantity.name, quantity.unit});
            std::vector<ChartedRun>& charted = history->runs;
            ChartedRun run{i, quantity, 1, {}};
            if (!charted.empty()) {
                const HistoricRun& before = runs[charted.back().run];
                const bool same = before.calibration_sha256 == runs[i].calibration_sha256;
                run.baseline = charted.back().baseline + (same ? 0 : 1);
            }
            charted.push_back(run);
        }
    std::ranges::stable_sort(histories, {}, setup_of<QuantityHistory>);
    for (QuantityHistory& history : histories)
        chart(history);
    return histories;
}

bool CameraState::drifts() const {
    return !alarms.empty() || std::ranges::any_of(trends, &QuantityTrend::is_shown);
}

std::vector<CameraState> fleet_of(std::span<const HistoricRun> runs,
                                  std::span<const QuantityHistory> charts,
                                  const std::string& today) {
    std::vector<CameraState> fleet;
    for (const HistoricRun& run : runs) {
        if (!has_verdict(run))
            continue;
        auto state = std::ranges::find_if(
            fleet, [&](const auto& one) { return setup_of(one) == setup_of(run); });
        if (state == fleet.end())
            state = fleet.insert(state, {run.camera, run.station, run.marker});
        ++state->runs;
        state->last_utc = run.started_utc;
        state->last_outcome = run.outcome;
    }
    std::ranges::sort(fleet, {}, setup_of<CameraState>);
    for (CameraState& state : fleet) {
        find_due_day(runs, today, state);
        for (const QuantityHistory& history : charts) {
            if (setup_of(state) != setup_of(history))
                continue;
            if (history.drifts())
                state.alarms.push_back(history.quantity);
            state.trends.push_back({history.quantity, history.unit, latest_trend(runs, history)});
        }
        const auto quantities = static_cast<int>(state.trends.size());
        for (QuantityTrend& each : state.trends) {
            each.is_judged = !is_too_short_for_trend(each.trend.runs, quantities);
            each.is_shown = each.is_judged && each.trend.probability <= trend_limit(quantities);
        }
    }
    return fleet;
}

std::string fleet_text(std::span<const CameraState> fleet) {
    std::string text = fmt::format(state_columns, "camera", "station", "last run", "outcome",
                                   "runs", "due", "state") +
                       "\n";
    for (const CameraState& state : fleet) {
        text += state_line(state);
        for (const QuantityTrend& each : state.trends)
            if (each.is_shown)
                text += fmt::format("    {} {}: {:+.3g} {} a year over {} runs, p = {:.2g}\n",
                                    state.camera, each.quantity, each.trend.per_year.value_or(0.0),
                                    each.unit, each.trend.runs, each.trend.probability);
    }
    return text + "\n";
}

std::string trend_method_text() {
    return fmt::format(
        "Trend of the runs since the latest calibration by Mann and Kendall's test; a camera "
        "without a trend shows one in any of its quantities with {:.0f} % probability each time it "
        "is looked at.",
        100.0 * trend_false_alarm);
}

}  // namespace etalon
