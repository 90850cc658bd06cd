// A small qualification of a true camera over the real protocols, some seconds long: the program
// `etalon qualify` against a twin of its own. The camera's port is fixed: one at a time, or each in
// its own network (own_network.cpp).
#pragma once

#include <nlohmann/json.hpp>

#include "core/time/clock.h"
#include "tests/loopback/program.h"
#include "tests/station/stations.h"

namespace etalon {

// The station of the unit tests, fast and small, and its twin over the real protocols: a run
// takes two seconds, and ends with PASS.

constexpr int quick_poses = 24;

inline const char* const quick_twin = R"(etalon: twin/1
seed: 7
stage:
  port: 0
  axes:
    - {name: x, kind: linear, direction: [1, 0, 0], travel: [-70, 60], speed: 2000}
    - {name: y, kind: linear, direction: [0, 1, 0], travel: [-50, 55], speed: 2000}
    - {name: z, kind: linear, direction: [0, 0, 1], travel: [-80, 90], speed: 2000}
    - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0],
       travel_deg: [-190, 190], speed_deg: 3000}
camera:
  calibration: camera.yml
  nominal_exposure_us: 2500
scene:
  marker: "apriltag:36h11:5@60mm"
  background: 0.7
  camera_from_base: {rotation_deg: [1.7, -1.1, 0.6], translation_mm: [4, -6, 330]}
  carriage_from_marker: {rotation_deg: [20.5, -0.4, 0.7], translation_mm: [5.3, -7.2, 11.5]}
)";

// The station of the unit tests, fast and small, at the port that the twin has taken.
inline std::string quick_station(const std::string& port) {
    std::string text = replaced(station_text, "port: 1599, unit: 2", "port: " + port);
    for (const auto& [what, by] : std::vector<std::pair<std::string, std::string>>{
             {"speed: 100,", "speed: 2000,"},
             {"speed: 90,", "speed: 2000,"},
             {"speed: 80,", "speed: 2000,"},
             {"speed_deg: 120,", "speed_deg: 3000,"},
             {"white_level: 0.9", "white_level: 0.8"},
             {"poses: 25", fmt::format("poses: {}", quick_poses)},
             {"hold_out: 0.6", "hold_out: 0.625"},
             {"frames: 2", "frames: 1"},
             {"settle_ms: 40", "settle_ms: 5"}})
        text = replaced(text, what, by);
    return text;
}

class QuickRun : public testing::Test {
protected:
    using Json = nlohmann::json;

    QuickRun() {
        write_station(folder_, station_text);
        write_text(folder_ / "twin.yaml", quick_twin);
        start_twin();
    }

    // Switches the devices on again, with `more` lines in the twin's file: a GigE Vision camera
    // stays with a dead program for 3 s.
    void start_twin(const std::string& more = "") {
        const std::string before = port_;
        if (twin_) {
            twin_->send(SIGTERM);
            twin_->exit_code();
            write_text(folder_ / "twin.yaml",
                       replaced(quick_twin, "port: 0", "port: " + before) + more);
        }
        twin_ = start_program("etalon-twin", {(folder_ / "twin.yaml").string()});
        twin_ready_ = twin_->line();
        ASSERT_EQ(twin_ready_.rfind("twin ready: stage 127.0.0.1:", 0), 0u) << twin_ready_;
        port_ = twin_ready_.substr(28, twin_ready_.find(',') - 28);
        if (before.empty())
            write_text(folder_ / "station.yaml", quick_station(port_));
    }

    // `environment`: further variables, "TZ=UTC".
    std::unique_ptr<Program> begin(const std::filesystem::path& record,
                                   std::vector<std::string> environment = {}) const {
        environment.insert(environment.end(),
                           {built_program("etalon"), "qualify", (folder_ / "station.yaml").string(),
                            "--out", record.string()});
        return start_program("/usr/bin/env", environment);
    }
    static std::unique_ptr<Program> resume(const std::filesystem::path& record) {
        return start_program("etalon", {"qualify", "--resume", record.string()});
    }

    // The lines of this event that are whole.
    static int count(const std::filesystem::path& record, const std::string& event) {
        const std::filesystem::path log = record / "events.jsonl";
        if (!std::filesystem::exists(log))
            return 0;
        std::vector<std::string> lines = split(read_text(log), '\n');
        lines.pop_back();
        return static_cast<int>(
            std::count_if(lines.begin(), lines.end(), [&](const std::string& line) {
                return line.find("\"event\":\"" + event + "\"") != std::string::npos;
            }));
    }
    // For a minute at most.
    static void wait_until(const std::function<bool()>& happened) {
        for (int i = 0; i < 12000 && !happened(); ++i)
            SteadyClock().wait_for(std::chrono::milliseconds(5), {});
    }
    static void wait_for(const std::filesystem::path& record, const std::string& event, int times) {
        wait_until([&] { return count(record, event) >= times; });
    }
    static Json run_of(const std::filesystem::path& record) {
        return Json::parse(read_text(record / "run.json"));
    }

    TemporaryFolder folder_;
    std::string port_, twin_ready_;  // of the stage; the line that the twin has printed
    std::unique_ptr<Program> twin_;
};

}  // namespace etalon
