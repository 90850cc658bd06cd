#include "station/record/run_events.h"

#include "report/number_text.h"
#include "station/record/record_json.h"

namespace etalon {
namespace {

Json corners_json(const std::vector<Eigen::Vector2d>& pixels) {
    return json_list(pixels, numbers_of<Eigen::Vector2d>);
}

Json planned_json(const Plan& plan) {
    Json poses = Json::array();
    for (const PlannedPose& pose : plan.poses)
        poses.push_back({{"target", pose.target}, {"hold_out", pose.hold_out}});
    return {{"expected_duration_s", std::chrono::duration<double>(plan.expected_duration).count()},
            {"poses", poses}};
}

Json counters_json(const CaptureStatistics& counts) {
    Json counters;
    add_counters(counters, counts);
    return counters;
}

std::string line_of(const Json& json) {
    return text_of(json, -1);
}

}  // namespace

std::string state_event(double time_s, const std::string& state, const std::string& detail) {
    return line_of({{"t", time_s}, {"event", state}, {"detail", detail}});
}

std::string run_event(const QualifyResult& result) {
    return line_of({{"t", 0.0},
                    {"event", "run"},
                    {"etalon", run_log_kind},
                    {"inputs", inputs_json(result.station.inputs)},
                    {"plan", planned_json(result.plan)}});
}

std::string session_event(const RunSession& session, const CameraIdentity& camera) {
    return line_of({{"t", session.start_s},
                    {"event", "session"},
                    {"started_utc", session.started_utc},
                    {"boot", session.started.boot},
                    {"boot_s", session.started.seconds},
                    {"version", session.version},
                    {"operator", session.operator_name},
                    {"camera", camera}});
}

std::string settings_event(double time_s, const CaptureSettings& settings) {
    return line_of(
        {{"t", time_s}, {"event", "camera configured"}, {"settings", settings_json(settings)}});
}

std::string frame_event(int pose_index, const FrameRecord& frame) {
    return line_of({{"t", frame.exposure_start_s},
                    {"event", "frame"},
                    {"pose", pose_index},
                    {"file", frame.file},
                    {"sha256", frame.sha256},
                    {"status", name(frame.status)},
                    {"status_detail", frame.status_detail},
                    {"device_id", frame.device_id},
                    {"exposure_start_uncertainty_s", frame.exposure_start_uncertainty_s},
                    {"time_source", name(frame.time_source)},
                    {"device_time_ns", frame.device_time_ns},
                    {"settings", settings_json(frame.settings)},
                    {"detection", frame.detection},
                    {"corners", corners_json(frame.corners)}});
}

std::string pose_event(const VisitedPose& pose, const CaptureStatistics& counts) {
    const Vector6d uncertainty = pose.stage_covariance.diagonal().cwiseSqrt();
    return line_of({{"t", pose.done_s},
                    {"event", "pose"},
                    {"pose", pose.index},
                    {"hold_out", pose.hold_out},
                    {"commanded", pose.target},
                    {"readings", pose.readings},
                    {"read_back", pose.read_back},
                    {"read_back_deviation", pose.read_back_deviation},
                    {"base_from_carriage", pose_numbers(pose.base_from_carriage)},
                    {"base_from_carriage_uncertainty", numbers_of(uncertainty)},
                    {"approach", pose.approach},
                    {"move_start_s", pose.move_start_s},
                    {"settled_s", pose.settled_s.value_or(0.0)},
                    {"detections", pose.detections},
                    {"corners", corners_json(pose.corners)},
                    {"camera", counters_json(counts)}});
}

std::string climate_event(const ClimateReading& reading) {
    return line_of({{"t", reading.t_s},
                    {"event", climate_read},
                    {"temperature_c", reading.temperature_c},
                    {"humidity_percent", or_null(reading.humidity_percent)}});
}

std::string released_event(double time_s, const CaptureStatistics& counts) {
    return line_of(
        {{"t", time_s}, {"event", "camera released"}, {"camera", counters_json(counts)}});
}

}  // namespace etalon
