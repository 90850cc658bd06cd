#include "station/serve/page_server.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "report/json_text.h"
#include "station/record/run_record.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

// The page's own files and nothing else: no script in the page's text, no other server, no frame.
constexpr const char* page_policy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
// A report brings its script with it and is made from a record: it may run, but as a stranger,
// without this server's cookie and without asking anybody for anything.
constexpr const char* report_policy =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox allow-scripts";

std::string type_of(const std::filesystem::path& file) {
    static const std::map<std::string, std::string> types = {
        {".html", "text/html; charset=utf-8"},
        {".css", "text/css; charset=utf-8"},
        {".js", "text/javascript; charset=utf-8"},
        {".svg", "image/svg+xml"}};
    const auto found = types.find(file.extension().string());
    return found == types.end() ? "" : found->second;
}

WebReply json_reply(std::string json) {
    return {200, "application/json", std::move(json)};
}
WebReply json_reply(const Json& json) {
    return json_reply(text_of(json, -1));
}

WebReply jpeg_reply(const std::string& jpeg) {
    if (jpeg.empty())
        return error_reply(404, "there is no such picture");
    return {200, "image/jpeg", jpeg};
}

WebReply done() {
    return json_reply(std::string("{}"));
}

std::string field(const WebRequest& request, const std::string& name) {
    const auto found = request.fields.find(name);
    return found == request.fields.end() ? "" : found->second;
}

std::size_t number_field(const WebRequest& request, const std::string& name) {
    const auto number = parse_integer(field(request, name));
    if (!number || *number < 0 || *number > 1000000)
        throw ConfigError({name}, "must be a number");
    return static_cast<std::size_t>(*number);
}

// The keys that it must have, and no others; none: whatever it has.
JsonEntry body_of(const WebRequest& request, std::initializer_list<const char*> keys = {}) {
    const JsonEntry body(request.body, {"request", 0, ""});
    if (keys.size() > 0)
        body.require_keys(keys);
    return body;
}

std::size_t station_in(const JsonEntry& body) {
    return static_cast<std::size_t>(body.at("station").integer(0, 1000));
}

}  // namespace

std::map<std::string, PageServer::PageFile> PageServer::page_files() {
    std::map<std::string, PageFile> files;
    for (const auto& entry : std::filesystem::directory_iterator(installed_file("web")))
        if (const std::string type = type_of(entry.path()); !type.empty())
            files["/" + entry.path().filename().string()] = {type, read_text(entry.path())};
    files["/"] = files.at("/index.html");
    return files;
}

PageServer::PageServer(AccessRules rules, Workplace workplace)
    : rules_(std::move(rules)),
      files_(page_files()),
      control_(std::move(workplace)),
      index_(control_.workplace().records),
      watcher_([this](const std::stop_token& stop) { watch(stop); }) {}

// ---- routes

WebReply PageServer::answer(const WebRequest& request) {
    WebReply reply;
    if (auto link = token_link(rules_, request))
        reply = *link;
    else if (auto refused = refusal(rules_, request))
        reply = *refused;
    else
        reply = routed(request);
    if (!std::ranges::any_of(reply.headers, [](const auto& header) {
            return header.first == "Content-Security-Policy";
        }))
        reply.headers.emplace_back("Content-Security-Policy", page_policy);
    for (const auto& [name, value] : std::initializer_list<std::pair<const char*, const char*>>{
             {"X-Content-Type-Options", "nosniff"},
             {"Referrer-Policy", "no-referrer"},
             {"Cross-Origin-Resource-Policy", "same-origin"},
             {"Cache-Control", "no-store"}})
        reply.headers.emplace_back(name, value);
    return reply;
}

struct PageServer::Routes {
    using Route = std::function<WebReply(PageServer&, const WebRequest&)>;

    // Changes something, and answers only that it is done.
    static Route action(void (*change)(StationControl&, const WebRequest&)) {
        return [change](PageServer& page, const WebRequest& request) {
            change(page.control_, request);
            return done();
        };
    }

