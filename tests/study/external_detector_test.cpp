// Small shell programs that answer, crash, hang and talk nonsense.
#include "study/external_detector.h"

#include "tests/test.h"

namespace etalon {
namespace {

using std::chrono::milliseconds;

constexpr const char* good_answer = R"({"camera_from_marker":[0.1,-0.2,0.3,4,-5,600],"more":[1]})";

class ExternalDetectorTest : public testing::Test {
protected:
    // A program that has the two paths in $image and $camera; $pose is a good answer.
    ExternalDetector running(const std::string& each_line,
                             milliseconds time_out = milliseconds(20000)) {
        std::ofstream(folder_ / "program") << "pose='" << good_answer << "'\n"
                                           << "tab=$(printf '\\t')\n"
                                           << "while IFS=$tab read -r image camera; do\n"
                                           << each_line << "\ndone\n";
        return {{"sh", (folder_ / "program").string()}, time_out, "--detector"};
    }

    static void expect_pose(const ExternalAnswer& answer) {
        ASSERT_TRUE(answer.camera_from_marker) << answer.failure;
        const Vector6d pose = vector_from_rigid(*answer.camera_from_marker);
        const Vector6d expected{{0.1, -0.2, 0.3, 4, -5, 600}};
        EXPECT_LT((pose - expected).norm(), 1e-12);
        EXPECT_EQ(answer.failure, "");
    }

    // The answer to an image "odd" of a program that does `what` then, and that one pose follows.
    std::string failure_of(const std::string& what, milliseconds time_out = milliseconds(20000)) {
        auto detector =
            running("if [ $image = odd ]; then " + what + "; else echo \"$pose\"; fi", time_out);
        expect_pose(detector.detect("before", "camera.yml"));
        const ExternalAnswer answer = detector.detect("odd", "camera.yml");
        EXPECT_FALSE(answer.camera_from_marker);
        expect_pose(detector.detect("after", "camera.yml"));
        return answer.failure;
    }

    TemporaryFolder folder_;
};

TEST_F(ExternalDetectorTest, GivesItsPoses) {
    auto detector = running("echo \"$pose\"");
    for (int i = 0; i < 5; ++i)
        expect_pose(detector.detect("image.png", "camera.yml"));
}

TEST_F(ExternalDetectorTest, IsToldBothPathsAndTellsItsOwnFailures) {
    auto detector = running("printf '{\"failure\":\"%s and %s\"}\\n' \"$image\" \"$camera\"");
    const ExternalAnswer answer = detector.detect("an image.png", "the camera.yml");
    EXPECT_FALSE(answer.camera_from_marker);
    EXPECT_EQ(answer.failure, "an image.png and the camera.yml");
}

TEST_F(ExternalDetectorTest, IsRunOnceForAllImages) {
    auto detector = running("n=$((n + 1)); echo \"{\\\"failure\\\":\\\"$n\\\"}\"");
    EXPECT_EQ(detector.detect("a", "c").failure, "1");
    EXPECT_EQ(detector.detect("b", "c").failure, "2");
}

TEST_F(ExternalDetectorTest, ThatEndsIsStartedAgain) {
    EXPECT_EQ(failure_of("exit 7"), "the program ended with exit code 7");
    EXPECT_THAT(failure_of("kill -SEGV $$"), StartsWith("the program was ended by signal 11"));
    EXPECT_EQ(failure_of("exec >&- <&-; sleep 60"), "the program has closed its output");
}

// What it has started must end with it: the sleeping child holds the output open.
TEST_F(ExternalDetectorTest, ThatIsSilentForTooLongIsStartedAgain) {
    EXPECT_EQ(failure_of("sleep 60", milliseconds(2000)), "no answer within 2000 ms");
}

TEST_F(ExternalDetectorTest, ThatTalksNonsenseIsStartedAgain) {
    constexpr const char* none = "the answer is neither a pose nor a failure";
    for (const char* answer :
         {"hello", "", "[1,2,3,4,5,6]", "{}", R"({"camera_from_marker":[1,2,3,4,5]})",
          R"({"camera_from_marker":[1,2,3,4,5,"6"]})",
          R"({"camera_from_marker":[1,2,3,4,5,1e999]})", R"({"camera_from_marker":null})",
          R"({"failure":3})", R"({"failure":"cut off)"})
        EXPECT_EQ(failure_of(std::string("echo '") + answer + "'"), none) << answer;
    EXPECT_EQ(failure_of("printf '%s\\n%s\\n' \"$pose\" \"$pose\""),
              "the answer is more than one line");
    EXPECT_THAT(failure_of("head -c 200000 /dev/zero | tr '\\0' x"), HasSubstr("longer than"));
}

// A second line that comes late would be taken for the next image's answer.
TEST_F(ExternalDetectorTest, ThatSaysMoreThanItIsAskedIsStartedAgain) {
    const std::filesystem::path said = folder_ / "said";
    auto detector = running(
        "echo \"$pose\"; [ $image = twice ] && { sleep 0.1; echo '{\"failure\":\"late\"}'; : >" +
        said.string() + "; }");
    expect_pose(detector.detect("twice", "c"));
    for (int i = 0; i < 1000 && !std::filesystem::exists(said); ++i)
        SteadyClock().wait_for(milliseconds(5), {});
    ASSERT_TRUE(std::filesystem::exists(said));
    expect_pose(detector.detect("once", "c"));
}

TEST_F(ExternalDetectorTest, ThatNeverReadsFailsEveryTimeInTime) {
    ExternalDetector detector({"sleep", "60"}, milliseconds(150), "--detector");
    for (int i = 0; i < 2; ++i)
        EXPECT_EQ(detector.detect("a", "c").failure, "no answer within 150 ms");
}

TEST_F(ExternalDetectorTest, ThatDoesNotExistIsAnErrorAtOnce) {
    EXPECT_THROW(ExternalDetector({"/nowhere/detector"}, milliseconds(100), "--detector"),
                 ConfigError);
    EXPECT_THROW(ExternalDetector({}, milliseconds(100), "--detector"), ConfigError);
}

TEST_F(ExternalDetectorTest, RefusesPathsThatNoLineCanTell) {
    auto detector = running("echo \"$pose\"");
    EXPECT_THROW(detector.detect("a\tb", "c"), ConfigError);
    EXPECT_THROW(detector.detect("a", "c\nd"), ConfigError);
    expect_pose(detector.detect("a", "c"));
}

}  // namespace
}  // namespace etalon
