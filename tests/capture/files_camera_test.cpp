#include "capture/files_camera.h"

#include <opencv2/imgcodecs.hpp>

#include "capture/camera_recovery.h"
#include "tests/fakes/fake_camera.h"
#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

class FilesCameraTest : public testing::Test {
protected:
    void add(const std::string& file, int width, int height, int type, int value) {
        ASSERT_TRUE(cv::imwrite((folder_ / file).string(),
                                cv::Mat(height, width, type, cv::Scalar::all(value))));
    }

    std::unique_ptr<Camera> armed(const CaptureSettings& settings = {}) {
        auto camera = open_files_camera(folder_.path(), clock_);
        camera->configure(settings);
        camera->arm();
        return camera;
    }

    int next_value(Camera& camera) {
        const Frame frame = camera.frame_after(clock_.now(), 0, {});
        EXPECT_EQ(frame.status, FrameStatus::complete);
        return frame.image.pixels.depth() == CV_8U ? frame.image.pixels.at<std::uint8_t>(0, 0)
                                                   : frame.image.pixels.at<std::uint16_t>(0, 0);
    }

    TemporaryFolder folder_;
    VirtualClock clock_;
};

TEST_F(FilesCameraTest, ShowsTheImagesInTheOrderOfTheirNamesAndThenFails) {
    add("b.png", 7, 5, CV_8UC1, 20);
    add("c.tif", 7, 5, CV_8UC1, 30);
    add("a.PNG", 7, 5, CV_8UC1, 10);
    std::ofstream(folder_ / "notes.txt") << "no image";
    auto camera = armed();
    EXPECT_EQ(next_value(*camera), 10);
    EXPECT_EQ(next_value(*camera), 20);
    EXPECT_EQ(next_value(*camera), 30);
    EXPECT_THROW(camera->frame_after(clock_.now(), 5, {}), DeviceError);
    EXPECT_EQ(camera->statistics().delivered, 3);
}

TEST_F(FilesCameraTest, SaysTheSizeOfTheRecording) {
    add("a.png", 7, 5, CV_8UC1, 10);
    const CaptureSettings settings = open_files_camera(folder_.path(), clock_)->configure({});
    EXPECT_EQ(settings.width, 7);
    EXPECT_EQ(settings.height, 5);
    EXPECT_EQ(settings.bits, 8);
}

TEST_F(FilesCameraTest, KeepsAll16BitsOfARecording) {
    add("a.png", 7, 5, CV_16UC1, 51234);
    auto camera = armed({.bits = 16});
    EXPECT_EQ(next_value(*camera), 51234);
}

TEST_F(FilesCameraTest, DeliversAFrameThatBeganAfterTheMomentAskedFor) {
    add("a.png", 7, 5, CV_8UC1, 10);
    auto camera = armed();
    const Instant t = clock_.now() + 700ms;
    const Frame frame = camera->frame_after(t, 0, {});
    EXPECT_GT(frame.exposure_start - frame.exposure_start_uncertainty, t);
}

TEST_F(FilesCameraTest, RefusesSettingsThatTheRecordingDoesNotHave) {
    add("a.png", 7, 5, CV_8UC1, 10);
    auto camera = open_files_camera(folder_.path(), clock_);
    for (const CaptureSettings& wrong : {CaptureSettings{.width = 5, .height = 7},
                                         {.bits = 12},
                                         {.exposure = 5000us},
                                         {.gain_db = 3.0}})
        EXPECT_THROW(camera->configure(wrong), DeviceError);
}

TEST_F(FilesCameraTest, RefusesAnImageOfAnotherSizeThanTheFirst) {
    add("a.png", 7, 5, CV_8UC1, 10);
    add("b.png", 5, 7, CV_8UC1, 20);
    auto camera = armed();
    EXPECT_EQ(next_value(*camera), 10);
    EXPECT_THROW(camera->frame_after(clock_.now(), 0, {}), DeviceError);
}

TEST_F(FilesCameraTest, RefusesCodesAboveTheFullScaleThatWasSaid) {
    add("a.png", 7, 5, CV_16UC1, 4096);
    auto camera = armed({.bits = 12});
    EXPECT_THROW(camera->frame_after(clock_.now(), 0, {}), DeviceError);
}

