// What becomes of a motion when the program that commanded it is killed or told to end: the real
// `etalon stage move` against a controller behind a real server.
#include <atomic>
#include <future>

#include "tests/loopback/program.h"
#include "tests/loopback/stage_rig.h"

namespace etalon {
namespace {

constexpr int interrupted = 130;  // the program's exit code

const std::string without_watchdog = R"(etalon: stage-profile/1
name: forgetful
extends: generic
watchdog: ~
)";

class KilledProgram : public testing::Test {
protected:
    // The controller of this profile, its axes homed, and the station's file.
    void start_rig(const std::string& profile) {
        rig = std::make_unique<StageRig>(2s, Wire::tcp, named_stage_profile(profile));
        rig->connect_and_home();
        write_text(station(), station_of(*rig, "  profile: " + profile + "\n"));
        rig->server->set_script([this](const ModbusRequest& request) { return watch(request); });
    }

    std::string forgetful_profile() const {
        write_text(folder / "forgetful.yaml", without_watchdog);
        return (folder / "forgetful.yaml").string();
    }

    std::filesystem::path station() const { return folder / "station.yaml"; }
    std::vector<std::string> move_to(const std::string& x) const {
        return {"stage", "move", station().string(), "x=" + x};
    }

    bool is_under_way() {
        return under_way_.get_future().wait_for(20s) == std::future_status::ready;
    }

    // Until nothing moves, but not longer than `limit`.
    Duration time_until_rest(Duration limit) {
        const Instant begin = rig->clock.now();
        while (rig->simulation.is_moving() && rig->clock.now() - begin < limit)
            rig->clock.wait_for(2ms, {});
        return rig->clock.now() - begin;
    }

    // Told to stop, and seen to rest in three polls, before the program was gone.
    void expect_stopped_and_confirmed() {
        EXPECT_FALSE(rig->simulation.is_moving());
        EXPECT_LT(rig->simulation.true_positions()[0], 600.0);
        EXPECT_EQ(rig->simulation.status()[0].alarm, 0) << "not by the watchdog";
        EXPECT_GE(polls_at_rest_, 3);
    }

    TemporaryFolder folder;
    std::unique_ptr<StageRig> rig;

private:
    // On the server's thread.
    ModbusReaction watch(const ModbusRequest& request) {
        if (!told_ && rig->is_beyond(20.0)) {
            told_ = true;
            under_way_.set_value();
        }
        stopped_ = stopped_ || gives(request, stop_bit);
        if (stopped_ && request.address == 0 && !rig->simulation.is_moving())
            ++polls_at_rest_;
        return {};
    }

    std::promise<void> under_way_;
    bool told_ = false, stopped_ = false;
    std::atomic<int> polls_at_rest_ = 0;
};

TEST_F(KilledProgram, LeavesTheAxesToTheWatchdogWhichStopsThem) {
    start_rig("generic");
    Program program("etalon", move_to("690"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(SIGKILL);
    EXPECT_EQ(program.exit_code(), -1);
    EXPECT_TRUE(rig->simulation.is_moving());
    // 1500 ms after it was last written, looked at every 10 ms; ramps of 50 ms; a busy machine.
    const Duration took = time_until_rest(5s);
    EXPECT_LT(took, 1500ms + 10ms + 50ms + 500ms);
    EXPECT_EQ(rig->simulation.status()[0].alarm, StageAlarm::watchdog);
    EXPECT_LT(rig->simulation.true_positions()[0], 600.0);
    fmt::print("killed in mid move: at rest {:.0f} ms later, {:.0f} mm before the target\n",
               std::chrono::duration<double, std::milli>(took).count(),
               690.0 - rig->simulation.true_positions()[0]);
}

TEST_F(KilledProgram, IsOutlivedByAMotionWithoutAWatchdogAndTheCheckSaysSo) {
    const std::string profile = forgetful_profile();
    start_rig(profile);
    Program program("etalon", move_to("400"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(SIGKILL);
    program.exit_code();
    time_until_rest(5s);
    EXPECT_NEAR(rig->simulation.true_positions()[0], 400.0, 1e-3) << "all the way";
    EXPECT_EQ(rig->simulation.status()[0].alarm, 0);

    Program check("etalon", {"stage", "check", profile});
    const std::string text = check.rest();
    EXPECT_NE(text.find("watchdog: none: axes that move go on when this program is killed"),
              std::string::npos)
        << text;
    EXPECT_EQ(check.exit_code(), 0);
}

// As a suspended machine is to its controller: nobody writes its watchdog.
TEST_F(KilledProgram, ThatWasOnlyFrozenFindsItsAxesStoppedAndSaysSo) {
    start_rig("generic");
    Program program("etalon", move_to("690"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(SIGSTOP);
    time_until_rest(5s);
    EXPECT_EQ(rig->simulation.status()[0].alarm, StageAlarm::watchdog);
    program.send(SIGCONT);
    const std::string text = program.rest();
    EXPECT_NE(text.find("alarm 3 (watchdog expired while moving)"), std::string::npos) << text;
    EXPECT_EQ(program.exit_code(), 4);
    EXPECT_LT(rig->simulation.true_positions()[0], 600.0);
}

TEST_F(KilledProgram, ThatWasOnlyFrozenFindsItsAxesAtTheTargetWithoutAWatchdog) {
    start_rig(forgetful_profile());
    Program program("etalon", move_to("400"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(SIGSTOP);
    time_until_rest(5s);
    program.send(SIGCONT);
    const std::string text = program.rest();
    EXPECT_NE(text.find("400.0000 mm"), std::string::npos) << text;
    EXPECT_EQ(program.exit_code(), 0);
}

class ToldToEnd : public KilledProgram, public testing::WithParamInterface<int> {};

TEST_P(ToldToEnd, StopsTheAxesAndHasItConfirmedBeforeItEnds) {
    start_rig("generic");
    Program program("etalon", move_to("690"));
    ASSERT_TRUE(is_under_way()) << program.rest();
    program.send(GetParam());
    EXPECT_EQ(program.exit_code(), interrupted);
    expect_stopped_and_confirmed();
}

INSTANTIATE_TEST_SUITE_P(Signals, ToldToEnd, testing::Values(SIGTERM, SIGINT, SIGQUIT, SIGHUP),
                         [](const auto& signal) {
                             return std::string("Sig") + sigabbrev_np(signal.param);
                         });

TEST_F(KilledProgram, StopsTheAxesAndHasItConfirmedWhenItsTerminalIsClosed) {
    start_rig("generic");
    const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    ASSERT_TRUE(grantpt(terminal) == 0 && unlockpt(terminal) == 0);
    Program program("etalon", move_to("690"), ptsname(terminal));
    ASSERT_TRUE(is_under_way());
    close(terminal);
    EXPECT_EQ(program.exit_code(), interrupted);
    expect_stopped_and_confirmed();
}

}  // namespace
}  // namespace etalon
