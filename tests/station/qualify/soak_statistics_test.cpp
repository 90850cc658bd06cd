// 20 000 poses on the virtual clock, with faults of camera and stage by chance (seeded): every run
// that a fault ends is gone on with until it is whole. What a program could lose slowly (memory,
// file descriptors, threads, time) is as after the first runs. Over the real protocols and in real
// time: tests/evidence/soak.sh.

#include "core/statistics/random.h"
#include "tests/station/station_of_mocks.h"

namespace etalon {
namespace {

struct Held {
    long resident_kib = 0, threads = 0;
    long descriptors = 0;
};

Held held_now() {
    Held held;
    std::ifstream status("/proc/self/status");
    for (std::string key; status >> key;) {
        if (key == "VmRSS:")
            status >> held.resident_kib;
        if (key == "Threads:")
            status >> held.threads;
    }
    held.descriptors = std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
    return held;
}

constexpr int poses_a_run = 400, runs = 50, first_runs = 10;

std::string soaked_station() {
    std::string text = replaced(station_text, "poses: 25", fmt::format("poses: {}", poses_a_run));
    return replaced(text, "frames: 2", "frames: 1");
}

class Soak : public testing::Test {
protected:
    Soak() : mocks_(soaked_station()) {
        mocks_.before_move = [this](std::size_t) {
            if (happens(1.0 / 300))
                throw DeviceError("stage fake", "move", "no answer");
            if (happens(1.0 / 500))
                mocks_.stop.request_stop();
        };
        mocks_.on_status = [this](std::vector<AxisStatus>& axes) {
            if (happens(1.0 / 20000))
                axes.back().alarm = 21;
        };
        mocks_.on_camera = [this](FakeCamera& camera) {
            const std::array bad{FrameStatus::corrupt, FrameStatus::short_frame};
            for (int i = 0; i < 2 * poses_a_run; ++i)
                camera.script.push_back(happens(0.03) ? bad[happens(0.5)] : FrameStatus::complete);
            camera.triggers_left = static_cast<int>(700.0 * random_.uniform());
            if (happens(0.3))
                camera.lose_once();
        };
    }

    bool happens(double probability) { return random_.uniform() < probability; }

    // Goes on until the run is whole; how often that was.
    int run_until_whole() {
        std::filesystem::remove_all(mocks_.record());
        mocks_.carriage.clear();
        mocks_.first_target.clear();
        int sessions = 0;
        for (std::size_t poses = 0; poses < poses_a_run; ++sessions) {
            const Instant before = mocks_.clock.now();
            mocks_.stop = {};
            const QualifyResult result = sessions == 0 ? mocks_.run() : mocks_.resume();
            const std::chrono::duration<double> elapsed = mocks_.clock.now() - before;
            EXPECT_NEAR(result.duration_s - result.sessions.back().start_s, elapsed.count(), 1e-6);
            EXPECT_GE(result.poses.size(), poses) << "lost";
            poses = result.poses.size();
            EXPECT_NE(result.outcome, RunOutcome::pass);
        }
        return sessions;
    }

    RandomStream random_{2026, 5};
    StationOfMocks mocks_;
};

TEST_F(Soak, LosesNothingOver20000PosesWithFaultsByChance) {
    Held first;
    int sessions = 0;
    for (int run = 0; run < runs; ++run) {
        sessions += run_until_whole();
        if (run + 1 == first_runs)
            first = held_now();
    }
    const Held last = held_now();
    EXPECT_LT(last.resident_kib, first.resident_kib + 20 * 1024);
    EXPECT_EQ(last.descriptors, first.descriptors);
    EXPECT_EQ(last.threads, first.threads);
    fmt::print("{} poses in {} sessions; {} KiB after {} runs, {} KiB after {}\n",
               runs * poses_a_run, sessions, first.resident_kib, first_runs, last.resident_kib,
               runs);
}

}  // namespace
}  // namespace etalon
