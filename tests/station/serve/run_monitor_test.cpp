#include "station/serve/run_monitor.h"

#include "tests/station/station_of_mocks.h"

namespace etalon {
namespace {

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

}  // namespace
}  // namespace etalon
