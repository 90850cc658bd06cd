// `etalon capture` as its user sees it, with a GigE Vision camera on loopback.
#include <nlohmann/json.hpp>

#include "station/devices/commands.h"
#include "tests/loopback/gige_rig.h"
#include "tests/station/built_program.h"

namespace etalon {
namespace {

GigeCameraOptions options_of_12_bits() {
    return {.width = 68, .height = 41, .bits = 12};
}

TEST(CaptureCommand, RecordsFramesOfACameraWithItsSettings) {
    GigeRig rig(options_of_12_bits());
    TemporaryFolder folder;
    const std::string out = (folder / "record").string();
    Program program("etalon",
                    {"capture", "--camera", "genicam:127.0.0.1", "--format", "Mono12p",
                     "--exposure-us", "7000", "--gain-db", "3", "--black-level", "5", "--set",
                     "AcquisitionFrameRate=40", "--frames", "6", "--out", out, "--live"});
    const std::string printed = program.rest();
    EXPECT_EQ(program.exit_code(), 0) << printed;
    EXPECT_THAT(printed, HasSubstr("captured 6 frames\nnoise 0.000 DN\nrecord " + out));
    EXPECT_THAT(printed, HasSubstr("fps  mean"));
    const auto record = nlohmann::json::parse(read_text(out + "/capture.json"));
    const auto& settings = record["camera"]["settings"];
    EXPECT_EQ(settings["format"], "Mono12p");
    EXPECT_EQ(settings["bits"], 12);
    EXPECT_EQ(settings["exposure_us"], 7000);
    EXPECT_EQ(settings["gain_db"], 3.0);
    EXPECT_EQ(settings["black_level"], 5.0);
    EXPECT_EQ(settings["trigger"], "Software");
    EXPECT_EQ(settings["controls"]["AcquisitionFrameRate"], 40.0);
    EXPECT_EQ(record["camera"]["serial"], "TWIN");
    EXPECT_TRUE(same(read_image(out + "/frames/000005.png").pixels, rig.shown().pixels));
}

TEST(CaptureCommand, ShowsFramesLiveUntilItIsInterrupted) {
    GigeRig rig(options_of_12_bits());
    Program program("etalon", {"capture", "--camera", "genicam:127.0.0.1", "--live"});
    std::string line = program.line();
    while (line.find("fps") == std::string::npos && !line.empty())
        line = program.line();
    EXPECT_THAT(line, HasSubstr("mean"));
    program.send(SIGINT);
    const std::string rest = program.rest();
    EXPECT_THAT(rest, HasSubstr("captured "));
    EXPECT_EQ(program.exit_code(), 0) << rest;
}

TEST(CaptureCommand, EndsWithFourWhenTheCameraRefuses) {
    GigeRig rig(options_of_12_bits());
    TemporaryFolder folder;
    Program program("etalon", {"capture", "--camera", "genicam:127.0.0.1", "--gain-db", "11",
                               "--frames", "2", "--out", (folder / "record").string()});
    EXPECT_THAT(program.rest(), HasSubstr("set gain 11 dB"));
    EXPECT_EQ(program.exit_code(), 4);
}

// ---- a camera that is killed meanwhile

// `etalon capture` of a powered camera, when its first frame has been taken.
class CaptureOfAPoweredCamera : public testing::Test {
protected:
    void start(int frames) {
        power_.switch_on(1);
        capture_ =
            start_program("etalon", {"capture", "--camera", "genicam:127.0.0.1", "--bits", "12",
                                     "--frames", fmt::to_string(frames), "--out", out_, "--live"});
        EXPECT_THAT(capture_->line(), HasSubstr("fps"));
    }

    // How many frames of the record show each of the pictures 1 and 2, and nothing else.
    std::array<int, 2> pictures_in_the_record() const {
        SteadyClock clock;
        const auto replay = open_camera("files:" + out_, {}, clock);
        replay->configure({.bits = PoweredCamera::bits});
        replay->arm();
        std::array<int, 2> found{};
        const int complete = record()["frames_complete"];
        while (found[0] + found[1] < complete) {
            const Frame frame = replay->frame_after(clock.now(), 0, {});
            if (frame.status != FrameStatus::complete)
                continue;
            const bool second = !same(frame.image.pixels, PoweredCamera::shown(1).pixels);
            if (second && !same(frame.image.pixels, PoweredCamera::shown(2).pixels)) {
                ADD_FAILURE() << "frame " << frame.id << " is none of the camera's pictures";
            }
            ++found[second];
        }
        return found;
    }
    nlohmann::json record() const {
        return nlohmann::json::parse(read_text(out_ + "/capture.json"));
    }

