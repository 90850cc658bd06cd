// A camera that loses its power while frames are taken and gets it back: as a program of its own,
// killed in mid-stream, so that nothing of it is left that could say goodbye.
#include "tests/loopback/powered_camera.h"

#include <future>

#include "capture/frame/frame_checks.h"

namespace etalon {
namespace {

// Its parameter is the trigger: by software, or none for a camera that runs freely.
class PoweredCameraTest : public testing::TestWithParam<const char*> {
protected:
    static CaptureSettings wanted() {
        return {.width = 150,
                .height = 80,
                .bits = 12,
                .format = "Mono12p",
                .exposure = 7000us,
                .gain_db = 3.0,
                .black_level = 5.0,
                .trigger = GetParam(),
                .controls = {{"AcquisitionFrameRate", 40.0}}};
    }

    // Takes frames of picture `number`, cuts the power after the fifth while more are taken, and
    // returns how long it took to notice.
    Duration time_to_notice_the_cut(Camera& camera, int number) {
        std::future<Instant> cut;
        const auto cut_power = [this] {
            const Instant now = clock_.now();
            power_.cut_power();
            return now;
        };
        try {
            for (int frames = 1;; ++frames) {
                const Frame frame = camera.frame_after(clock_.now(), 5, {});
                if (frame.status == FrameStatus::complete) {
                    EXPECT_TRUE(same(frame.image.pixels, PoweredCamera::shown(number).pixels));
                }
                if (frames == 5)
                    cut = std::async(std::launch::async, cut_power);
            }
        } catch (const DeviceError&) {
            const Instant noticed = clock_.now();
            return cut.valid() ? noticed - cut.get() : Duration::max();
        }
    }

    SteadyClock clock_;
    PoweredCamera power_;
};

TEST_P(PoweredCameraTest, IsTakenUpAgainWithEverySettingAfterItWasKilledInMidStream) {
    power_.switch_on(1);
    auto camera = open_camera("genicam:127.0.0.1", {}, clock_);
    const std::string rate_after_power_up = control_of(*camera, "AcquisitionFrameRate").value;
    const CaptureSettings before = camera->configure(wanted());
    camera->arm();
    EXPECT_LT(time_to_notice_the_cut(*camera, 1), 10s);
    EXPECT_THROW(camera->frame_after(clock_.now(), 5, {}), DeviceError);
    EXPECT_THROW(camera->reconnect(clock_.now() + 200ms, {}), DeviceError);

    power_.switch_on(2);
    const Instant back = clock_.now();
    camera->reconnect(back + 15s, {});
    EXPECT_LT(clock_.now() - back, 15s);
    EXPECT_EQ(camera->statistics().reconnects, 1);
    for (int i = 0; i < 5; ++i) {
        const Frame frame = camera->frame_after(clock_.now(), 5, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        EXPECT_TRUE(same(frame.image.pixels, PoweredCamera::shown(2).pixels));
        EXPECT_FALSE(first_difference(before, frame.settings, 0.0).has_value());
    }
    EXPECT_EQ(power_.exposed_with(), "Mono12p, 7000 us, 3 dB, black level 5");
    camera->disarm();
    EXPECT_EQ(control_of(*camera, "AcquisitionFrameRate").value, "40");
    EXPECT_NE(rate_after_power_up, "40");
}

INSTANTIATE_TEST_SUITE_P(Triggers, PoweredCameraTest, testing::Values("Software", "none"),
                         [](const auto& trigger) {
                             return std::string(trigger.param) == "none" ? "Free" : "Software";
                         });

}  // namespace
}  // namespace etalon
