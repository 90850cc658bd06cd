// A qualification run from the plan to the written record: move, settle, photograph, detect; then
// the analysis (compare/qualification/qualification.h) and the report.
//
// One of the first three poses must show the marker: otherwise the run ends there and says what is
// seen instead. A room sensor that fails is not asked again: the run is remarked and cannot be
// certified. Whatever happens after the first motion, the axes are stopped and what was measured is
// on disk.
#pragma once

#include "station/qualify/recorded_run.h"

namespace etalon {

// ---- of one pose, just visited or read from a record

// "frames/0007_1.png": frame 1 of pose 7, both from 0.
std::string frame_file(int pose, int frame);

// From at least two `pose.readings`: sets read_back, its uncertainty, and the stage's pose.
void average_readings(VisitedPose& pose, std::span<const Axis> axes);

// Sets the frame's corners, or why there are none: all are needed, as means are taken of them.
void detect_frame(Detector& detector, const CodeImage& image, FrameRecord& frame);

// Sets the pose's corners (means over the frames that saw the marker), their number and noise.
void average_corners(VisitedPose& pose);

// How the run gets its devices; tests give it mocks.
struct DeviceOpeners {
    std::function<std::unique_ptr<Camera>()> camera;
    std::function<std::unique_ptr<Stage>()> stage;
    bool homed = false;  // as the operator says: Stage::take_for_homed(), remarked in the record
    std::string operator_name = {};  // who begins the session, for the record; may be empty
    // Reads the room's sensor once, its time apart; throws DeviceError. Empty: there is none.
    std::function<ClimateReading()> climate = {};
};

// Waits for a camera in use, and tells `progress`. All arguments must outlive the result.
DeviceOpeners station_devices(const StationFile& station, bool homed, Clock& clock,
                              Progress& progress, const std::stop_token& stop);

// Runs on the calling thread, which owns both devices throughout. `progress` is told the plan and
// how far it is. The result says how the run ended: ERROR with the reason when a device, the disk
// or a computation failed, ABORTED when `stop` was requested.
//
// Throws only before anything has moved or was written: what the openers throw, and ConfigError for
// a plan outside the soft limits, an unusable folder, or a device of another serial number than the
// calibration's.
QualifyResult run_qualification(const StationFile& station, const std::filesystem::path& folder,
                                const DeviceOpeners& open, Clock& clock, Progress& progress,
                                std::stop_token stop);

// Resumes a run that a crash, a fault or Ctrl-C ended, in a further session: visits the missing
// poses of its plan, then analyses all of them. The devices are opened only when poses are missing,
// and homed again.
//
// Throws before anything has moved or was written: what the openers throw, and ConfigError for a
// run with a verdict, a target that is not allowed, or another camera than the record's. Other
// settings of the camera than the record's end the run as an ERROR.
QualifyResult resume_qualification(RecordedRun recorded, const DeviceOpeners& open, Clock& clock,
                                   Progress& progress, std::stop_token stop);

// The sensor of a station's room (station/setup/environment.h). It connects with the first reading,
// reads each quantity up to three times and throws DeviceError, also for impossible values. The
// clock must outlive it. Throws ConfigError for a link that cannot be.
std::function<ClimateReading()> room_sensor(const RoomSensor& sensor, Clock& clock);

}  // namespace etalon
