// The lines of a record's log, events.jsonl: one JSON object each, read back by
// capture/frame/frame_log.h and station/qualify/recorded_run.h. The log, the frames and the copies
// of the inputs are the record; every other file follows from them.
//
//     run                first line: the inputs and the plan
//     session            the program was started: a run that was resumed has several
//     camera configured  the settings in force
//     frame, pose        what was taken and read; the frames of a pose come before it
//     climate            what the room's sensor said with the pose that follows
//     climate lost       why it is not asked any more
//     remark             what limited the devices, one line each
//     camera released    its counters at the end of a session
//     PASS, FAIL, ...    how a session ended; missing where the program was killed
//
// and others for people, which reading back passes over. Times are seconds since the run began;
// numbers read back as the same double; null is not known.
#pragma once

#include "station/record/qualify_result.h"

namespace etalon {

inline constexpr const char* run_log_kind = "run-log/1";
inline constexpr const char* climate_read = "climate";
inline constexpr const char* climate_lost = "climate lost";

// One line each, without its end.
std::string state_event(double time_s, const std::string& state, const std::string& detail);
std::string run_event(const QualifyResult& result);
std::string session_event(const RunSession& session, const CameraIdentity& camera);
std::string settings_event(double time_s, const CaptureSettings& settings);
std::string frame_event(int pose, const FrameRecord& frame);
std::string pose_event(const VisitedPose& pose, const CaptureStatistics& counts);
std::string climate_event(const ClimateReading& reading);
std::string released_event(double time_s, const CaptureStatistics& counts);

}  // namespace etalon
