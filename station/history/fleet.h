// Which cameras of a fleet are due, and which drift: a line for each camera with the station and
// marker that measured it.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "station/history/control_chart.h"
#include "station/history/run_history.h"

namespace etalon {

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

}  // namespace etalon
