// `etalon serve` as a program: what strangers send to it, and runs against the twin that are
// started, looked at, stopped and gone on with over HTTP as the page does it.

#include "core/statistics/random.h"
#include "tests/loopback/quick_run.h"
#include "tests/loopback/tcp_connection.h"

namespace etalon {
namespace {

struct WebAnswer {
    int status = 0;
    std::string head, body;
};

WebAnswer answer_of(const std::string& text) {
    const std::size_t end = text.find("\r\n\r\n");
    if (end == std::string::npos || text.size() < 12)
        return {0, text, ""};
    return {std::stoi(text.substr(9, 3)), text.substr(0, end), text.substr(end + 4)};
}

class ServedPage : public QuickRun {
protected:
    ServedPage() {
        std::filesystem::create_directories(folder_ / "cameras");
        write_text(folder_ / "cameras/camera.yml", read_text(folder_ / "camera.yml"));
        begin_server();
    }
    ~ServedPage() override { end_server(SIGTERM); }

    void begin_server(const std::vector<std::string>& more = {}) {
        std::vector<std::string> arguments = {
            "serve",          (folder_ / "station.yaml").string(), "--records", records().string(),
            "--calibrations", (folder_ / "cameras").string(),      "--port",    "0"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        server_ = start_program("etalon", arguments);
        link_ = server_->line();
        ASSERT_EQ(link_.rfind("page http://127.0.0.", 0), 0u) << link_;
        web_port_ = std::stoi(link_.substr(link_.find(':', 12) + 1));
        if (link_.find("token=") == std::string::npos)
            action_ = Json::parse(get("/api/session").body)["action_token"];
    }
    void end_server(int signal) {
        server_->send(signal);
        server_->exit_code();
        server_.reset();
    }
    std::filesystem::path records() const { return folder_ / "records"; }
    std::filesystem::path record() const {
        for (const auto& entry : std::filesystem::directory_iterator(records()))
            if (entry.is_directory())
                return entry.path();
        return records() / "none";
    }

    std::string host() const { return fmt::format("127.0.0.1:{}", web_port_); }
    WebAnswer ask(const std::string& raw) const {
        TcpConnection connection(web_port_);
        connection.send(raw);
        return answer_of(connection.read_all());
    }
    std::string request(const std::string& line, const std::string& headers = "") const {
        return fmt::format("{} HTTP/1.1\r\nHost: {}\r\n{}\r\n", line, host(), headers);
    }
    WebAnswer get(const std::string& path, const std::string& headers = "") const {
        return ask(request("GET " + path, headers));
    }
    WebAnswer post(const std::string& path, const Json& body) const {
        const std::string text = body.dump();
        return ask(request("POST " + path,
                           fmt::format("Content-Type: application/json\r\nContent-Length: {}\r\n"
                                       "X-Etalon-Action: {}\r\n",
                                       text.size(), action_)) +
                   text);
    }
    Json state() const { return Json::parse(get("/api/state").body); }
    WebAnswer start_run(const std::string& who) const {
        return post("/api/run/start", {{"station", 0}, {"serial", "CAM-7"}, {"operator", who}});
    }
    void wait_for_poses(int poses) const {
        wait_until([&] { return count(record(), "pose") >= poses; });
        ASSERT_GE(count(record(), "pose"), poses);
    }
    void wait_for_end_of_run() const {
        wait_until([&] {
            const Json run = state()["run"];
            return !run["going"].get<bool>() && run.contains("result");
        });
    }

    std::unique_ptr<Program> server_;
    std::string link_, action_;
    int web_port_ = 0;
};

// ---- strangers

TEST_F(ServedPage, ShowsItsPageUnderAPolicyThatLetsNothingElseIn) {
    const WebAnswer page = get("/");
    EXPECT_EQ(page.status, 200);
    EXPECT_THAT(page.body, HasSubstr("<title>Etalon</title>"));
    EXPECT_THAT(page.head, HasSubstr("Content-Security-Policy: default-src 'none'"));
    EXPECT_THAT(page.head, HasSubstr("X-Content-Type-Options: nosniff"));
    for (const char* file : {"/page.js", "/style.css", "/strings.js"})
        EXPECT_EQ(get(file).status, 200) << file;
}

TEST_F(ServedPage, HasItsPortForItself) {
    Program second("etalon", {"serve", (folder_ / "station.yaml").string(), "--records",
                              records().string(), "--port", std::to_string(web_port_)});
    EXPECT_THAT(second.rest(), HasSubstr("cannot be listened on"));
    EXPECT_EQ(second.exit_code(), 3);
}

TEST_F(ServedPage, RefusesForeignNamesOriginsAndPosts) {
    EXPECT_EQ(ask("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n").status, 403);
    EXPECT_EQ(ask("GET / HTTP/1.1\r\n\r\n").status, 403);
    EXPECT_EQ(ask(request("GET /", "Host: evil.example\r\n")).status, 400);
    EXPECT_EQ(get("/api/state", "Sec-Fetch-Site: cross-site\r\n").status, 403);
    const std::string json = "Content-Type: application/json\r\nContent-Length: 2\r\n";
    EXPECT_EQ(ask(request("POST /api/run/pause", json) + "{}").status, 403) << "no token";
    const std::string token = "X-Etalon-Action: " + action_ + "\r\n";
    EXPECT_EQ(
        ask(request("POST /api/run/pause", json + token + "Origin: http://evil.example\r\n") + "{}")
            .status,
        403);
    EXPECT_EQ(ask(request("POST /api/run/pause",
                          token + "Content-Type: text/plain\r\nContent-Length: 2\r\n") +
                  "{}")
                  .status,
              415);
    EXPECT_EQ(post("/api/run/pause", Json::object()).status, 409) << "no run goes on";
}

TEST_F(ServedPage, NoPathReachesTheFileSystem) {
    for (const char* path :
         {"/../station.yaml", "/..%2fstation.yaml", "/%2e%2e/station.yaml", "//etc/passwd",
          "/web/../station.yaml", "/index.html/../../station.yaml", "/report?record=..",
          "/report?record=../../etc", "/report?record=..%2frecords", "/report?record=%00",
          "/report?record=", "/report?record=.etalon-index.sqlite", "/records/", "/station.yaml"}) {
        const WebAnswer answer = get(path);
        EXPECT_TRUE(answer.status == 404 || answer.status == 422) << path << " " << answer.status;
        EXPECT_THAT(answer.body, Not(HasSubstr("station/1"))) << path;
        EXPECT_THAT(answer.body, testing::ContainsRegex("\"error\": ?\"[a-z/]")) << path;
        EXPECT_THAT(answer.body, Not(HasSubstr(folder_.path().string()))) << path;
    }
}

TEST_F(ServedPage, AnswersARangeWithTheWholeBody) {
    const std::string whole = get("/page.js").body;
    ASSERT_GT(whole.size(), 1000u);
    for (const char* range :
         {"bytes=0-5", "bytes=-6", "bytes=7-", "bytes=0-1,5-9", "bytes=9999999-"}) {
        const WebAnswer answer = get("/page.js", fmt::format("Range: {}\r\n", range));
        EXPECT_EQ(answer.status, 200) << range;
        EXPECT_EQ(answer.body, whole) << range;
    }
    const WebAnswer missing = get("/nowhere", "Range: bytes=0-5\r\n");
    EXPECT_EQ(missing.status, 404);
    EXPECT_EQ(missing.body, get("/nowhere").body);
}

TEST_F(ServedPage, RefusesABodyWhoseLengthOrTypeIsNone) {
    const auto posted = [&](const std::string& type, const std::string& length) {
        return ask(request("POST /api/run/pause",
                           fmt::format("Content-Type: {}\r\nContent-Length: {}\r\n"
                                       "X-Etalon-Action: {}\r\n",
                                       type, length, action_)) +
                   "{}")
            .status;
    };
    EXPECT_EQ(posted("application/json", "2"), 409) << "no run goes on";
    EXPECT_EQ(posted("Application/JSON ; charset=utf-8", "2"), 409);
    for (const char* length : {"abc", "-2", "+2", "0x2", "2.0", "2 2", "99999999999999999999"})
        EXPECT_EQ(posted("application/json", length), 400) << length;
    for (const char* type : {"application/jsonevil", "application/json-patch", "text/json", ""})
        EXPECT_EQ(posted(type, "2"), 415) << type;
}

TEST_F(ServedPage, CutsOffWhatIsTooLarge) {
    const std::string ten_megabytes(10 << 20, 'x');
    for (const std::string& huge :
         {"GET / HTTP/1.1\r\nX-Long: " + ten_megabytes, "GET /" + ten_megabytes, ten_megabytes,
          request("POST /api/stop",
                  "Content-Type: application/json\r\nContent-Length: 10485760\r\n"
                  "X-Etalon-Action: " +
                      action_ + "\r\n") +
              ten_megabytes}) {
        TcpConnection connection(web_port_);
        connection.send(huge);
        EXPECT_THAT(connection.read_all(), Not(HasSubstr(" 200 ")));
    }
    std::string many = "GET / HTTP/1.1\r\n";
    for (int i = 0; i < 100000; ++i)
        many += fmt::format("X-{}: y\r\n", i);
    TcpConnection connection(web_port_);
    connection.send(many);
    EXPECT_THAT(connection.read_all(), Not(HasSubstr(" 200 ")));
    EXPECT_EQ(get("/").status, 200) << "it goes on";
}

// Requests with bytes changed, put in and left out. By hand with 92 000 of them: nothing was found.
TEST_F(ServedPage, OutlastsRequestsThatAreBrokenAnywhere) {
    const std::vector<std::string> whole = {
        request("GET /api/run/photo.jpg?pose=1", "Range: bytes=0-1,5-9\r\n"),
        request("GET /", "Accept-Encoding: gzip, br\r\nExpect: 100-continue\r\n"),
        request("POST /api/run/start",
                "Content-Type: application/json\r\n"
                "Transfer-Encoding: chunked\r\nX-Etalon-Action: " +
                    action_ + "\r\n") +
            "5\r\n{\"a\":\r\n0\r\n\r\n"};
    RandomStream random(7, 1);
    const auto below = [&](std::size_t size) {
        return random.bits() % std::max<std::size_t>(size, 1);
    };
    for (int i = 0; i < 600; ++i) {
        std::string broken = whole[below(whole.size())];
        for (std::size_t change = below(9); change > 0; --change) {
            const std::size_t at = below(broken.size());
            if (const std::size_t kind = below(3); kind == 0)
                broken[at] = static_cast<char>(random.bits());
            else if (kind == 1)
                broken.insert(at, 1 + below(40), static_cast<char>(random.bits()));
            else
                broken.erase(at, 1 + below(9));
        }
        TcpConnection connection(web_port_);
        connection.send(broken);
        connection.end();
        connection.read_all(100ms);
    }
    EXPECT_EQ(get("/").status, 200);
    EXPECT_EQ(state()["work"]["kind"], "none");
}

TEST_F(ServedPage, GoesOnBesideConnectionsThatStayHalfOpenAndEndsThem) {
    std::vector<TcpConnection> half_open;
    for (int i = 0; i < 150; ++i) {
        half_open.emplace_back(web_port_);
        half_open.back().send(i % 2 ? "GET / HTTP/1.1\r\nHost: " : "");
    }
    EXPECT_EQ(get("/api/state").status, 200);
    for (TcpConnection& connection : half_open)
        EXPECT_TRUE(connection.is_closed_within(8s));
}

TEST_F(ServedPage, ClosesConnectionsBeyondItsBoundAndIsBackWhenTheyAreGone) {
    {
        std::vector<TcpConnection> many;
        for (int i = 0; i < 300; ++i)
            many.emplace_back(web_port_);
        EXPECT_TRUE(many.back().is_closed_within(3s));
    }
    wait_until([&] { return get("/").status == 200; });
    EXPECT_EQ(get("/").status, 200);
}

TEST_F(ServedPage, AnotherAddressWantsTheTokenOfTheLink) {
    end_server(SIGTERM);
    begin_server({"--listen", "127.0.0.2"});
    const auto ask_there = [&](const std::string& path, const std::string& headers) {
        TcpConnection connection(web_port_, "127.0.0.2");
        connection.send(fmt::format("GET {} HTTP/1.1\r\nHost: 127.0.0.2:{}\r\n{}\r\n", path,
                                    web_port_, headers));
        return answer_of(connection.read_all());
    };
    const std::string token = link_.substr(link_.find("?token=") + 7);
    ASSERT_EQ(token.size(), 64u) << link_;
    EXPECT_EQ(ask_there("/", "").status, 401);
    EXPECT_EQ(
        ask_there("/api/session", "Authorization: Bearer " + token.substr(1) + "0\r\n").status,
        401);
    EXPECT_EQ(ask_there("/api/session", "Authorization: Bearer " + token + "\r\n").status, 200);
    EXPECT_THAT(ask_there("/?token=" + token, "").head, HasSubstr("Set-Cookie: etalon_"));
    EXPECT_EQ(ask_there("/", fmt::format("Cookie: etalon_{}={}\r\n", web_port_, token)).status,
              200);
}

// ---- runs

TEST_F(ServedPage, ARunGoesOnWhileAHundredLookAndOneIsStuck) {
    ASSERT_EQ(start_run("Anna").status, 200);
    std::vector<TcpConnection> readers;
    for (int i = 0; i < 100; ++i) {
        readers.emplace_back(web_port_);
        readers.back().send(request("GET /api/events"));
    }
    std::vector<TcpConnection> stuck;  // never read: each takes a state a time until it is full
    for (int i = 0; i < 5; ++i) {
        stuck.emplace_back(web_port_);
        stuck.back().send(request("GET /api/run/photo.jpg?pose=0") + request("GET /api/events"));
    }
    wait_until([&] { return state()["run"]["visited"] >= 3; });
    EXPECT_EQ(get("/api/run/photo.jpg?pose=2").body.substr(0, 2), "\xFF\xD8") << "a JPEG";
    EXPECT_EQ(get("/api/run/render.jpg?pose=2").body.substr(0, 2), "\xFF\xD8");
    EXPECT_EQ(get("/api/run/photo.jpg?pose=999").status, 422);
    EXPECT_EQ(Json::parse(get("/api/run/plan").body)["poses"].size(), quick_poses);
    wait_for_end_of_run();
    const Json run = state()["run"];
    EXPECT_EQ(run["result"]["outcome"], "PASS") << run;
    EXPECT_EQ(run["visited"], quick_poses);
    for (TcpConnection& reader : readers)
        EXPECT_THAT(reader.read_all(50ms), HasSubstr("\"outcome\":\"PASS\""));
    EXPECT_THAT(get("/report?record=" + record().filename().string()).head,
                HasSubstr("sandbox allow-scripts"));
    EXPECT_THAT(get("/api/fleet/runs?camera=CAM-7").body, HasSubstr("\"operator\":\"Anna\""));
    EXPECT_THAT(get("/api/fleet/cameras").body, HasSubstr("\"last_outcome\": \"PASS\""));
}

TEST_F(ServedPage, OneAtATimeAndTheSecondIsToldByWhom) {
    ASSERT_EQ(start_run("Anna").status, 200);
    wait_for_poses(1);
    const WebAnswer second = start_run("Bert");
    EXPECT_EQ(second.status, 409);
    EXPECT_THAT(second.body, HasSubstr("a run by Anna goes on"));
    EXPECT_EQ(post("/api/stage/home", {{"station", 0}, {"operator", "Bert"}}).status, 409);
    Program jog("etalon", {"stage", "jog", (folder_ / "station.yaml").string(), "x=1"});
    EXPECT_THAT(jog.rest(), HasSubstr("is in use by a qualification by Anna"));
    EXPECT_EQ(jog.exit_code(), 3);
    EXPECT_EQ(post("/api/stop", {{"station", 0}}).status, 200) << "anybody may stop";
    wait_for_end_of_run();
    wait_until([&] { return state()["work"]["stop"] == "confirmed"; });
    EXPECT_EQ(state()["work"]["stop"], "confirmed");
    EXPECT_EQ(state()["run"]["result"]["outcome"], "ABORTED");
}

// The other station's controller is switched off: its stop fails, the run's is not kept waiting.
TEST_F(ServedPage, StopsEveryStationThoughOneDoesNotAnswer) {
    end_server(SIGTERM);
    const std::string station = read_text(folder_ / "station.yaml");
    const std::string dead = replaced(station, "id: test-station", "id: dead-station");
    write_text(folder_ / "dead.yaml",
               std::regex_replace(dead, std::regex("port: [0-9]+"), "port: 1"));
    begin_server({(folder_ / "dead.yaml").string()});
    ASSERT_EQ(start_run("Anna").status, 200);
    wait_for_poses(1);
    EXPECT_EQ(post("/api/stop", Json::object()).status, 200);
    wait_for_end_of_run();
    EXPECT_EQ(state()["run"]["result"]["outcome"], "ABORTED");
    wait_until([&] { return state()["work"]["stop"] != "stopping"; });
    EXPECT_THAT(state()["work"]["stop"].get<std::string>(),
                AllOf(StartsWith("dead-station: the stage did NOT confirm that its axes stand "
                                 "still; last request: unit "),
                      EndsWith("cannot connect: Connection refused")));
}

TEST_F(ServedPage, ARecordThatWasHarmedOrLeadsElsewhereHarmsNothingElse) {
    const std::filesystem::path evil = records() / "evil";
    std::filesystem::create_directories(evil);
    write_text(evil / "events.jsonl", "\n");
    std::filesystem::create_symlink("/etc/hostname", evil / "report.html");
    EXPECT_EQ(get("/report?record=evil").status, 422);
    std::filesystem::create_directory_symlink(evil, records() / "linked");
    EXPECT_EQ(get("/report?record=linked").status, 422);
    EXPECT_EQ(
        post("/api/run/start", {{"station", 0}, {"serial", "CAM-7"}, {"operator", "Anna\x1b[2J"}})
            .status,
        422);
    EXPECT_EQ(get("/api/forecast?station=7").status, 422);
}

TEST_F(ServedPage, AKilledServerEndsItsRunWhichTheNextOneGoesOnWith) {
    ASSERT_EQ(start_run("Anna").status, 200);
    wait_for_poses(5);
    end_server(SIGKILL);
    wait_for(record(), "ABORTED", 1);  // the run heard of it and has stopped its axes
    EXPECT_EQ(count(record(), "axes stopped"), 1);
    begin_server();
    const Json unfinished = state()["unfinished"];
    ASSERT_EQ(unfinished.size(), 1u);
    // The record is let go a moment after its last line.
    wait_until([&] {
        post("/api/run/resume", {{"record", unfinished[0]["record"]}, {"operator", "Bert"}});
        wait_for_end_of_run();
        return state()["run"]["result"]["outcome"] == "PASS";
    });
    EXPECT_EQ(state()["run"]["result"]["outcome"], "PASS");
    EXPECT_EQ(count(record(), "pose"), quick_poses);
    const Json sessions = run_of(record())["sessions"];
    EXPECT_EQ(sessions.front()["operator"], "Anna");
    EXPECT_EQ(sessions.back()["operator"], "Bert");
}

TEST_F(ServedPage, StopWorksWhenTheRunItselfHangs) {
    ASSERT_EQ(start_run("Anna").status, 200);
    wait_for_poses(2);
    const int run = server_->child();
    ASSERT_GT(run, 0);
    kill(run, SIGSTOP);
    EXPECT_EQ(post("/api/stop", {{"station", 0}}).status, 200);
    wait_until([&] { return state()["work"]["kind"] == "none"; });  // killed after ten seconds
    wait_until([&] { return state()["work"]["stop"] != "stopping"; });
    EXPECT_EQ(state()["work"]["stop"], "confirmed");
    wait_for_end_of_run();
    EXPECT_EQ(state()["run"]["result"]["outcome"], "ERROR");
    EXPECT_GE(count(record(), "pose"), 2) << "what was measured is kept";
}

TEST_F(ServedPage, ADeviceThatDiesIsAnErrorThatSaysWhatWasAskedOfIt) {
    ASSERT_EQ(start_run("Anna").status, 200);
    wait_for_poses(2);
    twin_->send(SIGKILL);
    wait_for_end_of_run();
    const Json result = state()["run"]["result"];
    EXPECT_EQ(result["outcome"], "ERROR");
    EXPECT_THAT(result["reason"].get<std::string>(),
                testing::MatchesRegex("(camera|stage) .*: .+"));
    EXPECT_EQ(state()["unfinished"].size(), 1u) << "it can be gone on with";
}

TEST_F(ServedPage, TheCalibrationIsThatOfTheSerialNumberAndOfTheDevice) {
    const auto start = [&](const std::string& serial) {
        return post("/api/run/start", {{"station", 0}, {"serial", serial}, {"operator", "Anna"}});
    };
    std::ofstream(folder_ / "cameras/latin1.yml", std::ios::binary)
        << "etalon: camera/1\nserial: \"M\xFCller\"\n";
    EXPECT_THAT(start("CAM-12").body, HasSubstr("no calibration of camera CAM-12"));
    EXPECT_THAT(start("CAM-12").body, HasSubstr("skipped, as it cannot be read: latin1.yml:2"));
    EXPECT_THAT(start("CAM-12").body, Not(HasSubstr(folder_.path().string())));
    EXPECT_EQ(start("").status, 422);
    write_text(folder_ / "cameras/other.yml",
               replaced(read_text(folder_ / "camera.yml"), "CAM-7", "CAM-12"));
    EXPECT_EQ(start("CAM-12").status, 200);
    wait_until([&] { return !state()["run"]["going"].get<bool>(); });
    EXPECT_THAT(state()["run"]["failure"].get<std::string>(),
                HasSubstr("the calibration is of camera CAM-12, but genicam:127.0.0.1 is camera"));
}

TEST_F(ServedPage, ShowsAndSetsTheLivePictureUntilItIsHidden) {
    EXPECT_EQ(get("/api/live.mjpg").status, 404);
    const Json settings = {{"exposure_us", 3000}, {"gain_db", 0}};
    EXPECT_EQ(post("/api/live/set", settings).status, 409) << "nothing is live";
    EXPECT_EQ(post("/api/live/start", {{"station", 0}}).status, 200);
    TcpConnection reader(web_port_);
    reader.send(request("GET /api/live.mjpg"));
    wait_until([&] { return state()["live"].is_object() && state()["live"]["mean"] > 0.0; });
    EXPECT_EQ(state()["live"]["exposure_us"], 2000.0);
    EXPECT_EQ(post("/api/live/set", settings).status, 200);
    wait_until([&] { return state()["live"]["exposure_us"] == 3000.0; });
    EXPECT_EQ(post("/api/live/end", Json::object()).status, 200);
    EXPECT_EQ(post("/api/live/set", settings).status, 409);
    const std::string pictures = reader.read_all();
    EXPECT_THAT(pictures, HasSubstr("multipart/x-mixed-replace"));
    EXPECT_THAT(pictures, HasSubstr("\xFF\xD8\xFF"));
}

}  // namespace
}  // namespace etalon
