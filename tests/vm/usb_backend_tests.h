// What each backend must do with the USB camera beyond the contract. A program includes it once.
#pragma once

#include <ostream>

#include "tests/capture/frame/camera_contract.h"
#include "tests/vm/device_events.h"
#include "tests/vm/test_pattern.h"

namespace etalon {

// The USB camera behind one of the product's backends, for the contract that every backend
// keeps (tests/capture/frame/camera_contract.h) and for tests of what only a real driver does.

// How a backend names the camera and its formats, and what it can set.
struct UsbBackend {
    std::string name;  // "v4l2" or "libcamera"
    bool sets_exposure = false;
};

class UsbRig : public CameraRig {
public:
    // `format` is the backend's name for `pixels`; `bits` is what it makes of them.
    UsbRig(UsbBackend backend, UsbPixels pixels, std::string format, int bits)
        : backend_(std::move(backend)),
          pixels_(pixels),
          format_(std::move(format)),
          bits_(bits),
          camera_({.sizes = {{640, 480}, {width, height}}, .frames_per_second = 60},
                  [this](const UsbExposure& exposure) { return expose(exposure); }) {
        device_ = next_camera(events_);
    }

    Clock& clock() override { return clock_; }
    std::unique_ptr<Camera> open() override {
        return open_camera(backend_.name == "v4l2" ? "v4l2:" + device_ : libcamera_id,
                           {.frame_timeout = std::chrono::seconds(2)},  // the guest is slow
                           clock_);
    }
    CaptureSettings settings() const override {
        return {.width = width,
                .height = height,
                .bits = bits_,
                .format = format_,
                .exposure = std::chrono::microseconds(backend_.sets_exposure ? 7000 : 0)};
    }
    std::vector<Refusal> refusals() const override {
        return {{"322", [](CaptureSettings& s) { s.width = 322; }},
                {"ABCD", [](CaptureSettings& s) { s.format = "ABCD"; }},
                {"gain", [](CaptureSettings& s) { s.gain_db = 70.0; }}};
    }
    bool show(const CodeImage& scene) override {
        const std::lock_guard lock(mutex_);
        scene_ = scene;
        return true;
    }
    bool unplug() override {
        camera_.unplug();
        return true;
    }
    bool plug_in() override {
        camera_.plug();
        device_ = next_camera(events_);
        return true;
    }

    UsbCamera& camera() { return camera_; }
    StreamMode mode() const { return {pixels_, {width, height}}; }

    // Of the latest frame; nothing before the first.
    std::optional<UsbExposure> last_exposure() const {
        const std::lock_guard lock(mutex_);
        return last_exposure_;
    }

private:
    static constexpr int width = 320, height = 200;
    // libcamera's name of the camera: its host controller (firmware_node.cpp), port and product.
    static constexpr const char* libcamera_id = "libcamera:virtual-1:1.0-1d6b:0102";

    // On the camera's thread. The scene's codes are the frame's, luma of yuyv; what else there is
    // stays the pattern's.
    std::vector<std::uint8_t> expose(const UsbExposure& exposure) {
        std::vector<std::uint8_t> frame = show_pattern(exposure);
        const std::lock_guard lock(mutex_);
        last_exposure_ = exposure;
        if (scene_.pixels.size() != exposure.mode.size)
            return frame;
        const int bytes = bytes_per_pixel(exposure.mode.pixels);
        if (static_cast<int>(scene_.pixels.elemSize()) == bytes) {
            scene_.pixels.copyTo(cv::Mat(exposure.mode.size, scene_.pixels.type(), frame.data()));
        } else {
            cv::Mat pairs(exposure.mode.size, CV_8UC2, frame.data());
            cv::insertChannel(scene_.pixels, pairs, 0);
        }
        return frame;
    }

    const UsbBackend backend_;
    const UsbPixels pixels_;
    const std::string format_;
    const int bits_;
    SteadyClock clock_;

    mutable std::mutex mutex_;
    CodeImage scene_;  // empty: the pattern
    std::optional<UsbExposure> last_exposure_;

    DeviceEvents events_{DeviceEvents::From::udev};
    UsbCamera camera_;
    std::string device_;
};

struct UsbBackendCase {
    UsbBackend backend;
    UsbPixels pixels;
    std::string format;
    int bits;

    std::unique_ptr<UsbRig> rig() const {
        return std::make_unique<UsbRig>(backend, pixels, format, bits);
    }
    CameraRigMaker maker() const {
        return {format, [*this] { return rig(); }};
    }
};

class UsbBackendTest : public testing::TestWithParam<UsbBackendCase> {
protected:
    void SetUp() override {
        camera_ = rig_->open();
        camera_->configure(rig_->settings());
        camera_->arm();
    }

