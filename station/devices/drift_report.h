// What `etalon capture --drift` leaves behind.
//
//     drift.csv    one row per frame: time, movement of the target since its part's first frame
//     drift.json   `etalon: drift/1`: result, camera, every rate with its uncertainty, jumps
//     report.html  the same as plots, with what it cannot tell
#pragma once

#include <string>

#include "station/devices/capture_drift.h"

namespace etalon {

// Numbers read back as the same double. What was not measured is null or empty.
std::string drift_csv(const DriftResult& result);
std::string drift_json(const DriftResult& result, const std::string& target);
std::string drift_html(const DriftResult& result, const std::string& target);

// "drift 0.013 px/min stable after 12.4 min", and what stands there of a camera that is not.
std::string drift_sentence(const DriftResult& result);

// For a terminal: at most 79 columns.
std::string drift_line(const DriftMonitor& monitor);

}  // namespace etalon
