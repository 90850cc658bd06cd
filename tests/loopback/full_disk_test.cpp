// Programs that record on a disk that becomes full: a file system of 1 MB of their own.

#include <nlohmann/json.hpp>

#include "tests/loopback/gige_rig.h"

namespace etalon {
namespace {

constexpr int cannot_be_mounted = 77;

// `etalon` with its record on a disk of 1 MB.
class FullDisk : public testing::Test {
protected:
    FullDisk() {
        std::filesystem::create_directory(disk_);
        std::filesystem::create_directory(copy_);
    }

    // Its exit code. Skips the test where nothing can be mounted.
    int run(const std::vector<std::string>& arguments) {
        std::vector<std::string> command{"1m", disk_, copy_, ETALON_BINARY_DIR "/etalon"};
        command.insert(command.end(), arguments.begin(), arguments.end());
        Program program(ETALON_SOURCE_DIR "/tests/loopback/on_small_disk.sh", command);
        printed_ = program.rest();
        const int code = program.exit_code();
        if (code == cannot_be_mounted)
            [this] { GTEST_SKIP() << printed_; }();
        return code;
    }
    std::filesystem::path left(const std::string& name) const {
        return std::filesystem::path(copy_) / "record" / name;
    }

    TemporaryFolder folder_;
    const std::string disk_ = (folder_ / "disk").string(), copy_ = (folder_ / "copy").string(),
                      out_ = disk_ + "/record";
    std::string printed_;
};

// A camera of 60 kB a frame.
TEST_F(FullDisk, EndsACaptureWith4AndKeepsTheFramesThatFitted) {
    GigeRig rig({.width = 300, .height = 200});
    const int code = run(
        {"capture", "--camera", "genicam:127.0.0.1", "--frames", "500", "--out", out_, "--live"});
    if (IsSkipped())
        return;
    EXPECT_EQ(code, 4);
    EXPECT_THAT(printed_, HasSubstr(".png: cannot be written: No space left on device"));

    SteadyClock clock;
    const auto replay = open_camera("files:" + left("").string(), {}, clock);
    replay->configure({});
    replay->arm();
    int whole = 0;
    for (; std::filesystem::exists(left(fmt::format("frames/{:06}.png", whole))); ++whole)
        EXPECT_TRUE(same(replay->frame_after(clock.now(), 0, {}).image.pixels, rig.shown().pixels));
    EXPECT_GE(whole, 10);
    EXPECT_LT(whole, 18);
    EXPECT_THROW(replay->frame_after(clock.now(), 0, {}), DeviceError) << "more than was written";
    const auto record = nlohmann::json::parse(read_text(left("capture.json")));
    EXPECT_THAT(record["reason"].get<std::string>(), HasSubstr("No space left on device"));
}

TEST_F(FullDisk, EndsAQualificationWith4AndKeepsThePosesThatFitted) {
    const std::string demo = ETALON_SOURCE_DIR "/examples/demo";
    Program twin("etalon-twin", {demo + "/twin.yaml"});
    ASSERT_THAT(twin.line(), HasSubstr("twin ready"));
    const int code = run({"qualify", demo + "/station.yaml", "--out", out_});
    if (IsSkipped())
        return;
    EXPECT_EQ(code, 4) << printed_;
    EXPECT_THAT(printed_, HasSubstr("cannot be written: No space left on device"));
    EXPECT_THAT(printed_, HasSubstr("the record of this run is in " + out_));

    const auto record = nlohmann::json::parse(read_text(left("run.json")));
    EXPECT_EQ(record["outcome"], "ERROR");
    const std::string log = read_text(left("events.jsonl"));
    EXPECT_THAT(log, HasSubstr("\"axes stopped\",\"detail\":\"confirmed\""));
    EXPECT_THAT(log, HasSubstr("\"event\":\"pose\""));
    SteadyClock clock;
    const auto replay = open_camera("files:" + left("").string(), {}, clock);
    replay->configure({});
    replay->arm();
    EXPECT_EQ(replay->frame_after(clock.now(), 0, {}).status, FrameStatus::complete);
}

}  // namespace
}  // namespace etalon
