#include "station/record/run_json.h"

#include <fmt/format.h>

#include <cmath>

#include "core/file/text.h"
#include "core/geometry/units.h"
#include "report/number_text.h"
#include "station/record/analysis_json.h"
#include "station/record/record_json.h"

namespace etalon {
namespace {

using Json = RecordJson;

double seconds(Duration duration) {
    return std::chrono::duration<double>(duration).count();
}

double unit_of(const Axis& axis) {
    return axis.kind == Axis::Kind::rotary ? deg_per_rad : 1.0;
}

Json camera_json(const QualifyResult& result) {
    Json camera = device_json(result.camera);
    camera["uri"] = result.station.camera.uri;
    camera["calibrated_serial"] = result.station.camera.model.serial;
    camera["settings"] = settings_json(result.settings);
    add_counters(camera, result.statistics());
    camera["remarks"] = result.remarks;
    return camera;
}

// In the axis' unit.
Json optional_size(const std::optional<double>& size, double unit) {
    return size ? Json(*size * unit) : Json();
}

Json error_map_json(const std::optional<ErrorMap>& map, double unit) {
    if (!map)
        return {};
    Json rows = Json::array();
    for (const ErrorMapPoint& point : map->points())
        rows.push_back({point.position * unit, point.error * unit, point.uncertainty * unit});
    return rows;
}

Json axis_json(const Axis& axis) {
    const double unit = unit_of(axis);
    const bool rotary = axis.kind == Axis::Kind::rotary;
    return {{"name", axis.name},
            {"kind", rotary ? "rotary" : "linear"},
            {"unit", rotary ? "deg" : "mm"},
            {"direction", numbers_json(axis.direction)},
            {"point_mm", numbers_json(axis.point_mm)},
            {"travel", {axis.low * unit, axis.high * unit}},
            {"speed", axis.speed * unit},
            {"scale_uncertainty", optional_number(axis.scale_uncertainty)},
            {"repeatability", optional_size(axis.repeatability, unit)},
            {"previous_from_mount", pose_numbers(axis.previous_from_mount)},
            {"zero", axis.zero * unit},
            {"approach", axis.approach},
            {"overrun", axis.overrun * unit},
            {"backlash", axis.backlash * unit},
            {"backlash_uncertainty", optional_size(axis.backlash_uncertainty, unit)},
            {"read_noise", optional_size(axis.read_noise, unit)},
            {"direction_uncertainty_rad", optional_number(axis.direction_uncertainty)},
            {"point_uncertainty_mm", optional_number(axis.point_uncertainty)},
            {"error_map", error_map_json(axis.errors, unit)}};
}

Json forbidden_json(const StationStage& stage) {
    Json boxes = Json::array();
    for (const ForbiddenBox& box : stage.rules.forbidden) {
        Json sides = {{"name", box.name}};
        for (std::size_t i = 0; i < stage.axes.size(); ++i)
            if (std::isfinite(box.sides[i].low))
                sides[stage.axes[i].name] = {box.sides[i].low * unit_of(stage.axes[i]),
                                             box.sides[i].high * unit_of(stage.axes[i])};
        boxes.push_back(sides);
    }
    return boxes;
}

Json link_json(const StageLink& link) {
    Json json = {{"unit", link.unit}, {"response_timeout_ms", link.response_timeout.count()}};
    if (const auto* port = std::get_if<SerialPort>(&link.address)) {
        json["device"] = port->device;
        json["baud"] = port->baud;
        json["format"] = fmt::format("{}{}{}", port->data_bits, port->parity, port->stop_bits);
        json["quiet_ms"] = link.quiet.count();
    } else {
        json["host"] = std::get<TcpAddress>(link.address).host;
        json["port"] = std::get<TcpAddress>(link.address).port;
    }
    return json;
}

Json stage_json(const StationStage& stage) {
    Json axes = Json::array();
    for (const Axis& axis : stage.axes)
        axes.push_back(axis_json(axis));
    return {{"link", link_json(stage.link)},
            {"profile", stage.profile},
            {"axes", axes},
            {"forbidden", forbidden_json(stage)}};
}

Json plan_json(const StationFile& station, const Plan& plan) {
    Json volume;
    for (std::size_t i = 0; i < station.stage.axes.size(); ++i) {
        const double unit = unit_of(station.stage.axes[i]);
        volume[station.stage.axes[i].name] = {station.plan.volume[i].low * unit,
                                              station.plan.volume[i].high * unit};
    }
    const auto hold_out = std::ranges::count(plan.poses, true, &PlannedPose::hold_out);
    return {{"volume", volume},
            {"poses", plan.poses.size()},
            {"hold_out", hold_out},
            {"repeats", station.plan.repeats},
            {"frames", station.plan.frames},
            {"seed", station.plan.seed},
            {"settle_ms", station.plan.settle.count()},
            {"expected_duration_s", seconds(plan.expected_duration)}};
}

Json climate_json(const std::optional<ClimateSummary>& climate) {
    if (!climate)
        return {};
    return {{"lowest", climate->lowest},
            {"highest", climate->highest},
            {"mean", climate->mean},
            {"deviation", climate->deviation},
            {"readings", climate->readings}};
}

// `source`: a sensor's address, "given by hand", or null.
Json environment_json(const QualifyResult& result) {
    const auto& declared = result.station.environment;
    Json source;
    if (declared)
        source = declared->sensor ? describe(declared->sensor->link) : "given by hand";
    return {{"source", source},
            {"temperature_c", climate_json(room_temperature(result.station, result.environment))},
            {"humidity_percent", climate_json(room_humidity(result.station, result.environment))},
            {"lost", result.environment.lost}};
}

Json references_json(const std::vector<TracedReference>& references) {
    Json list = Json::array();
    for (const TracedReference& each : references)
        list.push_back({{"name", each.name},
                        {"value", each.value},
                        {"expanded_uncertainty", each.expanded_uncertainty},
                        {"unit", each.unit},
                        {"certificate", each.certificate},
                        {"laboratory", each.laboratory},
                        {"date", each.date},
                        {"due", each.due}});
    return list;
}

Json sessions_json(const std::vector<RunSession>& sessions) {
    Json list = Json::array();
    for (const RunSession& session : sessions)
        list.push_back({{"started_utc", session.started_utc},
                        {"start_s", session.start_s},
                        {"version", session.version},
                        {"operator", session.operator_name},
                        {"poses_visited", session.poses}});
    return list;
}

Json attachments_json(const std::vector<Attachment>& attachments) {
    Json list = Json::array();
    for (const Attachment& file : attachments)
        list.push_back({{"path", file.path}, {"sha256", file.sha256}});
    return list;
}

// poses.csv, a group of columns at a time.
using Row = std::vector<std::string>;

void add_six(Row& row, const std::optional<PoseEstimate>& estimate) {
    const Vector6d vector =
        estimate ? vector_from_rigid(estimate->camera_from_marker) : Vector6d::Zero();
    for (int i = 0; i < 6; ++i)
        row.push_back(estimate ? exact(vector[i]) : "");
}

void add_bias(Row& row, const std::optional<PoseError>& bias) {
    for (int i = 0; i < 3; ++i)
        row.push_back(bias ? exact(bias->translation_mm[i]) : "");
    for (int i = 0; i < 3; ++i)
        row.push_back(bias ? exact(bias->rotation_rad[i] * 1000.0) : "");
}

Row csv_header(const std::vector<Axis>& axes) {
    Row header = {"pose", "split"};
    for (const char* prefix : {"commanded_", "read_back_", "deviation_", "approach_"})
        for (const Axis& axis : axes) {
            const bool is_length = prefix != std::string("approach_");
            const char* unit = axis.kind == Axis::Kind::rotary ? "_deg" : "_mm";
            header.push_back(prefix + axis.name + (is_length ? unit : ""));
        }
    for (const char* column :
         {"frames", "detections", "move_start_s", "settled_s", "done_s", "used"})
        header.emplace_back(column);
    for (const char* group : {"photo_", "render_", "predicted_"})
        for (const char* column : {"rx", "ry", "rz", "tx", "ty", "tz"})
            header.push_back(std::string(group) + column);
    for (const char* group : {"b1_", "b2_", "b3_", "b4_"})
        for (const char* column : {"x_mm", "y_mm", "z_mm", "rx_mrad", "ry_mrad", "rz_mrad"})
            header.push_back(std::string(group) + column);
    for (const char* column : {"residual_rms_gray", "residual_p99_gray", "psf_sigma_px"})
        header.emplace_back(column);
    return header;
}

// Photograph minus render, of hold-out poses.
void add_residual(Row& row, const std::optional<PhotoResidual>& residual) {
    row.push_back(residual ? exact(residual->rms_gray) : "");
    row.push_back(residual ? exact(residual->p99_gray) : "");
    row.push_back(residual ? exact(residual->psf_sigma_px) : "");
}

void add_analysis_columns(Row& row, const AnalysedPose& pose) {
    row.emplace_back(pose.used ? "1" : "0");
    add_six(row, pose.bias.photo);
    add_six(row, pose.bias.render);
    const Vector6d predicted = vector_from_rigid(pose.bias.predicted);
    for (int i = 0; i < 6; ++i)
        row.push_back(exact(predicted[i]));
    for (const auto bias : {&PoseBias::b1, &PoseBias::b2, &PoseBias::b3, &PoseBias::b4})
        add_bias(row, pose.bias.*bias);
}

Row csv_row(const AnalysedPose& pose, const std::vector<Axis>& axes, bool is_analysed) {
    Row row = {std::to_string(pose.index), pose.hold_out ? "hold-out" : "training"};
    for (const auto* positions : {&pose.target, &pose.read_back, &pose.read_back_deviation})
        for (std::size_t i = 0; i < axes.size(); ++i)
            row.push_back(exact((*positions)[i] * unit_of(axes[i])));
    for (std::size_t i = 0; i < axes.size(); ++i)
        row.push_back(std::to_string(pose.approach[i]));
    row.push_back(std::to_string(pose.frames.size()));
    row.push_back(std::to_string(pose.detections));
    for (const double time_s : {pose.move_start_s, pose.settled_s.value_or(0.0), pose.done_s})
        row.push_back(fmt::format("{:.6f}", time_s));
    if (is_analysed)
        add_analysis_columns(row, pose);
    else
        row.resize(row.size() + 1 + 3 * 6 + 4 * 6);
    add_residual(row, pose.residual);
    return row;
}

}  // namespace

std::string run_json(const QualifyResult& result) {
    const StationFile& station = result.station;
    Json run = {
        {"etalon", "run/1"},
        {"outcome", name(result.outcome)},
        {"reason", result.reason},
        {"started_utc", result.started_utc},
        {"duration_s", result.duration_s},
        {"sessions", sessions_json(result.sessions)},
        {"station", station.id},
        {"marker", station.marker.spec},
        {"detector", station.detector},
        {"background", station.background},
        {"white_level", station.white_level},
        {"carriage_from_marker_nominal", pose_numbers(station.carriage_from_marker_nominal)},
        {"marker_size_uncertainty", optional_number(station.marker_size_uncertainty)},
        {"marker_flatness_mm", optional_number(station.marker_flatness_mm)},
        {"environment", environment_json(result)},
        {"references", references_json(station.references)},
        {"limits", station.limits.id},
        {"due_after_days",
         station.limits.due_after_days ? Json(*station.limits.due_after_days) : Json()},
        {"inputs", inputs_json(station.inputs)},
        {"camera", camera_json(result)},
        {"stage", stage_json(station.stage)},
        {"plan", plan_json(station, result.plan)},
        {"poses_visited", result.poses.size()}};
    if (result.analysis)
        add_analysis(run, *result.analysis);
    run["mean_residual_gray"] = optional_number(mean_residual_gray(result));
    run["software"] = software_json(result.software);
    run["attachments"] = attachments_json(result.attachments);
    return text_of(run, 2) + "\n";
}

std::string poses_csv(const QualifyResult& result) {
    const std::vector<Axis>& axes = result.station.stage.axes;
    std::string csv = fmt::format("{}\n", fmt::join(csv_header(axes), ","));
    for (const AnalysedPose& pose : result.poses)
        csv +=
            fmt::format("{}\n", fmt::join(csv_row(pose, axes, result.analysis.has_value()), ","));
    return csv;
}

std::string convergence_csv(const QualifyResult& result) {
    std::string csv = "round,largest_move_px\n";
    if (!result.analysis || !result.analysis->registration)
        return csv;
    int round = 0;
    for (const double change : result.analysis->registration->changes_px)
        csv += fmt::format("{},{}\n", ++round, exact(change));
    return csv;
}

}  // namespace etalon
