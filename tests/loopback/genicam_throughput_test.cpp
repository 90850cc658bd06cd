// Many frames, byte for byte, over GigE Vision on loopback: every one carries its number, and the
// test knows what the camera showed at each.

#include <cstring>

#include "capture/genicam/genicam_device.h"
#include "tests/loopback/gige_rig.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int large_width = 1280, large_height = 1024;

// A picture that is cheap to make and different for every number: random bytes, read from another
// place each time.
class NumberedPictures {
public:
    NumberedPictures() : noise_(1, large_width * large_height + pictures, CV_8UC1) {
        cv::RNG random(75);
        random.fill(noise_, cv::RNG::UNIFORM, 0, 256);
    }
    cv::Mat of(int number) const {
        return cv::Mat(large_height, large_width, CV_8UC1,
                       const_cast<std::uint8_t*>(noise_.data) + number % pictures);
    }

private:
    static constexpr int pictures = 4001;
    cv::Mat noise_;
};

struct NumberedCamera {
    NumberedPictures pictures;
    SteadyClock clock;
    std::atomic<int> shown = 0;
    GigeCamera device{options(), [this](const CaptureSettings&) {
                          return CodeImage{pictures.of(++shown), 8};
                      }};

    static GigeCameraOptions options() { return {.width = large_width, .height = large_height}; }
};

bool same_bytes(const cv::Mat& a, const cv::Mat& b) {
    return a.size() == b.size() && a.isContinuous() && b.isContinuous() &&
           std::memcmp(a.data, b.data, a.total()) == 0;
}

// The number of the picture that the frame shows, of `at_most` and those before; 0 for none.
int number_of(const cv::Mat& pixels, const NumberedPictures& pictures, int at_most) {
    for (int number = at_most; number > std::max(0, at_most - 6); --number)
        if (same_bytes(pixels, pictures.of(number)))
            return number;
    return 0;
}

TEST(GenicamThroughput, DeliversAThousandFramesOf1280x1024At50HzByteForByteWithoutLoss) {
    if (granted_receive_buffer(receive_buffer_bytes) < receive_buffer_bytes)
        GTEST_SKIP() << "the kernel grants a receive buffer of "
                     << granted_receive_buffer(receive_buffer_bytes) << " bytes, not "
                     << receive_buffer_bytes << " (net.core.rmem_max)";
    NumberedCamera rig;
    auto camera = open_camera("genicam:127.0.0.1", {}, rig.clock);
    camera->configure({.exposure = 1000us, .trigger = "Software"});
    camera->arm();
    // The frame that warms the stream up may have been lost, and is not one of the thousand.
    const long lost_before = camera->statistics().missing_packets;
    const Instant start = rig.clock.now();
    for (int i = 0; i < 1000; ++i) {
        const Frame frame = camera->frame_after(start + i * 20ms, 0, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << i << ": " << frame.status_detail;
        ASSERT_TRUE(same_bytes(frame.image.pixels, rig.pictures.of(rig.shown))) << i;
    }
    EXPECT_EQ(camera->statistics().delivered, 1000);
    EXPECT_EQ(camera->statistics().rejected, 0);
    EXPECT_EQ(camera->statistics().skipped, 0);
    EXPECT_EQ(camera->statistics().missing_packets, lost_before);
    const double seconds = std::chrono::duration<double>(rig.clock.now() - start).count();
    EXPECT_LT(seconds, 1.1 * 20.0) << "slower than 50 Hz";
    RecordProperty("frames_per_second", std::to_string(1000.0 / seconds));
}

// Whatever the kernel grants: a bad frame is triggered again a bounded number of times, what comes
// back whole is what was shown after it was asked for, and what does not says so. How many are
// whole depends on the machine: with a stock receive buffer of 212992 bytes it was none to a half.
TEST(GenicamThroughput, TriggersLargeFramesAgainABoundedNumberOfTimes) {
    NumberedCamera rig;
    // Packets that fit the kernel's memory blocks best.
    const CameraLink link{.frame_timeout = 500ms, .packet_size = 4000};
    auto camera = open_camera("genicam:127.0.0.1", link, rig.clock);
    camera->configure({});
    camera->arm();
    constexpr int frames = 10, retries = 4;
    const Instant start = rig.clock.now();
    for (int i = 0; i < frames; ++i) {
        const int before = rig.shown;
        const Frame frame = camera->frame_after(rig.clock.now(), retries, {});
        if (frame.status == FrameStatus::complete) {
            EXPECT_GT(number_of(frame.image.pixels, rig.pictures, rig.shown), before);
        } else {
            EXPECT_TRUE(frame.image.pixels.empty()) << frame.status_detail;
        }
        EXPECT_LE(rig.shown - before, retries + 2);  // and one to warm up after a restart
    }
    const CaptureStatistics counts = camera->statistics();
    EXPECT_LE(counts.rejected, frames * (retries + 1));
    EXPECT_LT(rig.clock.now() - start, frames * (retries + 1) * 2 * link.frame_timeout);
    if (granted_receive_buffer(receive_buffer_bytes) >= receive_buffer_bytes) {
        EXPECT_EQ(counts.delivered, frames);
    }
}

}  // namespace
}  // namespace etalon
