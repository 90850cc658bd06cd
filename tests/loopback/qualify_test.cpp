// The program `etalon qualify` against the twin over the real protocols, when something ends the
// run early: it stops in time, with its exit code, and keeps what was measured.

#include "core/file/text.h"
#include "core/time/clock.h"
#include "tests/loopback/program.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

// A run of the demo's station that has measured a few poses.
class InterruptedRun : public testing::Test {
protected:
    InterruptedRun() {
        EXPECT_EQ(twin_.line().rfind("twin ready", 0), 0u);
        station_ = std::make_unique<Program>(
            "etalon", std::vector<std::string>{"qualify", demo_ + "/station.yaml", "--out",
                                               record_.string()});
        while (poses_logged() < 3) {
            const std::string line = station_->line();
            if (line.empty())
                break;
        }
    }

    int poses_logged() const {
        if (!std::filesystem::exists(record_ / "events.jsonl"))
            return 0;
        int poses = 0;
        for (const std::string& line : split(read_text(record_ / "events.jsonl"), '\n'))
            poses += line.find("\"event\":\"pose\"") != std::string::npos;
        return poses;
    }
    int rows_of_poses_csv() const {
        return static_cast<int>(split(read_text(record_ / "poses.csv"), '\n').size()) - 2;
    }

    // Waits for the station's end; its exit code, and how long that took.
    int exit_code_within(Duration limit) {
        SteadyClock clock;
        const Instant begin = clock.now();
        const int code = station_->exit_code();
        EXPECT_LT(clock.now() - begin, limit);
        return code;
    }

    const std::string demo_ = ETALON_SOURCE_DIR "/examples/demo";
    const TemporaryFolder folder_;
    const std::filesystem::path record_ = folder_ / "run";
    Program twin_{"etalon-twin", {demo_ + "/twin.yaml"}};
    std::unique_ptr<Program> station_;
};

TEST_F(InterruptedRun, EndsWith4AndKeepsTheRecordWhenTheTwinIsKilled) {
    ASSERT_GE(poses_logged(), 3);
    twin_.send(SIGKILL);
    EXPECT_EQ(exit_code_within(10s), 4);
    EXPECT_GE(rows_of_poses_csv(), 3);
    EXPECT_NE(read_text(record_ / "run.json").find("\"outcome\": \"ERROR\""), std::string::npos);
    EXPECT_TRUE(std::filesystem::exists(record_ / "report.html"));
}

TEST_F(InterruptedRun, EndsWith4WhenTheTwinFreezes) {
    ASSERT_GE(poses_logged(), 3);
    twin_.send(SIGSTOP);
    EXPECT_EQ(exit_code_within(10s), 4);
    EXPECT_GE(rows_of_poses_csv(), 3);
}

TEST_F(InterruptedRun, StopsTheAxesAndEndsWith130OnInterrupt) {
    ASSERT_GE(poses_logged(), 3);
    station_->send(SIGINT);
    EXPECT_EQ(exit_code_within(5s), 130);
    EXPECT_GE(rows_of_poses_csv(), 3);
    const std::string log = read_text(record_ / "events.jsonl");
    EXPECT_NE(log.find("\"axes stopped\",\"detail\":\"confirmed\""), std::string::npos);
    EXPECT_NE(read_text(record_ / "run.json").find("\"outcome\": \"ABORTED\""), std::string::npos);
}

}  // namespace
}  // namespace etalon
