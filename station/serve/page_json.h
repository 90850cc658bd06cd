// What the page is told, as JSON. Text of files, devices and persons goes out as it is: the page
// puts it into text nodes only.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "station/history/run_history.h"
#include "station/serve/station_control.h"

namespace etalon {

// What does not change while the server lives.
nlohmann::ordered_json session_json(const Workplace& workplace, const std::string& action_token);

nlohmann::ordered_json work_json(const ControlState& state);
// `watch`: of the shown run; null before its log is there.
nlohmann::ordered_json shown_run_json(const ShownRun& run, const RunMonitor* watch);
nlohmann::ordered_json live_json(const LivePicture& picture, long dropped);
nlohmann::ordered_json runs_json(const std::vector<HistoricRun>& runs);
nlohmann::ordered_json plan_positions_json(const RunMonitor& watch, const std::vector<Axis>& axes);

// Of a run that has ended: verdict, quantities, findings, the most probable cause and what to do,
// from its run.json. Null without one.
nlohmann::ordered_json result_json(const std::filesystem::path& record);

}  // namespace etalon
