// The program `etalon qualify` against the twin, killed with SIGKILL at random moments: what it had
// measured is kept, `--resume` goes on, and the end is the verdict of a run that nobody disturbed.

#include "core/file/sha256.h"
#include "core/statistics/random.h"
#include "tests/loopback/quick_run.h"

namespace etalon {
namespace {

constexpr int killed = -1;  // the exit code that Program gives to the victim of a signal

class KilledRun : public QuickRun {
protected:
    // No pose twice, none missing, and the record is whole by its own hashes.
    static void expect_whole(const std::filesystem::path& record, int sessions) {
        const Json run = run_of(record);
        EXPECT_EQ(run["outcome"], "PASS") << run["reason"];
        EXPECT_EQ(count(record, "pose"), quick_poses);
        EXPECT_EQ(count(record, "session"), sessions);
        EXPECT_LE(count(record, "frame"), quick_poses + sessions - 1) << "of poses in flight";
        EXPECT_EQ(run["poses_visited"], quick_poses);
        for (const Json& file : run["attachments"])
            EXPECT_EQ(file["sha256"], sha256_of_file(record / file["path"].get<std::string>()));
    }
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
            wait_for(record, "session", sessions);
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
            in_analysis += kept == quick_poses;
            if (kept == quick_poses && run_of(record)["outcome"] == "PASS")  // it had only to end
                break;
            if (kept < quick_poses && kills != 3)  // one waits for the camera; 20 take a minute
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
