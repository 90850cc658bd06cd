#include "station/setup/station_lock.h"

#include <sched.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/test.h"

namespace etalon {
namespace {

constexpr uid_t other_user = 65534;

class StationLockTest : public testing::Test {
protected:
    StationLockTest() {
        std::filesystem::permissions(folder_ / "", std::filesystem::perms::all);
        use_folder(folder_ / "");
    }
    ~StationLockTest() override { unsetenv("ETALON_LOCK_FOLDER"); }

    static void use_folder(const std::filesystem::path& folder) {
        setenv("ETALON_LOCK_FOLDER", folder.c_str(), 1);
    }

    // A stage of two axes, driven by these units.
    static StationStage stage(const std::string& host = "192.0.2.1", int port = 502, int unit = 1,
                              std::optional<int> second_unit = std::nullopt) {
        StationStage stage;
        stage.link.address = TcpAddress{host, port};
        stage.link.unit = unit;
        stage.axes.resize(2);
        stage.axes[1].unit = second_unit;
        return stage;
    }
    static StationStage serial_stage(const std::filesystem::path& device) {
        StationStage stage;
        stage.link.address = SerialPort{device.string()};
        stage.axes.resize(1);
        return stage;
    }

    static std::string refusal(const StationStage& stage) {
        return config_error_of([&] { const StationLock second(stage, "x"); });
    }

    // The refusal in another process, after `prepare` has made it somebody else's; "skipped" where
    // that is not permitted.
    template <class Prepare>
    static std::string refusal_elsewhere(const StationStage& stage, Prepare prepare) {
        std::array<int, 2> ends{};
        EXPECT_EQ(pipe(ends.data()), 0);
        const pid_t child = fork();
        if (child == 0) {
            const std::string text = prepare() ? refusal(stage) : "skipped";
            const ssize_t count = write(ends[1], text.data(), text.size());
            _exit(count < 0);
        }
        close(ends[1]);
        std::string text;
        for (char c = 0; read(ends[0], &c, 1) == 1;)
            text += c;
        close(ends[0]);
        waitpid(child, nullptr, 0);
        return text;
    }

    static bool become_other_user() { return setgid(other_user) == 0 && setuid(other_user) == 0; }
    static bool leave_network() { return unshare(CLONE_NEWNET) == 0; }

