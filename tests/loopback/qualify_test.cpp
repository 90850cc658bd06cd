// The program `etalon qualify` against the twin over the real protocols, when something ends the
// run early: it stops in time, with its exit code, and keeps what was measured.

#include "tests/loopback/quick_run.h"

namespace etalon {
namespace {

// A run that has measured a few poses.
class InterruptedRun : public QuickRun {
protected:
    InterruptedRun() : station_(begin(record_)) { wait_for(record_, "pose", 3); }

    int rows_of_poses_csv() const {
        return static_cast<int>(split(read_text(record_ / "poses.csv"), '\n').size()) - 2;
    }
    // The exit code, which must come within this time.
    int exit_code_within(Duration limit) const {
        SteadyClock clock;
        const Instant begin = clock.now();
        const int code = station_->exit_code();
        EXPECT_LT(clock.now() - begin, limit);
        EXPECT_GE(rows_of_poses_csv(), 3);
        return code;
    }

    const std::filesystem::path record_ = folder_ / "run";
    std::unique_ptr<Program> station_;
};

TEST_F(InterruptedRun, EndsWith4AndKeepsTheRecordWhenTheTwinIsKilled) {
    twin_->send(SIGKILL);
    EXPECT_EQ(exit_code_within(10s), 4);
    EXPECT_EQ(run_of(record_)["outcome"], "ERROR");
    EXPECT_TRUE(std::filesystem::exists(record_ / "report.html"));
}

TEST_F(InterruptedRun, EndsWith4WhenTheTwinFreezes) {
    twin_->send(SIGSTOP);
    EXPECT_EQ(exit_code_within(10s), 4);
}

TEST_F(InterruptedRun, StopsTheAxesAndEndsWith130OnInterrupt) {
    station_->send(SIGINT);
    EXPECT_EQ(exit_code_within(5s), 130);
    EXPECT_THAT(read_text(record_ / "events.jsonl"),
                HasSubstr("\"axes stopped\",\"detail\":\"confirmed\""));
    EXPECT_EQ(run_of(record_)["outcome"], "ABORTED");
}

}  // namespace
}  // namespace etalon