    const std::map<std::string, Route> by_request = {
        {"GET /api/session",
         [](PageServer& page, const WebRequest&) {
             return json_reply(session_json(page.control_.workplace(), page.rules_.action_token));
         }},
        {"GET /api/state",
         [](PageServer& page, const WebRequest&) {
             const auto seen = page.state_.after(0, 2s);
             return json_reply(seen ? *seen->value : "{}");
         }},
        {"GET /api/events", &PageServer::events},
        {"GET /api/stage",
         [](PageServer& page, const WebRequest& request) {
             std::string json = page.control_.stage_status(number_field(request, "station"));
             return json_reply(json.empty() ? "null" : std::move(json));
         }},
        {"GET /api/live.mjpg", &PageServer::live_picture},
        {"GET /api/run/plan", &PageServer::run_plan},
        {"GET /api/run/photo.jpg",
         [](PageServer& page, const WebRequest& request) {
             return jpeg_reply(page.pictures(request)->photo);
         }},
        {"GET /api/run/render.jpg",
         [](PageServer& page, const WebRequest& request) {
             return jpeg_reply(page.pictures(request)->render);
         }},
        {"GET /api/fleet/runs", &PageServer::fleet},
        {"GET /api/fleet/charts", &PageServer::fleet},
        {"GET /api/fleet/cameras", &PageServer::fleet},
        {"GET /api/forecast", &PageServer::forecast},
        {"GET /report", &PageServer::report},
        {"POST /api/devices", &PageServer::find_devices},
        {"POST /api/forecast", &PageServer::start_forecast},
        {"POST /api/run/start", action([](StationControl& control, const WebRequest& request) {
             const JsonEntry body = body_of(request, {"station", "serial", "operator"});
             control.start_run(station_in(body), body.at("serial").line(),
                               body.at("operator").line());
         })},
        {"POST /api/run/resume", action([](StationControl& control, const WebRequest& request) {
             const JsonEntry body = body_of(request, {"record", "operator"});
             control.resume_run(body.at("record").line(), body.at("operator").line());
         })},
        {"POST /api/run/pause",
         action([](StationControl& control, const WebRequest&) { control.pause_run(); })},
        {"POST /api/stop", action([](StationControl& control, const WebRequest& request) {
             body_of(request);
             control.stop();
         })},
        {"POST /api/stage/home", action([](StationControl& control, const WebRequest& request) {
             const JsonEntry body = body_of(request, {"station", "operator"});
             control.home(station_in(body), body.at("operator").line());
         })},
        {"POST /api/stage/jog", action([](StationControl& control, const WebRequest& request) {
             const JsonEntry body = body_of(request, {"station", "operator", "axis", "step"});
             control.jog(station_in(body), body.at("operator").line(), body.at("axis").line(),
                         body.at("step").number({-1000.0, 1000.0}));
         })},
        {"POST /api/live/start", action([](StationControl& control, const WebRequest& request) {
             control.start_live(station_in(body_of(request)));
         })},
        {"POST /api/live/set", action([](StationControl& control, const WebRequest& request) {
             const JsonEntry body = body_of(request, {"exposure_us", "gain_db"});
             const double exposure_us = body.at("exposure_us").number({1.0, 60e6});
             const double gain_db = body.at("gain_db").number({0.0, 100.0});
             const auto live = control.live();
             if (!live || live->has_ended())
                 throw NotNow("the live picture is off");
             live->set(exposure_us, gain_db);
         })},
        {"POST /api/live/end",
         action([](StationControl& control, const WebRequest&) { control.end_live(); })}};
};

WebReply PageServer::routed(const WebRequest& request) {
    static const Routes routes;
    const auto route = routes.by_request.find(request.method + " " + request.path);
    try {
        if (route != routes.by_request.end()) {
            WebReply reply = route->second(*this, request);
            if (request.method == "POST")
                refresh();  // who asks next sees what was done
            return reply;
        }
    } catch (const NotNow& error) {
        return error_reply(409, error.what());
    } catch (const ConfigError& error) {
        return error_reply(422, error.what());
    } catch (const std::exception& error) {
        return error_reply(500, error.what());
    }
    const auto file = files_.find(request.path);
    if (request.method != "GET" || file == files_.end())
        return error_reply(404, "there is no such page");
    return {200, file->second.type, file->second.content};
}

