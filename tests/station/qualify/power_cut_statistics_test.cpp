// Every state that a power cut can leave of a record. A run over mocks is watched at each fsync():
// what is in the files then may or may not be on the disk, but for what an earlier fsync() brought
// there. Of each such moment several states are made by chance (seeded): every file as it was kept
// last or as it is now, cut anywhere between, or with zeros where the disk was not reached; and the
// record is read back, some of them gone on with.
#include <sys/syscall.h>
#include <unistd.h>

#include "core/statistics/random.h"
#include "tests/station/station_of_mocks.h"

namespace {
std::function<void(const std::filesystem::path&)> before_fsync;
}

// In place of the C library's, in this program.
extern "C" int fsync(int descriptor) {
    if (before_fsync)
        before_fsync(std::filesystem::read_symlink(fmt::format("/proc/self/fd/{}", descriptor)));
    return static_cast<int>(syscall(SYS_fsync, descriptor));
}

namespace etalon {
namespace {

using Files = std::map<std::string, std::string>;  // content by path in the record

Files files_of(const std::filesystem::path& folder) {
    Files files;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
        if (entry.is_regular_file())
            files[entry.path().lexically_relative(folder).string()] = read_bytes(entry.path());
    return files;
}

// Of a moment: what is on the disk for certain, and what the programs see.
struct Moment {
    Files kept, seen;
};

// The moments of a run, before each fsync() of it.
std::vector<Moment> moments_of(StationOfMocks& mocks) {
    std::vector<Moment> moments;
    Files kept;
    before_fsync = [&](const std::filesystem::path& path) {
        const std::filesystem::path name = path.lexically_relative(mocks.record());
        if (!std::filesystem::exists(mocks.record()) || *name.begin() == "..")
            return;
        const Files seen = files_of(mocks.record());
        moments.push_back({kept, seen});
        if (const auto file = seen.find(name.string()); file != seen.end())
            kept[file->first] = file->second;
    };
    mocks.run();
    before_fsync = nullptr;
    moments.push_back({kept, files_of(mocks.record())});
    return moments;
}

// One of the ways in which a file that is `seen` may be found again when `kept` of it was brought
// to the disk; nothing: not at all. A file is kept whole or it grows at its end.
std::optional<std::string> after_cut(const std::string* kept, const std::string& seen,
                                     RandomStream& random) {
    if (kept && *kept == seen)
        return seen;
    const std::size_t least = kept && seen.starts_with(*kept) ? kept->size() : 0;
    const auto between = [&] {
        return least + static_cast<std::size_t>(random.uniform() *
                                                static_cast<double>(seen.size() - least + 1));
    };
    std::string found = seen;
    switch (static_cast<int>(5.0 * random.uniform())) {
        case 0:
            return kept ? std::optional(*kept) : std::nullopt;
        case 1:
            return seen.substr(0, between());
        case 2: {  // its length is known, and some of the content is not there
            const std::size_t from = between();
            std::fill(found.begin() + static_cast<std::ptrdiff_t>(from), found.end(), '\0');
            return found;
        }
        case 3: {  // what was written later is there, and what was written before is not
            const std::size_t until = between();
            std::fill(found.begin() + static_cast<std::ptrdiff_t>(least),
                      found.begin() + static_cast<std::ptrdiff_t>(until), '\0');
            return found;
        }
        default:
            return seen;
    }
}

void put_back(const std::filesystem::path& folder, const Moment& moment, RandomStream& random) {
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder / "frames");
    for (const auto& [name, seen] : moment.seen) {
        const auto kept = moment.kept.find(name);
        const auto found =
            after_cut(kept == moment.kept.end() ? nullptr : &kept->second, seen, random);
        std::filesystem::create_directories((folder / name).parent_path());
        if (found)
            std::ofstream(folder / name, std::ios::binary) << *found;
    }
}

std::size_t poses_in(const std::string& log) {
    std::size_t count = 0;
    for (std::size_t at = 0; (at = log.find("\"event\":\"pose\"", at)) != std::string::npos; ++at)
        ++count;
    return count;
}

std::size_t poses_kept(const Moment& moment) {
    const auto log = moment.kept.find("events.jsonl");
    return log == moment.kept.end() ? 0 : poses_in(log->second);
}

void expect_the_first_of(const std::vector<AnalysedPose>& found,
                         const std::vector<AnalysedPose>& all) {
    ASSERT_LE(found.size(), all.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
        EXPECT_EQ(found[i].readings, all[i].readings);
        ASSERT_EQ(found[i].frames.size(), all[i].frames.size());
        for (std::size_t k = 0; k < found[i].frames.size(); ++k)
            EXPECT_EQ(found[i].frames[k].sha256, all[i].frames[k].sha256);
    }
}

TEST(PowerCut, LosesAtMostThePoseInFlightAndInventsNone) {
    constexpr int states_each = 5, gone_on_with = 12;
    StationOfMocks mocks;
    const std::vector<Moment> moments = moments_of(mocks);
    const std::vector<AnalysedPose> all = mocks.read().result.poses;
    ASSERT_GE(states_each * moments.size(), 500u);
    int states = 0, unread = 0, resumed = 0;
    for (std::size_t m = 0; m < moments.size(); ++m) {
        for (int i = 0; i < states_each; ++i, ++states) {
            SCOPED_TRACE(fmt::format("moment {} of {}, state {}", m, moments.size(), i));
            RandomStream random(2026, static_cast<std::uint32_t>(m), static_cast<std::uint64_t>(i));
            put_back(mocks.record(), moments[m], random);
            const std::size_t kept = poses_kept(moments[m]);
            std::optional<RecordedRun> read;
            try {
                read = mocks.read();
            } catch (const ConfigError& error) {
                EXPECT_EQ(kept, 0u) << error.what();  // the run has not measured anything
                ++unread;
                continue;
            }
            EXPECT_GE(read->result.poses.size(), kept);
            EXPECT_LE(read->result.poses.size(), kept + 1);
            expect_the_first_of(read->result.poses, all);
            if (states % gone_on_with != 0 || read->result.outcome != RunOutcome::error)
                continue;
            EXPECT_EQ(mocks.resume().poses.size(), all.size());
            expect_the_first_of(read->result.poses, mocks.read().result.poses);
            ++resumed;
        }
    }
    EXPECT_GE(resumed, 10);
    fmt::print("{} states of {} moments, {} before anything was measured, {} gone on with\n",
               states, moments.size(), unread, resumed);
}

// ---- soak

// 20 000 poses on the virtual clock, with faults of camera and stage by chance (seeded): every run
// that a fault ends is gone on with until it is whole. What a program could lose slowly (memory,
// file descriptors, threads, time) is as after the first runs. Over the real protocols and in real
// time: tests/evidence/soak.sh.

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
