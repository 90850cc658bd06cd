#include "station/history/fleet.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/time/clock.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

bool has_verdict(const HistoricRun& run) {
    return run.outcome == "PASS" || run.outcome == "FAIL" || run.outcome == "INCONCLUSIVE";
}

template <class Measured>
bool is_of(const CameraState& state, const Measured& one) {
    return state.camera == one.camera && state.station == one.station && state.marker == one.marker;
}

// From the last PASS on; a camera whose limits ask for it and that never passed is due at once.
struct DueDay {
    std::string day;
    bool is_due = false;
};

DueDay due_day(std::span<const HistoricRun> runs, const CameraState& state,
               const std::string& today) {
    DueDay due;
    for (const HistoricRun& run : runs) {
        if (!is_of(state, run) || !has_verdict(run) || !run.due_after_days)
            continue;
        if (run.outcome == "PASS")
            due.day = date_of_days(days_of_date(run.started_utc.substr(0, 10)).value() +
                                   *run.due_after_days);
        due.is_due = due.day.empty() || due.day <= today;
    }
    return due;
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

void judge_trends(std::vector<QuantityTrend>& trends) {
    const auto quantities = static_cast<int>(trends.size());
    for (QuantityTrend& each : trends) {
        each.is_judged = !is_too_short_for_trend(each.trend.runs, quantities);
        each.is_shown = each.is_judged && each.trend.probability <= trend_limit(quantities);
    }
}

CameraState& state_of(std::vector<CameraState>& fleet, const HistoricRun& run) {
    const auto found =
        std::ranges::find_if(fleet, [&](const CameraState& state) { return is_of(state, run); });
    if (found != fleet.end())
        return *found;
    CameraState& state = fleet.emplace_back();
    state.camera = run.camera;
    state.station = run.station;
    state.marker = run.marker;
    return state;
}

constexpr const char* columns = "  {:11} {:9} {:10} {:12} {:>4}  {:10} {}";

// "DUE ALARM TREND", as much of it as there is.
std::string words_of(const CameraState& state) {
    std::vector<std::string> words;
    if (state.is_due)
        words.emplace_back("DUE");
    if (!state.alarms.empty())
        words.emplace_back("ALARM");
    if (std::ranges::any_of(state.trends, &QuantityTrend::is_shown))
        words.emplace_back("TREND");
    return fmt::format("{}", fmt::join(words, " "));
}

std::string line_of(const CameraState& state) {
    const std::string due = !state.due.empty() ? state.due : state.is_due ? "now" : "-";
    std::string line =
        fmt::format(columns, state.camera, state.station, state.last_utc.substr(0, 10),
                    state.last_outcome, state.runs, due, words_of(state));
    line.erase(line.find_last_not_of(' ') + 1);
    return line + "\n";
}

std::string trend_line(const CameraState& state, const QuantityTrend& each) {
    return fmt::format("    {} {}: {:+.3g} {} a year over {} runs, p = {:.2g}\n", state.camera,
                       each.quantity, each.trend.per_year.value_or(0.0), each.unit, each.trend.runs,
                       each.trend.probability);
}

}  // namespace

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
        CameraState& state = state_of(fleet, run);
        ++state.runs;
        state.last_utc = run.started_utc;
        state.last_outcome = run.outcome;
    }
    std::ranges::sort(fleet, {}, [](const CameraState& state) {
        return std::tie(state.camera, state.station, state.marker);
    });
    for (CameraState& state : fleet) {
        const DueDay due = due_day(runs, state, today);
        state.due = due.day;
        state.is_due = due.is_due;
        for (const QuantityHistory& history : charts) {
            if (!is_of(state, history))
                continue;
            if (history.drifts())
                state.alarms.push_back(history.quantity);
            state.trends.push_back({history.quantity, history.unit, latest_trend(runs, history)});
        }
        judge_trends(state.trends);
    }
    return fleet;
}

std::string fleet_text(std::span<const CameraState> fleet) {
    std::string text =
        fmt::format(columns, "camera", "station", "last run", "outcome", "runs", "due", "state") +
        "\n";
    for (const CameraState& state : fleet) {
        text += line_of(state);
        for (const QuantityTrend& each : state.trends)
            if (each.is_shown)
                text += trend_line(state, each);
    }
    return text + "\n";
}

std::string trend_method_text() {
    return fmt::format(
        "Trend of the runs since the latest calibration by Mann and Kendall's test; a camera "
        "without "
        "a trend shows one in any of its quantities with {:.0f} % probability each time it is "
        "looked "
        "at.",
        100.0 * trend_false_alarm);
}

}  // namespace etalon