// Whoever is slow gets the newest state and misses what lay between.
WebReply PageServer::events(const WebRequest&) {
    WebReply reply{200, "text/event-stream"};
    reply.stream = [this, last = 0L](const WebSink& sink) mutable {
        const auto seen = state_.after(last, 2s);
        if (!seen)
            return sink("event: alive\ndata:\n\n");  // the page misses what it does not hear
        if (last > 0)
            dropped_ += seen->number - last - 1;
        last = seen->number;
        return sink(fmt::format("data: {}\n\n", *seen->value));
    };
    return reply;
}

WebReply PageServer::live_picture(const WebRequest&) {
    const auto live = control_.live();
    if (!live)
        return error_reply(404, "the live picture is off");
    WebReply reply{200, "multipart/x-mixed-replace; boundary=picture"};
    reply.stream = [this, live, last = 0L](const WebSink& sink) mutable {
        live->look();
        const auto seen = live->pictures().after(last, 1s);
        if (!seen)
            return !live->has_ended();
        if (last > 0)
            dropped_ += seen->number - last - 1;
        last = seen->number;
        const std::string& jpeg = seen->value->jpeg;
        if (jpeg.empty())
            return seen->value->fault.empty();
        return sink(
            fmt::format("--picture\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n",
                        jpeg.size()) +
            jpeg + "\r\n");
    };
    return reply;
}

WebReply PageServer::run_plan(const WebRequest&) {
    const auto shown = control_.state().run;
    const std::lock_guard lock(run_mutex_);
    if (!run_ || !shown)
        return json_reply(Json());
    return json_reply(
        plan_positions_json(*run_, control_.station_at(shown->station).station.stage.axes));
}

std::shared_ptr<const PosePictures> PageServer::pictures(const WebRequest& request) {
    const std::size_t index = number_field(request, "pose");
    WatchedPose pose;
    std::shared_ptr<PosePictureMaker> maker;
    {
        const std::lock_guard lock(run_mutex_);
        if (!run_ || index >= run_->state().poses.size() || !run_->state().poses[index].visited)
            throw ConfigError({"pose"}, "was not visited");
        if (!picture_maker_)
            picture_maker_ =
                std::make_shared<PosePictureMaker>(run_->record(), run_->state().inputs);
        pose = run_->state().poses[index];
        maker = picture_maker_;
    }
    return maker->of(static_cast<int>(index), pose);
}

WebReply PageServer::fleet(const WebRequest& request) {
    const std::lock_guard lock(index_mutex_);
    index_.update();
    constexpr int shown_runs = 500;
    RunFilter filter{field(request, "camera"), field(request, "station")};
    if (request.path.ends_with("/runs")) {
        filter.outcome = field(request, "outcome");
        filter.at_most = shown_runs;
        return json_reply(runs_json(index_.runs(filter)));
    }
    const std::vector<HistoricRun> runs = index_.runs(filter);
    const std::vector<QuantityHistory> charts = chart_history(runs);
    const std::vector<CameraState> states = fleet_of(runs, charts, utc_now().substr(0, 10));
    return json_reply(request.path.ends_with("/charts") ? history_json(runs, charts, states)
                                                        : fleet_json(states));
}

WebReply PageServer::report(const WebRequest& request) {
    const auto file = control_.record_named(field(request, "record")) / "report.html";
    if (!std::filesystem::is_regular_file(std::filesystem::symlink_status(file)))
        throw ConfigError({file.string()}, "is no file");
    return {200,
            "text/html; charset=utf-8",
            read_text(file),
            {{"Content-Security-Policy", report_policy}}};
}

// Opens every camera for a moment: not while one is at work.
WebReply PageServer::find_devices(const WebRequest&) {
    if (control_.state().holder.work == Work::run ||
        (control_.live() && !control_.live()->has_ended()))
        throw NotNow("the camera is at work");
    const SubprocessResult ended = run_subprocess(this_program({"devices", "--json"}));
    return ended.exit_code == 0 ? json_reply(ended.output) : error_reply(502, ended.stderr_tail);
}

// ---- what the plan will see

