// The program `etalon qualify` against the twin, killed with SIGKILL at random moments: what it had
// measured is kept, `--resume` goes on, and the end is the verdict of a run that nobody disturbed.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <csignal>
#include <nlohmann/json.hpp>

#include "core/clock.h"
#include "core/random.h"
#include "core/sha256.h"
#include "tests/loopback/program.h"
#include "tests/loopback/quick_station.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;
using Json = nlohmann::json;

constexpr int poses = quick_station_poses;
constexpr int killed = -1;  // the exit code that Program gives to the victim of a signal

class KilledRun : public testing::Test {
protected:
    KilledRun() {
        write_station(folder_, station_text);
        write_text(folder_ / "twin.yaml", quick_twin_text);
        start_twin();
    }

    // Switches the devices on anew: a GigE Vision camera stays with a dead program for 3 s, and 20
    // times that is a minute. One resumption waits for it (see below).
    void start_twin() {
        const std::string before = port_;
        if (twin_) {
            twin_->send(SIGTERM);
            twin_->exit_code();
            write_text(folder_ / "twin.yaml", replaced(quick_twin_text, "port: 0", "port: " + before));
        }
        twin_ = std::make_unique<Program>(
            "etalon-twin", std::vector<std::string>{(folder_ / "twin.yaml").string()});
        const std::string line = twin_->line();
        ASSERT_EQ(line.rfind("twin ready: stage 127.0.0.1:", 0), 0u) << line;
        port_ = line.substr(28, line.find(',') - 28);
        if (before.empty())
            write_text(folder_ / "station.yaml", quick_station(port_));
    }

    std::unique_ptr<Program> begin(const std::filesystem::path& record) const {
        return std::make_unique<Program>(
            "etalon", std::vector<std::string>{"qualify", (folder_ / "station.yaml").string(),
                                               "--out", record.string()});
    }
    static std::unique_ptr<Program> resume(const std::filesystem::path& record) {
        return std::make_unique<Program>(
            "etalon", std::vector<std::string>{"qualify", "--resume", record.string()});
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
    static void wait_for_session(const std::filesystem::path& record, int sessions) {
        for (int i = 0; i < 12000 && count(record, "session") < sessions; ++i)
            SteadyClock().wait_for(5ms, {});
    }
    static Json run_of(const std::filesystem::path& record) {
        return Json::parse(read_text(record / "run.json"));
    }

    // No pose twice, none missing, and the record is whole by its own hashes.
    static void expect_whole(const std::filesystem::path& record, int sessions) {
        const Json run = run_of(record);
        EXPECT_EQ(run["outcome"], "PASS") << run["reason"];
        EXPECT_EQ(count(record, "pose"), poses);
        EXPECT_EQ(count(record, "session"), sessions);
        EXPECT_LE(count(record, "frame"), poses + sessions - 1) << "of poses in flight";
        EXPECT_EQ(run["poses_visited"], poses);
        for (const Json& file : run["attachments"])
            EXPECT_EQ(file["sha256"], sha256_of_file(record / file["path"].get<std::string>()));
    }

    TemporaryFolder folder_;
    std::string port_;
    std::unique_ptr<Program> twin_;
};

TEST_F(KilledRun, IsGoneOnWithFromTwentyRandomMomentsAndEndsWithTheSameVerdict) {
    SteadyClock clock;
    const Instant start = clock.now();
    const std::filesystem::path undisturbed = folder_ / "undisturbed";
    {
        const auto program = begin(undisturbed);
        const std::string text = program->rest();
        ASSERT_EQ(program->exit_code(), 0) << text;
    }
    expect_whole(undisturbed, 1);
    const double duration_s = run_of(undisturbed)["duration_s"];

    RandomStream random(20, 7);
    int kills = 0, records = 0, in_analysis = 0;
    while (kills < 20) {
        const std::filesystem::path record = folder_ / fmt::format("run-{}", ++records);
        // Several kills a record, so that the test is not long. Moments are uniform over half a
        // run.
        int sessions = 1;
        auto program = begin(record);
        while (kills < 20) {
            wait_for_session(record, sessions);
            const double moment_s = 0.5 * duration_s * random.uniform();
            clock.wait_for(
                std::chrono::duration_cast<Duration>(std::chrono::duration<double>(moment_s)), {});
            program->send(SIGKILL);
            const int code = program->exit_code();
            program.reset();
            if (code != killed) {  // it was at its end
                EXPECT_EQ(code, 0);
                break;
            }
            ++kills;
            const int kept = count(record, "pose");
            in_analysis += kept == poses;
            if (kept == poses && run_of(record)["outcome"] == "PASS")  // it had only to end
                break;
            if (kept < poses && kills != 3)
                start_twin();
            program = resume(record);
            ++sessions;
        }
        if (program) {
            const std::string text = program->rest();
            EXPECT_EQ(program->exit_code(), 0) << text;
        }
        expect_whole(record, sessions);
    }
    fmt::print("20 kills in {} records, {} of them in the analysis, {:.0f} s\n", records,
               in_analysis, std::chrono::duration<double>(clock.now() - start).count());
}

}  // namespace
}  // namespace etalon
