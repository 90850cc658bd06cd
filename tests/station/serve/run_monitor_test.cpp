#include "station/serve/run_monitor.h"

#include "station/serve/access.h"
#include "station/serve/page_server.h"
#include "station/serve/station_control.h"
#include "tests/paths.h"
#include "tests/station/station_of_mocks.h"

namespace etalon {
namespace {

using Texts = std::map<std::string, std::string>;

class WatchedRun : public testing::Test {
protected:
    WatchedRun() {  // of a marker that is seen once: measured as any, analysed in no time
        result_ = mocks_.run();
        log_ = read_text(mocks_.record() / log_file);
    }
    // The log as far as it was written at some moment.
    void write(std::size_t bytes) const {
        std::filesystem::create_directories(mocks_.folder / "watched");
        std::ofstream(mocks_.folder / "watched" / log_file, std::ios::binary)
            << log_.substr(0, bytes);
    }
    std::filesystem::path watched() const { return mocks_.folder / "watched"; }

    StationOfMocks mocks_;
    QualifyResult result_;
    std::string log_;
};

void expect_end(const RunMonitor& watch, const QualifyResult& result) {
    EXPECT_EQ(watch.state().phase, RunPhase::ended);
    EXPECT_EQ(watch.state().outcome, name(result.outcome));
    ASSERT_EQ(watch.state().poses.size(), result.plan.poses.size());
    EXPECT_EQ(watch.state().visited, static_cast<int>(result.poses.size()));
    const auto seen = std::ranges::count_if(result.poses, &VisitedPose::detections);
    EXPECT_EQ(watch.state().seen, seen);
    EXPECT_EQ(watch.state().latest_pose, result.poses.back().index);
    EXPECT_EQ(watch.state().camera_serial, "CAM-7");
    for (const VisitedPose& pose : result.poses) {
        const WatchedPose& watched = watch.state().poses[static_cast<std::size_t>(pose.index)];
        EXPECT_EQ(watched.target, pose.target);
        EXPECT_EQ(watched.photo, first_whole(pose)->file);
        EXPECT_EQ(watched.corners, pose.corners);
    }
}

TEST_F(WatchedRun, TellsWhatTheRunItselfTells) {
    RunMonitor watch(mocks_.record());
    EXPECT_TRUE(watch.look());
    expect_end(watch, result_);
    EXPECT_FALSE(watch.look()) << "nothing new";
}

TEST_F(WatchedRun, ComesToTheSameInWhateverPiecesTheLogArrives) {
    RunMonitor watch(watched());
    EXPECT_FALSE(watch.look()) << "there is no log yet";
    int poses = 0;
    for (std::size_t bytes = 1; bytes < log_.size(); bytes += 997) {
        write(bytes);
        watch.look();
        EXPECT_GE(watch.state().visited, poses);
        poses = watch.state().visited;
    }
    write(log_.size());
    watch.look();
    expect_end(watch, result_);
}

TEST_F(WatchedRun, KnowsThePhaseAndTheTimeLeft) {
    RunMonitor watch(watched());
    EXPECT_FALSE(watch.seconds_left());
    write(log_.find('\n') + 1);
    watch.look();
    EXPECT_EQ(watch.state().phase, RunPhase::preparing);
    const double expected_s = std::chrono::duration<double>(result_.plan.expected_duration).count();
    EXPECT_DOUBLE_EQ(*watch.seconds_left(), expected_s) << "before anything was measured";
    std::size_t at = 0;
    for (int i = 0; i < 10; ++i)
        at = log_.find("\"event\":\"pose\"", at + 1);
    write(log_.find('\n', at) + 1);
    watch.look();
    EXPECT_EQ(watch.state().phase, RunPhase::measuring);
    const double per_pose_s = (result_.poses[9].done_s - result_.poses[0].move_start_s) / 10;
    EXPECT_NEAR(*watch.seconds_left(), 15 * per_pose_s, 0.1 * per_pose_s);
}

TEST_F(WatchedRun, PassesOverTheFramesOfAPoseThatAKilledProgramDidNotFinish) {
    const std::size_t begin = log_.find('\n') + 1;
    const std::string session = log_.substr(begin, log_.find('\n', begin) + 1 - begin);
    ASSERT_TRUE(has(session, "\"event\":\"session\""));
    const std::size_t frame = log_.find("{\"t\":", log_.find("\"event\":\"frame\"") - 40);
    const std::size_t pose = log_.rfind('\n', log_.find("\"event\":\"pose\"")) + 1;
    const std::string frames = log_.substr(frame, pose - frame);
    RunMonitor undisturbed(mocks_.record()), killed(watched());
    log_.insert(pose, session + frames);
    log_ = replaced(log_, "\"corners\":[[", "\"corners\":[[9");  // the first ones are far off
    write(log_.size());
    undisturbed.look();
    killed.look();
    EXPECT_EQ(killed.state().poses[0].photo, undisturbed.state().poses[0].photo);
    EXPECT_EQ(killed.state().corner_noise_px, undisturbed.state().corner_noise_px);
}

// Of a file that somebody else wrote: an error, not a crash and not a number.
TEST_F(WatchedRun, RefusesALogThatNoRunWrote) {
    std::filesystem::create_directories(watched());
    for (const char* line :
         {"{\"t\":0,\"event\":\"pose\",\"pose\":3}\n", "[]\n", "{\n", "{\"t\":0}\n"}) {
        write_text(watched() / log_file, line);
        RunMonitor watch(watched());
        EXPECT_THROW(watch.look(), ConfigError) << line;
    }
}

// ---- access

constexpr const char *secret = "4f6b", *action = "9a1c";

AccessRules rules_with(const std::string& token) {
    return {token, action, {"localhost"}};
}

WebRequest asked(const std::string& method, const std::string& path) {
    return {.method = method,
            .path = path,
            .host = "127.0.0.1:7530",
            .local_address = "127.0.0.1",
            .local_port = 7530};
}

WebRequest post_of_own_page() {
    WebRequest request = asked("POST", "/api/run/start");
    request.origin = "http://127.0.0.1:7530";
    request.fetch_site = "same-origin";
    request.action_token = action;
    return request;
}

// 200: it may pass.
int status_of(const AccessRules& rules, const WebRequest& request) {
    const auto refused = refusal(rules, request);
    return refused ? refused->status : 200;
}

TEST(Access, PassesItsOwnPageByEveryNameOfTheServer) {
    WebRequest request = asked("GET", "/");
    for (const char* host : {"127.0.0.1:7530", "localhost:7530", "LocalHost:7530"}) {
        request.host = host;
        EXPECT_EQ(status_of(rules_with(""), request), 200) << host;
    }
    EXPECT_EQ(status_of(rules_with(""), post_of_own_page()), 200);
}

TEST(Access, RefusesAForeignNameThatLeadsHere) {
    WebRequest request = asked("GET", "/");
    for (const char* host : {"", "evil.example:7530", "127.0.0.1", "127.0.0.1:7531", "localhost",
                             "127.0.0.1:7530.evil.example", "LOCALHOST.evil:7530"}) {
        request.host = host;
        EXPECT_EQ(status_of(rules_with(""), request), 403) << host;
    }
}

TEST(Access, TakesAnAddressOfTheSixthVersionInBrackets) {
    WebRequest request = asked("GET", "/");
    request.local_address = "::1";
    request.host = "[::1]:7530";
    EXPECT_EQ(status_of(rules_with(""), request), 200);
}

TEST(Access, RefusesAPostWithoutTheTokenOfThePage) {
    WebRequest request = post_of_own_page();
    for (const char* token : {"", "9a1d", "9a1", "9a1cc"}) {
        request.action_token = token;
        EXPECT_EQ(status_of(rules_with(""), request), 403) << token;
    }
}

TEST(Access, RefusesAPostOfAnotherSiteEvenWithTheToken) {
    for (const char* origin : {"http://evil.example", "null", "https://127.0.0.1:7530",
                               "http://127.0.0.1:7531", "http://127.0.0.1:7530.evil.example"}) {
        WebRequest request = post_of_own_page();
        request.origin = origin;
        EXPECT_EQ(status_of(rules_with(""), request), 403) << origin;
    }
    for (const char* site : {"cross-site", "same-site"}) {
        WebRequest request = post_of_own_page();
        request.fetch_site = site;
        EXPECT_EQ(status_of(rules_with(""), request), 403) << site;
    }
}

TEST(Access, RefusesAPictureThatAnotherSiteShows) {
    WebRequest request = asked("GET", "/api/live.mjpg");
    request.fetch_site = "cross-site";
    EXPECT_EQ(status_of(rules_with(""), request), 403);
}

TEST(Access, HasNoOtherMethods) {
    for (const char* method : {"HEAD", "PUT", "DELETE", "OPTIONS", "TRACE"})
        EXPECT_EQ(status_of(rules_with(""), asked(method, "/")), 405) << method;
}

TEST(Access, WantsTheTokenInAnAuthorizationOrACookieWhereOneIsSet) {
    WebRequest request = asked("GET", "/");
    EXPECT_EQ(status_of(rules_with(secret), request), 401);
    request.authorization = "Bearer 4f6b";
    EXPECT_EQ(status_of(rules_with(secret), request), 200);
    for (const char* wrong : {"Bearer 4f6c", "Bearer", "Bearer ", "4f6b", "Basic 4f6b"}) {
        request.authorization = wrong;
        EXPECT_EQ(status_of(rules_with(secret), request), 401) << wrong;
    }
    request.authorization.clear();
    request.cookie = "a=b; etalon_7530=4f6b";
    EXPECT_EQ(status_of(rules_with(secret), request), 200);
    for (const char* wrong : {"etalon_7530=4f6", "etalon_7531=4f6b", "etalon_7530="}) {
        request.cookie = wrong;
        EXPECT_EQ(status_of(rules_with(secret), request), 401) << wrong;
    }
}

TEST(Access, TheLinkWithTheTokenBecomesACookieThatScriptsDoNotSee) {
    WebRequest request = asked("GET", "/");
    request.fields["token"] = secret;
    const auto reply = token_link(rules_with(secret), request);
    ASSERT_TRUE(reply);
    EXPECT_EQ(reply->status, 303);
    EXPECT_EQ(reply->headers[0].second, "/");
    EXPECT_THAT(
        reply->headers[1].second,
        AllOf(HasSubstr("etalon_7530=4f6b"), HasSubstr("HttpOnly"), HasSubstr("SameSite=Strict")));
    request.fields["token"] = "4f6c";
    EXPECT_FALSE(token_link(rules_with(secret), request));
    EXPECT_FALSE(token_link(rules_with(""), request)) << "where no token is set";
    request.fields["token"] = "";
    EXPECT_FALSE(token_link(rules_with(""), request));
}

TEST(Access, TokensAreLongAndNeverTheSame) {
    const std::string token = random_token();
    EXPECT_EQ(token.size(), 64u);
    EXPECT_NE(token, random_token());
    EXPECT_TRUE(is_same_secret(token, token));
    EXPECT_FALSE(is_same_secret("", "")) << "no secret is none";
}

// ---- calibration folder

class CalibrationFolder : public testing::Test {
protected:
    CalibrationFolder() {
        write_station(folder_);  // a station and limits lie there too, and CAM-7's calibration
        write_text(folder_ / "other.yaml", replaced(camera_text, "CAM-7", "CAM-12"));
    }
    std::string refusal(const std::string& serial) const {
        return config_error_of([&] { calibration_of(folder_ / ".", serial); });
    }

