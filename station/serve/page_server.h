// What the page asks for and gets: docs/serve.md. Only the routes that are written here exist.
#pragma once

#include "report/json_text.h"
#include "station/history/run_index.h"
#include "station/serve/access.h"
#include "station/serve/station_control.h"

namespace etalon {

class PageServer {
public:
    // Reads the page's files, before any request. Throws ConfigError when they are not installed.
    PageServer(AccessRules rules, Workplace workplace);

    // Asks what goes on to end, and lets nothing more begin.
    void close() { control_.close(); }

    // Safe from every thread.
    WebReply answer(const WebRequest& request);

private:
    struct Routes;
    struct PageFile {
        std::string type, content;  // "text/css"
    };
    static std::map<std::string, PageFile> page_files();

    WebReply routed(const WebRequest& request);
    WebReply events(const WebRequest& request);
    WebReply live_picture(const WebRequest& request);
    WebReply run_plan(const WebRequest& request);
    WebReply fleet(const WebRequest& request);
    WebReply report(const WebRequest& request);
    WebReply find_devices(const WebRequest& request);
    WebReply start_forecast(const WebRequest& request);
    WebReply forecast(const WebRequest& request);

    // ---- what is shown, brought up to date five times a second
    void watch(const std::stop_token& stop);
    void refresh();
    void look_at_run();
    void look_at_records();
    std::string composed_state();
    std::shared_ptr<const PosePictures> pictures(const WebRequest& request);

    AccessRules rules_;
    std::map<std::string, PageFile> files_;  // by path: "/", "/run.js"
    StationControl control_;
    std::mutex refresh_mutex_;  // of these two
    LatestValue<std::string> state_;
    std::string last_state_;
    std::atomic<long> dropped_ = 0;  // pictures and states that a slow reader missed

    std::mutex run_mutex_;  // of these three
    std::unique_ptr<RunMonitor> run_;
    std::shared_ptr<PosePictureMaker> picture_maker_;
    std::string result_;  // JSON, of a run that has ended; empty: not read yet

    std::mutex index_mutex_;  // held while records are read
    RunIndex index_;
    std::mutex unfinished_mutex_;
    std::string unfinished_ = "[]";

    struct Forecast {
        bool is_going = false;
        std::string json, failure;
        std::unique_ptr<Subprocess> program;  // last: ends first, and writes to the others
    };
    std::mutex forecast_mutex_;
    std::map<std::size_t, Forecast> forecasts_;  // by station

    std::jthread watcher_;
};

// ---- what the page is told, as JSON. Text of files, devices and persons goes out as it is: the
// page puts it into text nodes only.

// What does not change while the server lives.
Json session_json(const Workplace& workplace, const std::string& action_token);

Json work_json(const ControlState& state);
// `watch`: of the shown run; null before its log is there.
Json shown_run_json(const ShownRun& run, const RunMonitor* watch);
Json live_json(const LivePicture& picture, long dropped);
Json runs_json(const std::vector<HistoricRun>& runs);
Json plan_positions_json(const RunMonitor& watch, const std::vector<Axis>& axes);

// Verdict, quantities, findings and named cause of a run that has ended, or null.
Json result_json(const std::filesystem::path& record);

}  // namespace etalon