    const std::unique_ptr<UsbRig> rig_ = GetParam().rig();
    std::unique_ptr<Camera> camera_;
};

// For each format, while UsbBackendTest is for one.
class UsbBackendFormats : public UsbBackendTest {};

// For messages.
inline void PrintTo(const UsbBackendCase& which, std::ostream* out) {
    *out << which.backend.name << " " << which.format;
}

inline std::string case_name(const testing::TestParamInfo<UsbBackendCase>& info) {
    return info.param.format;
}

// The grey values of a frame as the camera sent it, in the low bits.
inline cv::Mat grey_values(std::vector<std::uint8_t>& frame, const StreamMode& mode) {
    if (mode.pixels != UsbPixels::yuyv)
        return {mode.size, bytes_per_pixel(mode.pixels) == 1 ? CV_8UC1 : CV_16UC1, frame.data()};
    cv::Mat luma;
    cv::extractChannel(cv::Mat(mode.size, CV_8UC2, frame.data()), luma, 0);
    return luma;
}

// Of the pixels that carry it, one byte each.
inline PatternStamp stamp_of(const cv::Mat& pixels) {
    return read_stamp({pixels.data, PatternStamp::pixels * pixels.elemSize()},
                      static_cast<int>(pixels.elemSize()));
}

inline bool is_whole_pattern(const cv::Mat& pixels, const StreamMode& mode) {
    std::vector<std::uint8_t> frame = pattern_frame(mode, stamp_of(pixels));
    const cv::Mat expected = grey_values(frame, mode);
    return pixels.size() == expected.size() && pixels.type() == expected.type() &&
           cv::norm(pixels, expected, cv::NORM_INF) == 0.0;
}

TEST_P(UsbBackendFormats, Return200FramesPixelForPixel) {
    std::uint32_t last = 0;
    for (int i = 0; i < 200; ++i) {
        const Frame frame = camera_->frame_after({}, 5, {});  // each one is new enough
        ASSERT_EQ(frame.status, FrameStatus::complete) << "frame " << i << frame.status_detail;
        ASSERT_TRUE(is_whole_pattern(frame.image.pixels, rig_->mode())) << "frame " << i;
        const std::uint32_t number = stamp_of(frame.image.pixels).frame;
        ASSERT_TRUE(i == 0 || number > last) << "frame " << i;
        last = number;
    }
}

// The camera's own stamp of the exposure's start is the truth here.
TEST_P(UsbBackendTest, Returns200FramesNoneBegunBeforeTheMomentAskedFor) {
    for (int i = 0; i < 200; ++i) {
        const Instant t = rig_->clock().now();
        const Frame frame = camera_->frame_after(t, 5, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << "frame " << i << frame.status_detail;
        const PatternStamp stamp = stamp_of(frame.image.pixels);
        ASSERT_GT(stamp.start, t) << "frame " << i;
        ASSERT_LE(frame.exposure_start - frame.exposure_start_uncertainty, stamp.start);
        ASSERT_GE(frame.exposure_start + frame.exposure_start_uncertainty, stamp.start);
    }
}

TEST_P(UsbBackendTest, LeavesATruncatedFrameOut) {
    for (int i = 0; i < 3; ++i) {
        rig_->camera().truncate_next_frame();
        const Frame frame = camera_->frame_after(rig_->clock().now(), 5, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        EXPECT_TRUE(is_whole_pattern(frame.image.pixels, rig_->mode()));
    }
}

TEST_P(UsbBackendTest, SaysThatNothingCameFromAFrozenCameraAndGoesOnAfterwards) {
    camera_->frame_after(rig_->clock().now(), 0, {});
    rig_->camera().freeze(true);
    rig_->clock().wait_for(100ms, {});  // what was on its way arrives
    const Instant begin = rig_->clock().now();
    const Frame none = camera_->frame_after(begin, 0, {});
    EXPECT_NE(none.status, FrameStatus::complete);
    EXPECT_LT(rig_->clock().now() - begin, 5s);
    rig_->camera().freeze(false);
    const Frame frame = camera_->frame_after(rig_->clock().now(), 2, {});
    ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_TRUE(is_whole_pattern(frame.image.pixels, rig_->mode()));
}

// A consumer's camera powers up sharpening and choosing its own exposure.
TEST_P(UsbBackendTest, SwitchesOffWhatItCanAndNamesWhatItCannot) {
    camera_->frame_after(rig_->clock().now(), 5, {});
    const auto exposure = rig_->last_exposure();
    ASSERT_TRUE(exposure);
    if (GetParam().backend.sets_exposure) {
        EXPECT_FALSE(exposure->automatic);
        EXPECT_EQ(exposure->time, rig_->settings().exposure);
        EXPECT_EQ(exposure->sharpness, 0);
        EXPECT_EQ(exposure->gain_db, 0.0);
    } else {
        EXPECT_FALSE(camera_->remarks().empty());
    }
}

TEST_P(UsbBackendTest, IsLostWithinSecondsOfUnpluggingAndReturnsWithItsSettings) {
    camera_->frame_after(rig_->clock().now(), 5, {});
    rig_->unplug();
    const Instant begin = rig_->clock().now();
    EXPECT_THROW(camera_->frame_after(begin, 100, {}), DeviceError);
    EXPECT_LT(rig_->clock().now() - begin, 3s);
    rig_->plug_in();
    camera_->reconnect(rig_->clock().now() + 15s, {});
    const Frame frame = camera_->frame_after(rig_->clock().now(), 5, {});
    ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_TRUE(is_whole_pattern(frame.image.pixels, rig_->mode()));
    EXPECT_EQ(frame.settings.exposure, rig_->settings().exposure);
    if (GetParam().backend.sets_exposure) {
        EXPECT_EQ(rig_->last_exposure()->time, rig_->settings().exposure);
    }
}

}  // namespace etalon
