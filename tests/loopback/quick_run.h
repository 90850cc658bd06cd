// A small qualification of a true camera over the real protocols, some seconds long: the program
// `etalon qualify` against a twin of its own. The camera's port is fixed: one at a time, or each in
// its own network (own_network.cpp).
#pragma once

#include <nlohmann/json.hpp>

#include "core/time/clock.h"
#include "tests/loopback/program.h"
#include "tests/loopback/quick_station.h"

namespace etalon {

class QuickRun : public testing::Test {
protected:
    using Json = nlohmann::json;

    QuickRun() {
        write_station(folder_, station_text);
        write_text(folder_ / "twin.yaml", quick_twin);
        start_twin();
    }

    // Switches the devices on anew, with `more` lines in the twin's file: a GigE Vision camera
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
                           {std::string(ETALON_BINARY_DIR "/etalon"), "qualify",
                            (folder_ / "station.yaml").string(), "--out", record.string()});
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
