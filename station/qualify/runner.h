// A qualification run from the plan to the written record: move, settle, photograph, detect; then
// the analysis (compare/qualification/qualification.h) and the report.
//
// The first three poses must show the marker in one of them at least: a run that would measure in
// vain ends there and says what is seen instead.
//
// The room's sensor is asked with every pose. One that fails is left alone from then on: the run
// goes on, remarks it, and cannot be certified.
//
// Whatever happens after the first motion, the axes are stopped and what was measured is on disk.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>

#include "core/time/progress.h"
#include "station/qualify/recorded_run.h"
#include "station/record/qualify_result.h"

namespace etalon {

// How the run gets its devices; tests give it mocks.
struct DeviceOpeners {
    std::function<std::unique_ptr<Camera>()> camera;
    std::function<std::unique_ptr<Stage>()> stage;
    bool homed = false;  // the operator's word, Stage::take_for_homed(): remarked in the record
    std::string operator_name = {};  // who begins the session, for the record; may be empty
    // Reads the room's sensor once, its time apart; throws DeviceError. Empty: there is none.
    std::function<ClimateReading()> climate = {};
};

// Those that the station names. A camera that another program seems to hold is waited for, which
// `progress` is told. All arguments must outlive what is returned.
DeviceOpeners station_devices(const StationFile& station, bool homed, Clock& clock,
                              Progress& progress, const std::stop_token& stop);

// Runs on the calling thread, which owns both devices throughout. `progress` is told the plan and
// how far it is. The result says how the run ended: ERROR with the reason when a device, the disk
// or a computation failed, ABORTED when `stop` was requested.
//
// Throws only before anything has moved or was written: ConfigError for a plan outside the soft
// limits, an unusable folder, or a device whose serial number is not the calibration's; what the
// openers throw.
QualifyResult run_qualification(const StationFile& station, const std::filesystem::path& folder,
                                const DeviceOpeners& open, Clock& clock, Progress& progress,
                                std::stop_token stop);

// Goes on with a run that a crash, a fault or Ctrl-C ended: visits the poses of its plan that were
// not, then analyses all of them. The devices are opened only when poses are missing, and homed
// anew. The record gets a further session.
//
// Throws before anything has moved or was written: ConfigError for a run that came to its end, a
// plan with a target that is not allowed, another camera than the record's, and what the openers
// throw. Settings of the camera that differ from the record's end the run as an ERROR.
QualifyResult resume_qualification(RecordedRun recorded, const DeviceOpeners& open, Clock& clock,
                                   Progress& progress, std::stop_token stop);

}  // namespace etalon
