// The USB camera through the kernel's own driver (uvcvideo) and V4L2. Runs in the guest.
#include <gtest/gtest.h>
#include <linux/videodev2.h>

#include <optional>
#include <string>

#include "core/program/errors.h"
#include "tests/vm/device_events.h"
#include "tests/vm/raw_video_reader.h"
#include "tests/vm/test_pattern.h"
#include "tests/vm/usb_backend_tests.h"
#include "tests/vm/usb_camera.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

const cv::Size small{320, 200}, large{640, 480};

// A pattern's camera, plugged in, and where the kernel put it.
class UsbVideo : public testing::Test {
protected:
    DeviceEvents events_{DeviceEvents::From::kernel};
    UsbCamera camera_{{.sizes = {large, small}, .frames_per_second = 60}, show_pattern};
    std::string device_ = next_camera(events_);
};

struct Case {
    UsbPixels pixels;
    const char* format;
    cv::Size size;
};

class UsbVideoFormats : public UsbVideo, public testing::WithParamInterface<Case> {};

TEST_P(UsbVideoFormats, Bring200FramesByteForByte) {
    const auto [pixels, format, size] = GetParam();
    RawVideoReader reader(device_, format, size.width, size.height);
    std::optional<std::uint32_t> last;
    for (int i = 0; i < 200; ++i) {
        const auto frame = reader.next();
        ASSERT_TRUE(frame) << "frame " << i;
        ASSERT_FALSE(frame->error) << "frame " << i;
        ASSERT_TRUE(is_pattern(frame->bytes, {pixels, size})) << "frame " << i;
        const std::uint32_t number = read_stamp(frame->bytes, bytes_per_pixel(pixels)).frame;
        if (last) {
            EXPECT_GT(number, *last);
        }
        last = number;
    }
}

INSTANTIATE_TEST_SUITE_P(
    , UsbVideoFormats,
    testing::Values(Case{UsbPixels::grey, "GREY", large}, Case{UsbPixels::y16, "Y16 ", small},
                    Case{UsbPixels::yuyv, "YUYV", small}),
    [](const auto& of) {
        return std::string(of.param.format).substr(0, of.param.format[3] == ' ' ? 3 : 4);
    });

TEST_F(UsbVideo, IsGoneAfterUnpluggingInMidStreamAndReturns) {
    {
        RawVideoReader reader(device_, "GREY", small.width, small.height);
        ASSERT_TRUE(reader.next());
        camera_.unplug();
        EXPECT_THROW(while (reader.next()){}, DeviceError);
    }
    camera_.plug();
    device_ = next_camera(events_);
    RawVideoReader reader(device_, "GREY", small.width, small.height);
    EXPECT_TRUE(reader.next());
}

TEST_F(UsbVideo, RefusesAnExposureTimeWhileItChoosesItsOwn) {
    EXPECT_THROW(set_raw_control(device_, V4L2_CID_EXPOSURE_ABSOLUTE, 70), DeviceError);
    set_raw_control(device_, V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL);
    set_raw_control(device_, V4L2_CID_EXPOSURE_ABSOLUTE, 70);
    EXPECT_EQ(raw_control(device_, V4L2_CID_EXPOSURE_ABSOLUTE), 70);
}

TEST_F(UsbVideo, LeavesOutATruncatedFrameAndCountsIt) {
    RawVideoReader reader(device_, "GREY", small.width, small.height);
    auto last = reader.next();
    ASSERT_TRUE(last);
    camera_.truncate_next_frame();
    for (int i = 0; i < 200; ++i) {  // a busy guest has many whole ones on their way
        const auto frame = reader.next();
        ASSERT_TRUE(frame);
        EXPECT_TRUE(is_pattern(frame->bytes, {UsbPixels::grey, small}));
        if (frame->sequence > last->sequence + 1)
            return;
        last = frame;
    }
    FAIL() << "no gap in the driver's count";
}

// ---- the same camera through the product's backend -----------------------------------------

const UsbBackend backend{.name = "v4l2", .sets_exposure = true};
const UsbBackendCase grey{backend, UsbPixels::grey, "GREY", 8};
const UsbBackendCase y16{backend, UsbPixels::y16, "Y16", 16};
const UsbBackendCase yuyv{backend, UsbPixels::yuyv, "YUYV", 8};

INSTANTIATE_TEST_SUITE_P(V4l2, CameraContract, testing::Values(y16.maker()), rig_name);
INSTANTIATE_TEST_SUITE_P(V4l2, UsbBackendFormats, testing::Values(grey, y16, yuyv), case_name);
INSTANTIATE_TEST_SUITE_P(V4l2, UsbBackendTest, testing::Values(grey), case_name);

}  // namespace
}  // namespace etalon
