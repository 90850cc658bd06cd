// What becomes of a motion when the program that commanded it is killed or told to end: the real
// `etalon stage move` against a controller behind a real server.
#include <fcntl.h>

#include <atomic>
#include <future>

#include "core/file/text.h"
#include "tests/loopback/program.h"
#include "tests/loopback/stage_rig.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr int interrupted = 130;  // the program's exit code

// A program of its own session in a terminal of its own, as under sshd.
class TerminalProgram {
public:
    TerminalProgram(const std::string& name, std::vector<std::string> arguments)
        : master_(posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)) {
        EXPECT_TRUE(grantpt(master_) == 0 && unlockpt(master_) == 0);
        std::string program = (std::filesystem::path(ETALON_BINARY_DIR) / name).string();
        std::vector<char*> argv{program.data()};
        for (std::string& argument : arguments)
            argv.push_back(argument.data());
        argv.push_back(nullptr);
        posix_spawnattr_t attributes;
        posix_spawnattr_init(&attributes);
        posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID);
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        // A session's leader that opens a terminal gets it for its own.
        posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, ptsname(master_), O_RDWR, 0);
        posix_spawn_file_actions_adddup2(&actions, STDIN_FILENO, STDOUT_FILENO);
        posix_spawn_file_actions_adddup2(&actions, STDIN_FILENO, STDERR_FILENO);
        EXPECT_EQ(posix_spawn(&process_, argv[0], &actions, &attributes, argv.data(), environ), 0);
        posix_spawn_file_actions_destroy(&actions);
        posix_spawnattr_destroy(&attributes);
    }
    ~TerminalProgram() {
        close_terminal();
        if (process_ > 0) {
            kill(process_, SIGKILL);
            exit_code();
        }
    }
    TerminalProgram(const TerminalProgram&) = delete;
    TerminalProgram& operator=(const TerminalProgram&) = delete;

    void close_terminal() {
        if (master_ >= 0)
            close(master_);
        master_ = -1;
    }
    int exit_code() {
        int status = 0;
        waitpid(process_, &status, 0);
        process_ = 0;
        return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    }

private:
    int master_;
    pid_t process_ = 0;
};

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
        std::ofstream(station())
            << "etalon: station/1\nstage:\n  profile: " << profile
            << "\n  link: {host: 127.0.0.1, port: " << rig->server->port() << "}\n  axes:\n"
            << "    - {name: x, kind: linear, direction: [1, 0, 0], travel: [-7, 700], speed: "
               "200}\n"
            << "    - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0],\n"
            << "       travel_deg: [-57, 114], speed_deg: 114}\n";
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
    TerminalProgram program("etalon", move_to("690"));
    ASSERT_TRUE(is_under_way());
    program.close_terminal();
    EXPECT_EQ(program.exit_code(), interrupted);
    expect_stopped_and_confirmed();
}

}  // namespace
}  // namespace etalon
