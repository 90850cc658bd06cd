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

#include "compare/detect/detector.h"
#include "station/qualify/recorded_run.h"

namespace etalon {

// From what was read and photographed at one pose to its means: the same for a pose that was just
// visited and for one that is read from a record.

// "frames/0007_1.png": frame 1 of pose 7, both from 0.
std::string frame_file(int pose, int frame);

// Sets read_back, its deviation and uncertainty, and the stage's pose from `pose.readings`: at
// least two, each with a position for every axis.
void average_readings(VisitedPose& pose, std::span<const Axis> axes);

// Sets the frame's corners, or why there are none: all are needed, as means are taken of them.
void detect_frame(Detector& detector, const CodeImage& image, FrameRecord& frame);

// Sets the pose's corners, the mean over the frames that saw the marker, their number, and how far
// these leave the corners apart.
void average_corners(VisitedPose& pose);

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

// The sensor of a station's room (station/setup/environment.h) as a device.
// Connects with the first reading, and reads as the stage is read (stage/link/modbus_link.h): each
// quantity up to three times. What a room cannot have is an error like no answer. The clock must
// outlive the function, which throws DeviceError. Throws ConfigError for a link that cannot be.
std::function<ClimateReading()> room_sensor(const RoomSensor& sensor, Clock& clock);

}  // namespace etalon
