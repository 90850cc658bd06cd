#include "station/serve/page_server.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "capture/frame/frame_log.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "report/json_text.h"
#include "station/history/fleet.h"
#include "station/record/run_record.h"
#include "station/serve/page_json.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

std::string type_of(const Path& file) {
    const std::string kind = file.extension().string();
    if (kind == ".html")
        return "text/html; charset=utf-8";
    if (kind == ".css")
        return "text/css; charset=utf-8";
    if (kind == ".js")
        return "text/javascript; charset=utf-8";
    return kind == ".svg" ? "image/svg+xml" : "";
}

}  // namespace

std::map<std::string, PageFile> page_files() {
    std::map<std::string, PageFile> files;
    for (const auto& entry : std::filesystem::directory_iterator(installed_file("web")))
        if (const std::string type = type_of(entry.path()); !type.empty())
            files["/" + entry.path().filename().string()] = {type, read_text(entry.path())};
    files["/"] = files.at("/index.html");
    return files;
}

namespace {

using namespace std::chrono_literals;
using Json = nlohmann::ordered_json;

// The page's own files and nothing else: no script in the page's text, no other server, no frame.
constexpr const char* page_policy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
// A report brings its script with it and is made from a record: it may run, but as a stranger,
// without this server's cookie and without asking anybody for anything.
constexpr const char* report_policy =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox allow-scripts";

WebReply json_reply(const Json& json) {
    return {200, "application/json", text_of(json, -1)};
}

WebReply done() {
    return {200, "application/json", "{}"};
}

WebReply jpeg_reply(const std::string& jpeg) {
    if (jpeg.empty())
        return error_reply(404, "there is no such picture");
    return {200, "image/jpeg", jpeg};
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

JsonEntry body_of(const WebRequest& request) {
    return JsonEntry(request.body, {"request", 0, ""});
}

std::size_t station_in(const JsonEntry& body) {
    return static_cast<std::size_t>(body.at("station").integer(0, 1000));
}

}  // namespace

PageServer::PageServer(AccessRules rules, Workplace workplace)
    : rules_(std::move(rules)), files_(page_files()), control_(std::move(workplace)) {
    index_ = std::make_unique<RunIndex>(control_.workplace().records);
    watcher_ = std::jthread([this](const std::stop_token& stop) { watch(stop); });
}

PageServer::~PageServer() = default;

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

WebReply PageServer::routed(const WebRequest& request) {
    static const std::map<std::string, Route> looks = {
        {"/api/session", &PageServer::session},
        {"/api/state", &PageServer::state},
        {"/api/events", &PageServer::events},
        {"/api/stage", &PageServer::stage},
        {"/api/live.mjpg", &PageServer::live_picture},
        {"/api/run/plan", &PageServer::run_plan},
        {"/api/run/photo.jpg", &PageServer::run_photo},
        {"/api/run/render.jpg", &PageServer::run_render},
        {"/api/fleet/runs", &PageServer::fleet_runs},
        {"/api/fleet/charts", &PageServer::fleet_charts},
        {"/api/fleet/cameras", &PageServer::fleet_cameras},
        {"/api/forecast", &PageServer::forecast},
        {"/report", &PageServer::report},
    };
    static const std::map<std::string, Route> actions = {
        {"/api/run/start", &PageServer::start_run},
        {"/api/run/resume", &PageServer::resume_run},
        {"/api/run/pause", &PageServer::pause_run},
        {"/api/stop", &PageServer::stop},
        {"/api/stage/home", &PageServer::home},
        {"/api/stage/jog", &PageServer::jog},
        {"/api/live/start", &PageServer::start_live},
        {"/api/live/set", &PageServer::set_live},
        {"/api/live/end", &PageServer::end_live},
        {"/api/devices", &PageServer::find_devices},
        {"/api/forecast", &PageServer::start_forecast},
    };
    const auto& table = request.method == "POST" ? actions : looks;
    try {
        if (const auto route = table.find(request.path); route != table.end()) {
            const WebReply reply = (this->*route->second)(request);
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

WebReply PageServer::session(const WebRequest&) {
    return json_reply(session_json(control_.workplace(), rules_.action_token));
}

WebReply PageServer::state(const WebRequest&) {
    const auto seen = state_.after(0, 2s);
    return {200, "application/json", seen ? *seen->value : "{}"};
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

WebReply PageServer::stage(const WebRequest& request) {
    const std::string json = control_.stage_status(number_field(request, "station"));
    return {200, "application/json", json.empty() ? "null" : json};
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
    const auto shown = control_.shown_run();
    const std::lock_guard lock(run_mutex_);
    if (!run_ || !shown)
        return json_reply(nullptr);
    return json_reply(plan_positions_json(
        *run_, control_.workplace().stations.at(shown->station).station.stage.axes));
}

std::shared_ptr<const PosePictures> PageServer::pictures(const WebRequest& request) {
    const std::size_t index = number_field(request, "pose");
    WatchedPose pose;
    std::shared_ptr<PosePictureMaker> maker;
    {
        const std::lock_guard lock(run_mutex_);
        if (!run_ || index >= run_->poses().size() || !run_->poses()[index].visited)
            throw ConfigError({"pose"}, "was not visited");
        if (!picture_maker_)
            picture_maker_ = std::make_shared<PosePictureMaker>(run_->record(), run_->inputs());
        pose = run_->poses()[index];
        maker = picture_maker_;
    }
    return maker->of(static_cast<int>(index), pose);
}

WebReply PageServer::run_photo(const WebRequest& request) {
    return jpeg_reply(pictures(request)->photo);
}

WebReply PageServer::run_render(const WebRequest& request) {
    return jpeg_reply(pictures(request)->render);
}

WebReply PageServer::fleet_runs(const WebRequest& request) {
    const std::lock_guard lock(index_mutex_);
    index_->update();
    constexpr int shown_runs = 500;
    return json_reply(runs_json(index_->runs({field(request, "camera"), field(request, "station"),
                                              field(request, "outcome"), false, shown_runs})));
}

WebReply PageServer::fleet_charts(const WebRequest& request) {
    const std::lock_guard lock(index_mutex_);
    index_->update();
    const std::vector<HistoricRun> runs =
        index_->runs({field(request, "camera"), field(request, "station")});
    const std::vector<QuantityHistory> charts = chart_history(runs);
    return {200, "application/json",
            history_json(runs, charts, fleet_of(runs, charts, utc_now().substr(0, 10)))};
}

WebReply PageServer::fleet_cameras(const WebRequest&) {
    const std::lock_guard lock(index_mutex_);
    index_->update();
    const std::vector<HistoricRun> runs = index_->runs();
    return {200, "application/json",
            fleet_json(fleet_of(runs, chart_history(runs), utc_now().substr(0, 10)))};
}

WebReply PageServer::report(const WebRequest& request) {
    const std::filesystem::path record = control_.record_named(field(request, "record"));
    const std::filesystem::path file = record / "report.html";
    if (!std::filesystem::is_regular_file(std::filesystem::symlink_status(file)))
        throw ConfigError({file.string()}, "is no file");
    WebReply reply{200, "text/html; charset=utf-8", read_text(file)};
    reply.headers.emplace_back("Content-Security-Policy", report_policy);
    return reply;
}

// ---- what changes something

WebReply PageServer::start_run(const WebRequest& request) {
    const JsonEntry body = body_of(request);
    body.require_keys({"station", "serial", "operator"});
    control_.start_run(station_in(body), body.at("serial").text(), body.at("operator").text());
    return done();
}

WebReply PageServer::resume_run(const WebRequest& request) {
    const JsonEntry body = body_of(request);
    body.require_keys({"record", "operator"});
    control_.resume_run(body.at("record").text(), body.at("operator").text());
    return done();
}

WebReply PageServer::pause_run(const WebRequest&) {
    control_.pause_run();
    return done();
}

WebReply PageServer::stop(const WebRequest& request) {
    body_of(request);
    control_.stop();
    return done();
}

WebReply PageServer::home(const WebRequest& request) {
    const JsonEntry body = body_of(request);
    body.require_keys({"station", "operator"});
    control_.home(station_in(body), body.at("operator").text());
    return done();
}

WebReply PageServer::jog(const WebRequest& request) {
    const JsonEntry body = body_of(request);
    body.require_keys({"station", "operator", "axis", "step"});
    control_.jog(station_in(body), body.at("operator").text(), body.at("axis").text(),
                 body.at("step").number({-1000.0, 1000.0}));
    return done();
}

WebReply PageServer::start_live(const WebRequest& request) {
    control_.start_live(station_in(body_of(request)));
    return done();
}

WebReply PageServer::set_live(const WebRequest& request) {
    const JsonEntry body = body_of(request);
    body.require_keys({"exposure_us", "gain_db"});
    if (const auto live = control_.live())
        live->set(body.at("exposure_us").number({1.0, 60e6}),
                  body.at("gain_db").number({0.0, 100.0}));
    return done();
}

WebReply PageServer::end_live(const WebRequest&) {
    control_.end_live();
    return done();
}

// Opens every camera for a moment: not while one is at work.
WebReply PageServer::find_devices(const WebRequest&) {
    if (control_.holder().work == Work::run || (control_.live() && !control_.live()->has_ended()))
        throw NotNow("the camera is at work");
    const SubprocessResult ended = run_subprocess(this_program({"devices", "--json"}));
    if (ended.exit_code != 0)
        return error_reply(502, ended.stderr_tail);
    return {200, "application/json", ended.output};
}

// ---- what the plan will see

WebReply PageServer::start_forecast(const WebRequest& request) {
    const std::size_t station = station_in(body_of(request));
    if (station >= control_.workplace().stations.size())
        throw ConfigError({"station"}, "there is no such one");
    if (control_.holder().work == Work::run)
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
    const std::string file = control_.workplace().stations[station].file.string();
    forecast.program =
        std::make_unique<Subprocess>(this_program({"plan", file, "--json"}), std::move(options));
    forecast.is_going = true;
    return done();
}

WebReply PageServer::forecast(const WebRequest& request) {
    const std::lock_guard lock(forecast_mutex_);
    const std::size_t station = number_field(request, "station");
    if (station >= control_.workplace().stations.size())
        throw ConfigError({"station"}, "there is no such one");
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
        const auto shown = control_.shown_run();
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
    const auto shown = control_.shown_run();
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
        index_->update();
        RunFilter filter;
        filter.unfinished = true;
        filter.at_most = 20;
        std::string unfinished = text_of(runs_json(index_->runs(filter)), -1);
        const std::lock_guard inner(unfinished_mutex_);
        unfinished_ = std::move(unfinished);
    } catch (const ConfigError&) {  // the next look may succeed; the fleet's view says why
    }
}

std::string PageServer::composed_state() {
    Json json = {{"work", work_json(control_)}, {"run", nullptr}, {"live", nullptr}};
    const auto shown = control_.shown_run();
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