    TemporaryFolder folder_;
};

TEST_F(CalibrationFolder, GivesTheFileWithTheSerialNumber) {
    EXPECT_EQ(calibration_of(folder_ / ".", "CAM-7").filename(), "camera.yml");
    EXPECT_EQ(calibration_of(folder_ / ".", "CAM-12").filename(), "other.yaml");
}

TEST_F(CalibrationFolder, NamesThoseThatAreThereWhereNoneFits) {
    EXPECT_THAT(refusal("CAM-1"),
                HasSubstr("no calibration of camera CAM-1; there are those of CAM-7, CAM-12"));
    EXPECT_THAT(refusal(""), HasSubstr("no calibration of camera "));
    EXPECT_THAT(refusal("../camera"), HasSubstr("no calibration"));
}

TEST_F(CalibrationFolder, RefusesTwoOfOneCamera) {
    write_text(folder_ / "second.yml", camera_text);
    EXPECT_THAT(refusal("CAM-7"), HasSubstr("camera.yml and second.yml are both of camera CAM-7"));
}

TEST_F(CalibrationFolder, SkipsAndNamesWhatCannotBeRead) {
    write_text(folder_ / "broken.yml", "etalon: camera/1\nserial: [");
    std::ofstream(folder_ / "latin1.yml", std::ios::binary)
        << "etalon: camera/1\nserial: \"M\xFCller\"\n";
    EXPECT_EQ(calibration_of(folder_ / ".", "CAM-7").filename(), "camera.yml");
    const std::vector<std::string> skipped = read_calibrations(folder_ / ".").skipped;
    ASSERT_EQ(skipped.size(), 2u) << "the station and its limits are no trouble";
    EXPECT_THAT(skipped[0], HasSubstr("broken.yml:"));
    EXPECT_THAT(skipped[1], HasSubstr("latin1.yml:2"));
    EXPECT_THAT(refusal("CAM-1"), HasSubstr("; skipped, as it cannot be read: " + skipped[0] +
                                            "; " + skipped[1]));
}

TEST(Access, AnErrorTellsNoFolderOfTheServer) {
    const auto told = [](const std::string& text) {
        return nlohmann::json::parse(error_reply(422, text).body)["error"].get<std::string>();
    };
    EXPECT_EQ(told("/home/anna/cameras/a.yml:3: serial: twice"), "a.yml:3: serial: twice");
    EXPECT_EQ(told("/home/anna/cameras/: has no calibration"), "cameras/: has no calibration");
    EXPECT_EQ(told("cannot open [/srv/runs/x] or \"/srv/y\""), "cannot open [x] or \"y\"");
    EXPECT_EQ(told("v4l2:/dev/video0: 5 mm / s and/or 3"), "v4l2:/dev/video0: 5 mm / s and/or 3");
    EXPECT_EQ(told(std::string(60000, '/')).size(), 60000u);
}

// ---- page text

// The page's files as texts: what no browser is needed for.

const std::filesystem::path web = std::filesystem::path(ETALON_SOURCE_DIR) / "web";

std::vector<std::smatch> all(const std::string& text, const std::string& pattern) {
    const std::regex expression(pattern);
    return {std::sregex_iterator(text.begin(), text.end(), expression), {}};
}

// The entries `key: 'text'` of one language.
Texts texts_of(const std::string& language) {
    static const std::string file = read_text(web / "strings.js");
    const std::size_t begin = file.find("\n  " + language + ": {");
    const std::string part = file.substr(begin, file.find("\n  },", begin) - begin);
    Texts texts;
    for (const std::smatch& entry : all(part, "(\\w+): '([^']*)'"))
        EXPECT_TRUE(texts.emplace(entry[1], entry[2]).second) << entry[1] << " is there twice";
    return texts;
}

std::multiset<std::string> places_in(const std::string& text) {
    std::multiset<std::string> places;
    for (const std::smatch& place : all(text, "\\{(\\w+)\\}"))
        places.insert(place[1]);
    return places;
}

TEST(PageText, IsThereInBothLanguagesWithTheSamePlaces) {
    const Texts english = texts_of("en"), german = texts_of("de");
    ASSERT_GT(english.size(), 100u);
    for (const auto& [key, text] : english) {
        ASSERT_TRUE(german.contains(key)) << key << " is not there in German";
        EXPECT_EQ(places_in(text), places_in(german.at(key))) << key;
        EXPECT_FALSE(text.empty() || german.at(key).empty()) << key;
    }
    EXPECT_EQ(english.size(), german.size());
}

TEST(PageText, HasEveryTextThatThePageShowsAndNoOther) {
    const Texts english = texts_of("en");
    std::string page;
    for (const auto& file : std::filesystem::directory_iterator(web))
        if (file.path().filename() != "strings.js")
            page += read_text(file.path());
    std::set<std::string> shown;
    for (const char* pattern : {"text\\('(\\w+)'", "data-(?:text|label)=\"(\\w+)\"",
                                "text\\([^()]* \\? '(\\w+)'", "text\\([^()]* : '(\\w+)'"})
        for (const std::smatch& use : all(page, pattern))
            shown.insert(use[1]);
    for (const std::string& key : shown)
        EXPECT_TRUE(english.contains(key)) << key << " is shown";
    // Made from a word: text(`phase_${...}`).
    std::vector<std::string> beginnings;
    for (const std::smatch& use : all(page, "text\\(`(\\w+_)\\$\\{"))
        beginnings.push_back(use[1]);
    for (const auto& [key, text] : english) {
        const bool is_made = std::any_of(beginnings.begin(), beginnings.end(),
                                         [key = key](const auto& begin) { return key.starts_with(begin); });
        EXPECT_TRUE(is_made || shown.contains(key)) << key << " is shown nowhere";
    }
}

// What comes from a file, a device or a person must never become part of the page's code.
TEST(PageText, NothingIsParsedAsHtmlOrLoadedFromElsewhere) {
    for (const auto& file : std::filesystem::directory_iterator(web)) {
        const std::string text = read_text(file.path());
        EXPECT_THAT(text, Not(testing::ContainsRegex(
                              "innerHTML|outerHTML|insertAdjacentHTML|document\\.write|eval\\(|"
                              "new Function|style=|srcdoc|javascript:")))
            << file.path();
        for (const std::smatch& address : all(text, "https?://[^\"' )]*"))
            EXPECT_TRUE(address.str().starts_with("http://www.w3.org/")) << address.str();
    }
}

// A record may have been written by anybody: what is of another type is left out, and no word of it
// keeps the rest of the state from the page.
TEST(PageJson, TakesFromADamagedRecordWhatIsWhole) {
    const TemporaryFolder folder;
    write_text(folder / "run.json",
               R"({"outcome": "FAIL", "reasons": 7, "measurements": {}, "pixels": [],
                   "causes": {"ranked": [{"text": "k1", "probability": "0.9"}]}})");
    const nlohmann::ordered_json result = result_json(folder.path());
    EXPECT_EQ(result["outcome"], "FAIL");
    for (const char* list : {"reasons", "quantities", "findings"})
        EXPECT_EQ(result[list], nlohmann::ordered_json::array()) << list;
    EXPECT_TRUE(result["cause"].is_null());
    for (const char* text : {"[]", "{", ""}) {
        write_text(folder / "run.json", text);
        EXPECT_TRUE(result_json(folder.path()).is_null()) << text;
    }
}

}  // namespace
}  // namespace etalon
