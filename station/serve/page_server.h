// What the page asks for and what it gets: docs/serve.md has the table. Every route is written here
// once; a path that is not in the table does not exist.
#pragma once

#include <atomic>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "station/history/run_index.h"
#include "station/serve/access.h"
#include "station/serve/latest_value.h"
#include "station/serve/run_monitor.h"
#include "station/serve/station_control.h"

namespace etalon {

// The page itself: every file of web/, read once. No request reaches the file system for one.

struct PageFile {
    std::string type, content;  // "text/css"
};

// By its path in the address: "/", "/run.js". Of the folder that was installed beside this program
// (share/etalon/web), else that of the sources that it was built from. Throws ConfigError when
// there is none.
std::map<std::string, PageFile> page_files();

class PageServer {
public:
    PageServer(AccessRules rules, Workplace workplace);
    ~PageServer();

    // Asks what goes on to end, and lets nothing more begin.
    void close() { control_.close(); }

    // Safe from every thread.
    WebReply answer(const WebRequest& request);

private:
    using Route = WebReply (PageServer::*)(const WebRequest&);
    WebReply routed(const WebRequest& request);

    WebReply session(const WebRequest& request);
    WebReply state(const WebRequest& request);
    WebReply events(const WebRequest& request);
    WebReply stage(const WebRequest& request);
    WebReply live_picture(const WebRequest& request);
    WebReply run_plan(const WebRequest& request);
    WebReply run_photo(const WebRequest& request);
    WebReply run_render(const WebRequest& request);
    WebReply fleet_runs(const WebRequest& request);
    WebReply fleet_charts(const WebRequest& request);
    WebReply fleet_cameras(const WebRequest& request);
    WebReply forecast(const WebRequest& request);
    WebReply report(const WebRequest& request);

    WebReply start_run(const WebRequest& request);
    WebReply resume_run(const WebRequest& request);
    WebReply pause_run(const WebRequest& request);
    WebReply stop(const WebRequest& request);
    WebReply home(const WebRequest& request);
    WebReply jog(const WebRequest& request);
    WebReply start_live(const WebRequest& request);
    WebReply set_live(const WebRequest& request);
    WebReply end_live(const WebRequest& request);
    WebReply find_devices(const WebRequest& request);
    WebReply start_forecast(const WebRequest& request);

    // ---- what is shown, brought up to date five times a second
    void watch(const std::stop_token& stop);
    void refresh();
    void look_at_run();
    void look_at_records();
    std::string composed_state();
    std::shared_ptr<const PosePictures> pictures(const WebRequest& request);

    AccessRules rules_;
    std::map<std::string, PageFile> files_;
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
    std::unique_ptr<RunIndex> index_;
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

}  // namespace etalon
