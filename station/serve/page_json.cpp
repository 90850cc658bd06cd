#include "station/serve/page_server.h"

#include <nlohmann/json.hpp>

#include "compare/qualification/judged_quantities.h"
#include "core/program/version.h"
#include "report/json_text.h"
#include "report/result_table.h"
#include "station/setup/plan.h"

namespace etalon {
namespace {

double unit_factor(const Axis& axis) {
    return axis.kind == Axis::Kind::rotary ? deg_per_rad : 1.0;
}

Json axis_of(const Axis& axis) {
    return {{"name", axis.name},
            {"unit", axis.kind == Axis::Kind::rotary ? "deg" : "mm"},
            {"low", axis.low * unit_factor(axis)},
            {"high", axis.high * unit_factor(axis)}};
}

Json station_of(const StationSession& served) {
    const StationFile& station = served.station;
    return {{"id", station.id},
            {"file", served.file.filename().string()},
            {"camera", station.camera.uri},
            {"serial", station.camera.model.serial},
            {"stage", describe(station.stage.link)},
            {"marker", station.marker.spec},
            {"exposure_us", station.camera.settings.exposure.count()},
            {"gain_db", station.camera.settings.gain_db},
            {"poses", station.plan.poses + station.plan.repeats},
            {"axes", json_list(station.stage.axes, axis_of)}};
}

Json value_at(const Json& json, const char* key) {
    return json.is_object() && json.contains(key) ? json.at(key) : Json();
}

Json list_at(const Json& json, const char* key) {
    const Json list = value_at(json, key);
    return list.is_array() ? list : Json::array();
}

// The cause that is more probable than not, and what to do about it.
Json named_cause(const Json& run) {
    const Json ranked = list_at(value_at(run, "causes"), "ranked");
    if (ranked.empty())
        return {};
    const Json probability = value_at(ranked[0], "probability");
    if (!probability.is_number() || !(probability.get<double>() > 0.5))
        return {};
    Json remedies = Json::array();
    for (const Json& error : list_at(ranked[0], "errors"))
        if (const Json list = list_at(error, "remedies"); !list.empty())
            remedies.push_back(list[0]);
    return {{"text", value_at(ranked[0], "text")},
            {"probability", probability},
            {"remedies", remedies}};
}

}  // namespace

Json session_json(const Workplace& workplace, const std::string& action_token) {
    Json words = Json::object();
    for (const QuantityKind& kind : quantity_kinds())
        words[kind.name] = kind.words;
    return {{"version", version},
            {"quantities", words},
            {"action_token", action_token},
            {"has_calibrations", !workplace.calibrations.empty()},
            {"stations", json_list(workplace.stations, station_of)}};
}

Json work_json(const ControlState& state) {
    constexpr const char* kinds[] = {"none", "run", "homing", "motion"};  // in the order of Work
    return {{"kind", kinds[static_cast<int>(state.holder.work)]},
            {"station", state.holder.station},
            {"who", state.holder.who},
            {"since_utc", state.holder.since_utc},
            {"stop", state.stop},
            {"failure", state.failure}};
}

Json shown_run_json(const ShownRun& run, const RunMonitor* watch) {
    Json json = {{"name", run.name},      {"station", run.station},
                 {"serial", run.serial},  {"operator", run.operator_name},
                 {"going", run.is_going}, {"pausing", run.is_pausing},
                 {"said", run.said},      {"failure", run.failure},
                 {"phase", "preparing"}};
    if (!watch)
        return json;
    const RunState& seen = watch->state();
    std::string marks;  // a letter a pose: planned, seen, not seen
    for (const WatchedPose& pose : seen.poses)
        marks += !pose.visited ? '.' : pose.seen ? 'o' : 'x';
    if (run.serial.empty())
        json["serial"] = seen.camera_serial;
    json["phase"] = name(seen.phase);
    json["outcome"] = seen.outcome;
    json["reason"] = seen.reason;
    json["poses"] = seen.poses.size();
    json["marks"] = marks;
    json["latest_pose"] = seen.latest_pose;
    json["visited"] = seen.visited;
    json["seen"] = seen.seen;
    json["seconds_left"] = or_null(watch->seconds_left());
    json["corner_noise_px"] = or_null(seen.corner_noise_px);
    json["rejected_frames"] = seen.rejected_frames;
    json["remarks"] = seen.remarks;
    return json;
}

Json live_json(const LivePicture& picture, long dropped) {
    const LiveFigures& figures = picture.figures;
    return {{"exposure_us", picture.exposure_us},
            {"gain_db", picture.gain_db},
            {"per_second", figures.frames_per_second},
            {"mean", figures.mean},
            {"noise", figures.noise},
            {"saturated", figures.saturated},
            {"sharpness", figures.sharpness},
            {"bad", figures.bad},
            {"marker_seen", picture.marker_seen},
            {"marker_detail", picture.marker_detail},
            {"fault", picture.fault},
            {"dropped", dropped}};
}

Json runs_json(const std::vector<HistoricRun>& runs) {
    const ColumnsOf<HistoricQuantity> quantities = {
        {"name", &HistoricQuantity::name},   {"unit", &HistoricQuantity::unit},
        {"value", &HistoricQuantity::value}, {"u", &HistoricQuantity::expanded_uncertainty},
        {"limit", &HistoricQuantity::limit}, {"outcome", &HistoricQuantity::outcome}};
    Json list = Json::array();
    for (auto run = runs.rbegin(); run != runs.rend(); ++run)  // the latest first
        list.push_back({{"record", run->folder.filename().string()},
                        {"started_utc", run->started_utc},
                        {"outcome", run->outcome},
                        {"reason", run->reason},
                        {"operator", run->operator_name},
                        {"camera", run->camera},
                        {"station", run->station},
                        {"quantities", json_rows(table_of(quantities, run->quantities))}});
    return list;
}

Json plan_positions_json(const RunMonitor& watch, const std::vector<Axis>& axes) {
    Json poses = Json::array();
    for (const WatchedPose& pose : watch.state().poses) {
        Json target = Json::array();
        for (std::size_t i = 0; i < std::min(axes.size(), pose.target.size()); ++i)
            target.push_back(pose.target[i] * unit_factor(axes[i]));
        poses.push_back({{"target", target}, {"hold_out", pose.hold_out}});
    }
    return {{"axes", json_list(axes, axis_of)}, {"poses", poses}};
}

Json result_json(const std::filesystem::path& record) {
    try {
        const Json run = read_json(record / "run.json");
        if (!run.is_object())
            return {};
        std::error_code ignored;
        return {{"outcome", value_at(run, "outcome")},
                {"reason", value_at(run, "reason")},
                {"quantities", list_at(run, "measurements")},
                {"reasons", list_at(run, "reasons")},
                {"findings", list_at(value_at(run, "pixels"), "findings")},
                {"cause", named_cause(run)},
                {"has_report", std::filesystem::is_regular_file(record / "report.html", ignored)}};
    } catch (const ConfigError&) {
        return {};
    }
}

}  // namespace etalon