    TemporaryFolder folder_;
    const std::string out_ = (folder_ / "record").string();
    PoweredCamera power_;
    std::unique_ptr<Program> capture_;
};

TEST_F(CaptureOfAPoweredCamera, GoesOnWhenTheCameraIsBack) {
    start(300);
    power_.cut_power();
    power_.switch_on(2);
    const std::string printed = capture_->rest();
    EXPECT_EQ(capture_->exit_code(), 0) << printed;
    EXPECT_THAT(printed, HasSubstr("captured 300 frames"));
    EXPECT_EQ(record()["camera"]["reconnects"], 1);
    const auto [before, after] = pictures_in_the_record();
    EXPECT_GT(before, 0);
    EXPECT_GT(after, 0);
    EXPECT_THAT(read_text(out_ + "/events.jsonl"), HasSubstr("\"camera reconnected\""));
}

TEST_F(CaptureOfAPoweredCamera, EndsWith4AndAReadableRecordWhenItStaysAway) {
    start(2000);
    power_.cut_power();
    const std::string printed = capture_->rest();
    EXPECT_EQ(capture_->exit_code(), 4);
    EXPECT_THAT(printed, HasSubstr("etalon: camera genicam:127.0.0.1: "));
    EXPECT_THAT(printed, HasSubstr("the camera is lost"));
    const int complete = record()["frames_complete"];
    EXPECT_THAT(printed, HasSubstr(fmt::format("captured {} frames\n", complete)));
    EXPECT_LT(complete, 2000);
    EXPECT_EQ(pictures_in_the_record()[0], complete);
    EXPECT_THAT(read_text(out_ + "/events.jsonl"), HasSubstr("\"camera not reconnected\""));
}

// ---- devices command

std::string printed(bool json) {
    const Finished done = finished([&] { return run_devices({.json = json}); });
    EXPECT_EQ(done.exit_code, 0);
    return done.out;
}

TEST(DevicesCommand, NamesWhatIsThereAndWhatIsLeftOutAndWhy) {
    const GigeCamera camera({.serial = "SN-75"},
                            [](const CaptureSettings&) { return CodeImage{}; });
    const std::string table = printed(false);
    for (const char* words :
         {"genicam           yes  Aravis", "genicam:Aravis-Fake-SN-75  Aravis Fake, serial SN-75",
          "Mono12p       12 bits  1x1 to 512x384",
          "ExposureTime          10000 us    10 to 10000000",
          "GainAuto              Off         Off, Continuous", "files             yes", "v4l2 ",
          "libcamera ", "leadshine-icl-rs  yes  Modbus TCP"})
        EXPECT_NE(table.find(words), std::string::npos) << words << " is missing in\n" << table;
    for (const std::string& line : split(table, '\n'))
        EXPECT_LT(line.size(), 80u) << line;
}

TEST(DevicesCommand, PrintsTheSameAsJson) {
    const GigeCamera camera({.serial = "SN-75"},
                            [](const CaptureSettings&) { return CodeImage{}; });
    const nlohmann::json json = nlohmann::json::parse(printed(true));
    EXPECT_EQ(json.at("etalon"), "devices/1");
    const nlohmann::json genicam = json.at("camera_backends").at(0);
    EXPECT_EQ(genicam.at("name"), "genicam");
    EXPECT_EQ(genicam.at("built_in"), true);
    EXPECT_EQ(genicam.at("cameras").at(0).at("serial"), "SN-75");
    const nlohmann::json fake = genicam.at("cameras").at(0);
    EXPECT_EQ(fake.at("fault"), "");
    EXPECT_EQ(fake.at("formats").at(5).at("name"), "Mono12p");
    EXPECT_EQ(fake.at("formats").at(5).at("bits"), 12);
    EXPECT_EQ(fake.at("formats").at(5).at("sizes").at(0).at("largest").at(1), 384);
    bool listed = false;
    for (const nlohmann::json& control : fake.at("controls"))
        listed = listed || (control.at("name") == "BlackLevel" && control.at("high") == 255.0);
    EXPECT_TRUE(listed);
    EXPECT_EQ(json.at("stage_profiles").at(0), "generic");
}

TEST(DevicesCommand, SaysWhyACameraTellsNothingOfItself) {
    const GigeCamera camera({}, [](const CaptureSettings&) { return CodeImage{}; });
    SteadyClock clock;
    const auto user = open_camera("genicam:127.0.0.1", {}, clock);
    EXPECT_NE(printed(true).find("controlled by another program"), std::string::npos);
}

// ---- full disk

// Programs that record on a disk that becomes full: a file system of 1 MB of their own.

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
        std::vector<std::string> command{"1m", disk_, copy_, built_program("etalon")};
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
