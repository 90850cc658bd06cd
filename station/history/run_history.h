// What became of a camera over time, from the run.json files of its runs. Only what this needs of
// them is read, so that runs of other versions can be charted together.
#pragma once

#include <filesystem>
#include <string>

#include "station/history/control_chart.h"

namespace etalon {

struct HistoricQuantity {
    std::string name, unit;
    std::optional<double> value, expanded_uncertainty;  // nothing: not measured
    std::optional<double> limit;
    std::string outcome;
};

struct HistoricRun {
    std::filesystem::path folder;
    std::string started_utc, outcome;
    std::string reason, operator_name;  // of an ERROR or ABORTED; of the last session; may be empty
    std::string camera;                 // serial number; the address of a camera without one
    std::string station, marker, limits;
    std::string calibration_sha256;
    std::optional<int> due_after_days;  // of the limits; records of before 2026-11-27 have none
    std::vector<HistoricQuantity> quantities;
};

// From the text of the folder's run.json, of which these keys count. Throws ConfigError.
HistoricRun read_run(const std::filesystem::path& folder, const std::string& run_json);
inline constexpr const char* historic_keys[] = {
    "etalon",  "started_utc", "outcome", "reason", "sessions",       "camera",
    "station", "marker",      "limits",  "inputs", "due_after_days", "measurements"};

// The runs of these folders in the order of their start. A folder is a record, or holds some.
// Throws ConfigError without a record, for a bad run.json and a run that is there twice.
std::vector<HistoricRun> read_history(std::span<const std::filesystem::path> folders);

struct ChartedRun {
    std::size_t run = 0;  // index into the history
    HistoricQuantity quantity;
    int baseline = 1;  // counts the calibrations
    ChartPoint chart;
};

// One quantity of a camera, station and marker. A new calibration begins a new baseline.
struct QuantityHistory {
    std::string camera, station, marker, quantity, unit;
    std::vector<ChartedRun> runs;  // those that measured it

    bool drifts() const { return !runs.empty() && runs.back().chart.alarm; }  // as of the last run
};

std::vector<QuantityHistory> chart_history(std::span<const HistoricRun> runs);

// Which cameras are due, and which drift: for each camera with its station and marker.

struct QuantityTrend {
    std::string quantity, unit;
    Trend trend;             // of the runs since the latest calibration
    bool is_shown = false;   // a trend, at 1 % for all quantities of the camera together
    bool is_judged = false;  // false: too few runs
};

struct CameraState {
    std::string camera, station, marker;
    int runs = 0;                        // with a verdict
    std::string last_utc, last_outcome;  // of them
    std::string due;                  // day: `due_after_days` after the last PASS; empty: unknown
    bool is_due = false;              // today or before, or it never passed
    std::vector<std::string> alarms;  // quantities whose control chart has one
    std::vector<QuantityTrend> trends;

    bool drifts() const;
};

// `today`: "2026-03-07". `charts` are those of the runs.
std::vector<CameraState> fleet_of(std::span<const HistoricRun> runs,
                                  std::span<const QuantityHistory> charts,
                                  const std::string& today);

// For people, at most 80 columns unless names are long; and as JSON, {"method", "cameras": [...]}.
std::string fleet_text(std::span<const CameraState> fleet);
std::string fleet_json(std::span<const CameraState> fleet);

std::string trend_method_text();

// `fleet` is that of the runs. As text of 80 columns, JSON `etalon: history/1`, and a folder with
// report.html, a chart-N.svg of each quantity and history.json.
std::string history_text(std::span<const HistoricRun> runs,
                         std::span<const QuantityHistory> charts);
std::string history_json(std::span<const HistoricRun> runs, std::span<const QuantityHistory> charts,
                         std::span<const CameraState> fleet);
void write_history_report(std::span<const HistoricRun> runs,
                          std::span<const QuantityHistory> charts,
                          std::span<const CameraState> fleet, const std::filesystem::path& folder);

}  // namespace etalon