TEST_F(FilesCameraTest, NamesTheFileThatIsNoImage) {
    add("a.png", 7, 5, CV_8UC1, 10);
    std::ofstream(folder_ / "b.png") << "not a PNG";
    auto camera = armed();
    EXPECT_EQ(next_value(*camera), 10);
    EXPECT_TRUE(has(config_error_of([&] { camera->frame_after(clock_.now(), 0, {}); }), "b.png"));
}

TEST_F(FilesCameraTest, RefusesAFolderWithoutImagesAndAMissingOne) {
    EXPECT_THROW(open_files_camera(folder_.path(), clock_), ConfigError);
    EXPECT_THROW(open_files_camera(folder_ / "missing", clock_), ConfigError);
}

// A line of events.jsonl as a run writes it (docs/files.md).
std::string frame_line(const std::string& file, const std::string& status, int id) {
    return R"({"t":1.5,"event":"frame","pose":0,"file":")" + file + R"(","sha256":"","status":")" +
           status + R"(","status_detail":"as recorded","device_id":)" + std::to_string(id) +
           R"(,"exposure_start_uncertainty_s":0,"time_source":"device clock","device_time_ns":0)"
           R"(,"settings":{"width":7,"height":5,"bits":12,"format":"","exposure_us":7000)"
           R"(,"gain_db":3.0,"black_level":null,"trigger":"","controls":{}})"
           R"(,"detection":"","corners":[]})"
           "\n";
}

TEST_F(FilesCameraTest, ReplaysARecordWithItsBadFramesCountersAndSettings) {
    fs::create_directory(folder_ / "frames");
    add("frames/0001_0.png", 7, 5, CV_16UC1, 4001);
    add("frames/0000_0.png", 7, 5, CV_16UC1, 4000);
    std::ofstream(folder_ / "events.jsonl")
        << R"({"t":0.1,"event":"capture","detail":""})"
        << "\n"
        << frame_line("frames/0001_0.png", "complete", 41) << frame_line("", "corrupt", 42)
        << frame_line("frames/0000_0.png", "complete", 47) << "{\"t\":3, \"eve";
    auto camera = armed({.bits = 12, .exposure = 7000us});
    const Frame first = camera->frame_after(clock_.now(), 0, {});
    EXPECT_EQ(first.image.pixels.at<std::uint16_t>(0, 0), 4001);
    EXPECT_EQ(first.image.bits, 12);
    EXPECT_EQ(first.id, 41u);
    EXPECT_EQ(first.settings.exposure, 7000us);
    EXPECT_EQ(first.settings.gain_db, 3.0);
    EXPECT_EQ(first.time_source, TimeSource::recording);
    const Frame bad = camera->frame_after(clock_.now(), 5, {});
    EXPECT_EQ(bad.status, FrameStatus::corrupt);
    EXPECT_EQ(bad.status_detail, "as recorded");
    EXPECT_TRUE(bad.image.pixels.empty());
    EXPECT_EQ(next_value(*camera), 4000);
    EXPECT_THROW(camera->frame_after(clock_.now(), 0, {}), DeviceError);
    EXPECT_EQ(camera->statistics().delivered, 2);
    EXPECT_EQ(camera->statistics().rejected, 1);
    camera->disarm();
    EXPECT_THROW(camera->configure({.bits = 12, .exposure = 9000us}), DeviceError);
}

// The images of the last frames that were logged did not fit on the disk any more.
TEST_F(FilesCameraTest, LeavesOutTheEndOfARecordWhoseImagesWereNotWritten) {
    fs::create_directory(folder_ / "frames");
    add("frames/0.png", 7, 5, CV_16UC1, 4000);
    add("frames/2.png", 7, 5, CV_16UC1, 4002);
    std::ofstream(folder_ / "events.jsonl")
        << frame_line("frames/0.png", "complete", 41) << frame_line("frames/1.png", "complete", 42)
        << frame_line("frames/2.png", "complete", 43) << frame_line("", "corrupt", 44)
        << frame_line("frames/4.png", "complete", 45) << frame_line("", "corrupt", 46);
    auto camera = armed({.bits = 12});
    EXPECT_EQ(next_value(*camera), 4000);
    // One that is missing between others was removed later, which is no end.
    EXPECT_THROW(camera->frame_after(clock_.now(), 0, {}), ConfigError);
    fs::remove(folder_ / "frames/2.png");
    camera = armed({.bits = 12});
    EXPECT_EQ(next_value(*camera), 4000);
    EXPECT_THROW(camera->frame_after(clock_.now(), 0, {}), DeviceError);
}