    TemporaryFolder folder_;
};

TEST_F(StationLockTest, TellsASecondOneWhoHasTheFirst) {
    const StationLock first(stage(), "a qualification by Anna");
    EXPECT_EQ(refusal(stage()), "stage 192.0.2.1:502: is in use by a qualification by Anna");
}

TEST_F(StationLockTest, EndsWithItsHolder) {
    { const StationLock first(stage(), "a qualification by somebody with a long name"); }
    const StationLock again(stage(), "short");
    EXPECT_THAT(refusal(stage()), EndsWith("is in use by short"));
}

// However its address is spelled.
TEST_F(StationLockTest, IsOneForAStageWithTwoNames) {
    const StationLock first(stage("127.0.0.1"), "a motion");
    for (const char* host : {"localhost", "127.1"})
        EXPECT_THAT(refusal(stage(host)), HasSubstr("is in use by a motion")) << host;
}

// Stages behind one gateway share its address.
TEST_F(StationLockTest, IsForTheControllersOfTheAxes) {
    const StationLock first(stage("192.0.2.1", 502, 1, 2), "a motion");
    EXPECT_THAT(refusal(stage("192.0.2.1", 502, 2)), HasSubstr("is in use"));
    EXPECT_THAT(refusal(stage("192.0.2.1", 502, 3, 1)), HasSubstr("is in use"));
    EXPECT_EQ(refusal(stage("192.0.2.1", 502, 3, 4)), "no error");
    EXPECT_EQ(refusal(stage("192.0.2.1", 503, 1)), "no error");
    EXPECT_EQ(refusal(stage("192.0.2.2", 502, 1)), "no error");
}

// A serial line has one master: its units do not matter.
TEST_F(StationLockTest, OfASerialLineIsForTheDeviceBehindAnyName) {
    std::filesystem::create_symlink("/dev/null", folder_ / "by-id");
    const StationLock first(serial_stage("/dev/null"), "a motion");
    EXPECT_THAT(refusal(serial_stage(folder_ / "by-id")), HasSubstr("is in use by a motion"));
    EXPECT_EQ(refusal(serial_stage("/dev/zero")), "no error");
    struct stat null {};
    ASSERT_EQ(stat("/dev/null", &null), 0);
    if (mknod((folder_ / "node").c_str(), S_IFCHR | 0666, null.st_rdev) != 0)
        GTEST_SKIP() << "no device node can be made here";
    EXPECT_THAT(refusal(serial_stage(folder_ / "node")), HasSubstr("is in use by a motion"));
}

TEST_F(StationLockTest, HoldsAmongTwoUsers) {
    const StationLock first(stage(), "a motion by Anna");
    const std::string other = refusal_elsewhere(stage(), become_other_user);
    if (other == "skipped")
        GTEST_SKIP() << "needs the right to become another user";
    EXPECT_THAT(other, HasSubstr("is in use by a motion by Anna"));
    EXPECT_EQ(refusal_elsewhere(stage("192.0.2.7"), become_other_user), "no error");
    const StationLock file_of_the_other(stage("192.0.2.7"), "a motion by Bert");
    EXPECT_THAT(refusal_elsewhere(stage("192.0.2.7"), become_other_user),
                HasSubstr("is in use by a motion by Bert"));
}

// As of two containers that share the folder. Only the loopback interface is another one in each.
TEST_F(StationLockTest, HoldsAmongTwoNetworkNamespaces) {
    const StationLock first(stage(), "a motion"), own(stage("127.0.0.1"), "a motion");
    const std::string other = refusal_elsewhere(stage(), leave_network);
    if (other == "skipped")
        GTEST_SKIP() << "needs the right to make a network namespace";
    EXPECT_THAT(other, HasSubstr("is in use by a motion"));
    EXPECT_EQ(refusal_elsewhere(stage("127.0.0.1"), leave_network), "no error");
}

TEST_F(StationLockTest, ThatCannotBeTakenIsAnErrorThatNamesTheWayOn) {
    use_folder(folder_ / "none");
    EXPECT_THAT(refusal(stage()), StartsWith((folder_ / "none/etalon-stage-").string()));
    EXPECT_THAT(refusal(stage()), HasSubstr(".lock: cannot be locked: No such file or directory"));
    EXPECT_THAT(refusal(stage()), HasSubstr("Set ETALON_LOCK_FOLDER to a folder that"));
    const std::string denied = refusal_elsewhere(stage(), [&] {
        std::filesystem::create_directory(folder_ / "none");
        return become_other_user();
    });
    if (denied == "skipped")
        GTEST_SKIP() << "needs the right to become another user";
    EXPECT_THAT(denied, HasSubstr(".lock: cannot be locked: Permission denied"));
}

TEST_F(StationLockTest, FollowsNoLink) {
    { const StationLock first(stage(), "a motion"); }
    const auto file = std::filesystem::directory_iterator(folder_ / "")->path();
    std::filesystem::rename(file, folder_ / "elsewhere");
    std::filesystem::create_symlink(folder_ / "elsewhere", file);
    EXPECT_THAT(refusal(stage()), HasSubstr("cannot be locked: Too many levels of symbolic links"));
}

TEST(StationLock, HolderIsNamed) {
    EXPECT_THAT(stage_holder("homing", "Carl"), StartsWith("homing by Carl since "));
    EXPECT_THAT(stage_holder("homing", "Carl"), EndsWith("process " + std::to_string(getpid())));
}

}  // namespace
}  // namespace etalon