WebReply PageServer::start_forecast(const WebRequest& request) {
    const std::size_t station = station_in(body_of(request));
    const std::string file = control_.station_at(station).file.string();
    if (control_.state().holder.work == Work::run)
        throw NotNow("a run goes on, and needs the processor");
    const std::lock_guard lock(forecast_mutex_);
    Forecast& forecast = forecasts_[station];
    if (forecast.is_going)
        return done();
    forecast = {};
    SubprocessOptions options;
    options.on_end = [this, &forecast](const SubprocessResult& ended) {
        const std::lock_guard inner(forecast_mutex_);
        forecast.is_going = false;
        (ended.exit_code == 0 ? forecast.json : forecast.failure) =
            ended.exit_code == 0 ? ended.output : ended.stderr_tail;
    };
    forecast.program =
        std::make_unique<Subprocess>(this_program({"plan", file, "--json"}), std::move(options));
    forecast.is_going = true;
    return done();
}

WebReply PageServer::forecast(const WebRequest& request) {
    const std::lock_guard lock(forecast_mutex_);
    const std::size_t station = number_field(request, "station");
    control_.station_at(station);
    const Forecast& forecast = forecasts_[station];
    Json json = {{"going", forecast.is_going}, {"failure", forecast.failure}};
    if (!forecast.json.empty())
        json["plan"] = Json::parse(forecast.json, nullptr, false);
    return json_reply(json);
}

// ---- what is shown

void PageServer::watch(const std::stop_token& stop) {
    SteadyClock clock;
    bool was_going = false;
    for (long round = 0; !stop.stop_requested(); ++round) {
        const auto shown = control_.state().run;
        const bool is_going = shown && shown->is_going;
        try {
            if (round % 25 == 0 || is_going != was_going)
                look_at_records();
            refresh();
        } catch (const std::exception&) {  // a disk that fails must not end the page, and with it a
        }                                  // run; the next round may do
        was_going = is_going;
        clock.wait_for(200ms, stop);
    }
}

void PageServer::refresh() {
    const std::lock_guard lock(refresh_mutex_);
    look_at_run();
    std::string state = composed_state();
    if (state == last_state_)
        return;
    last_state_ = state;
    state_.put(std::move(state));
}

void PageServer::look_at_run() {
    const auto shown = control_.state().run;
    const std::lock_guard lock(run_mutex_);
    if (!shown)
        return;
    const std::filesystem::path record = control_.workplace().records / shown->name;
    if (!run_ || run_->record() != record) {
        run_ = std::make_unique<RunMonitor>(record);
        picture_maker_.reset();
        result_.clear();
    }
    try {
        run_->look();
    } catch (const ConfigError&) {  // what was read before is shown
    }
    if (shown->is_going)
        result_.clear();
    else if (result_.empty())
        result_ = text_of(result_json(record), -1);
}

void PageServer::look_at_records() {
    const std::lock_guard lock(index_mutex_);
    try {
        index_.update();
        constexpr int shown_unfinished = 20;
        std::string unfinished =
            text_of(runs_json(index_.runs({"", "", "", true, shown_unfinished})), -1);
        const std::lock_guard inner(unfinished_mutex_);
        unfinished_ = std::move(unfinished);
    } catch (const ConfigError&) {  // the next look may succeed; the fleet's view says why
    }
}

std::string PageServer::composed_state() {
    const ControlState control = control_.state();
    const std::optional<ShownRun>& shown = control.run;
    Json json = {{"work", work_json(control)}, {"run", nullptr}, {"live", nullptr}};
    {
        const std::lock_guard lock(run_mutex_);
        if (shown) {
            json["run"] = shown_run_json(*shown, run_.get());
            if (!result_.empty())
                json["run"]["result"] = Json::parse(result_, nullptr, false);
        }
    }
    {
        const std::lock_guard lock(unfinished_mutex_);
        json["unfinished"] = Json::array();
        for (const Json& run : Json::parse(unfinished_, nullptr, false))
            if (!shown || !shown->is_going || run["record"] != shown->name)
                json["unfinished"].push_back(run);
    }
    if (const auto live = control_.live()) {
        const auto seen = live->pictures().after(0, 0ms);
        json["live"] = seen ? live_json(*seen->value, dropped_) : Json::object();
        json["live"]["on"] = !live->has_ended();
    }
    return text_of(json, -1);
}

}  // namespace etalon