TEST_F(FilesCameraTest, NamesTheLineOfADamagedRecord) {
    std::string unknown_key = frame_line("", "lost", 1);
    unknown_key.replace(unknown_key.find("gain_db"), 7, "gain");
    for (const std::string& damage :
         {std::string("not JSON\n"), frame_line("../else.png", "complete", 1),
          frame_line("", "complte", 1), std::string("{\"event\":\"frame\"}\n"), unknown_key}) {
        std::ofstream(folder_ / "events.jsonl")
            << frame_line("a.png", "complete", 1) << damage << frame_line("b.png", "complete", 2);
        try {
            open_files_camera(folder_.path(), clock_);
            ADD_FAILURE() << damage;
        } catch (const ConfigError& error) {
            EXPECT_EQ(error.place().line, 2) << error.what();
        }
    }
}

// ---- camera recovery

// A camera that is not there at once.

// Another program's until `free_at`.
struct BusyCamera {
    std::unique_ptr<Camera> open() {
        ++openings;
        if (clock.now() < free_at)
            throw CameraBusy("camera genicam:7", 3000ms);
        return std::make_unique<FakeCamera>([](const CaptureSettings&) { return CodeImage{}; },
                                            clock);
    }
    std::unique_ptr<Camera> open_when_free() {
        return etalon::open_when_free([&] { return open(); }, clock, stop.get_token(),
                                      [&](const std::string& text) { told += text; });
    }

    VirtualClock clock;
    std::stop_source stop;
    Instant free_at = clock.now();
    int openings = 0;
    std::string told;
};

TEST(OpenWhenFree, SaysNothingOfACameraThatIsFree) {
    BusyCamera camera;
    EXPECT_TRUE(camera.open_when_free());
    EXPECT_EQ(camera.openings, 1);
    EXPECT_EQ(camera.told, "");
}

TEST(OpenWhenFree, WaitsForAProgramThatWasKilledAndSaysHowLong) {
    BusyCamera camera;
    camera.free_at += 2700ms;
    const Instant begin = camera.clock.now();
    EXPECT_TRUE(camera.open_when_free());
    EXPECT_LE(camera.clock.now() - begin, 3200ms);
    EXPECT_EQ(camera.told,
              "camera genicam:7 is controlled by another program. A camera lets go of a program "
              "that was killed after its heartbeat time-out of 3.0 s: waiting for that, up to "
              "4.0 s");
}

TEST(OpenWhenFree, LeavesACameraToAProgramThatLives) {
    BusyCamera camera;
    camera.free_at += 1h;
    const Instant begin = camera.clock.now();
    EXPECT_THROW(camera.open_when_free(), CameraBusy);
    EXPECT_GE(camera.clock.now() - begin, 4s);
    EXPECT_LE(camera.clock.now() - begin, 5s);
}

TEST(OpenWhenFree, StopsWaitingWhenAsked) {
    BusyCamera camera;
    camera.free_at += 1h;
    camera.stop.request_stop();
    EXPECT_THROW(camera.open_when_free(), Interrupted);
}

// ---- backends

TEST(OpenCamera, RefusesAUriThatNoBackendKnows) {
    VirtualClock clock;
    for (const char* uri : {"", "genicam", "genicam:", "files:", "webcam:0", ":x"})
        EXPECT_THROW(open_camera(uri, {}, clock), ConfigError) << uri;
}

TEST(OpenCamera, OpensAFolderByItsUri) {
    VirtualClock clock;
    EXPECT_TRUE(
        has(config_error_of([&] { open_camera("files:" ETALON_SOURCE_DIR "/cmake", {}, clock); }),
            "/cmake"));
}

}  // namespace
}  // namespace etalon
