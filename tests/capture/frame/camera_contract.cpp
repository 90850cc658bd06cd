#include "tests/capture/frame/camera_contract.h"

#include "capture/frame/frame_checks.h"

namespace etalon {

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(CameraContract);

std::string rig_name(const testing::TestParamInfo<CameraRigMaker>& info) {
    return info.param.name;
}

void CameraContract::SetUp() {
    rig_ = GetParam().make();
    if (const std::string why = rig_->missing(); !why.empty())
        GTEST_SKIP() << why;
}

std::unique_ptr<Camera> CameraContract::armed() {
    auto camera = rig_->open();
    camera->configure(rig_->settings());
    camera->arm();
    return camera;
}

CodeImage CameraContract::scene(int number) const {
    const CaptureSettings settings = rig_->settings();
    CodeImage image{
        cv::Mat(settings.height, settings.width, settings.bits <= 8 ? CV_8UC1 : CV_16UC1),
        settings.bits};
    cv::RNG random(static_cast<std::uint64_t>(7919 + number));
    random.fill(image.pixels, cv::RNG::UNIFORM, 0, image.full_scale() + 1);
    return image;
}

double CameraContract::seconds(const std::function<void()>& call) {
    const auto before = std::chrono::steady_clock::now();
    call();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
}

namespace {

bool same(const cv::Mat& a, const cv::Mat& b) {
    return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0.0;
}

}  // namespace

// ---- freshness -----------------------------------------------------------------------------

TEST_P(CameraContract, ReturnsOnlyFramesWhoseExposureBeganAfterTheMomentAskedFor) {
    auto camera = armed();
    for (int i = 0; i < 12; ++i) {
        const CodeImage shown = scene(i);
        const bool ours = rig_->show(shown);
        const Instant t = rig_->clock().now() + (i % 3) * 3ms;
        const Frame frame = camera->frame_after(t, rig_->retries(), {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        EXPECT_GT(frame.exposure_start - frame.exposure_start_uncertainty, t);
        EXPECT_LE(frame.exposure_start - frame.exposure_start_uncertainty, rig_->clock().now());
        EXPECT_GE(frame.exposure_start_uncertainty, Duration(0));
        if (ours) {
            EXPECT_TRUE(same(frame.image.pixels, shown.pixels)) << "frame " << i;
        }
    }
    EXPECT_EQ(camera->statistics().delivered, 12);
}

TEST_P(CameraContract, ShowsNothingFromBeforeAPause) {
    auto camera = armed();
    if (!rig_->show(scene(1)))
        GTEST_SKIP() << "the pixels are not the test's to choose";
    camera->frame_after(rig_->clock().now(), rig_->retries(), {});
    rig_->clock().wait_for(300ms, {});  // a camera that runs freely fills all its buffers
    rig_->show(scene(2));
    const Frame frame = camera->frame_after(rig_->clock().now(), rig_->retries(), {});
    ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_TRUE(same(frame.image.pixels, scene(2).pixels));
}

TEST_P(CameraContract, CountsEveryFrameUpwards) {
    auto camera = armed();
    Frame last = camera->frame_after(rig_->clock().now(), rig_->retries(), {});
    for (int i = 0; i < 8; ++i) {
        const Frame next = camera->frame_after(last.exposure_start, rig_->retries(), {});
        ASSERT_EQ(next.status, FrameStatus::complete) << next.status_detail;
        EXPECT_TRUE(frame_id_advanced(last.id, next.id)) << last.id << " then " << next.id;
        EXPECT_GT(next.exposure_start, last.exposure_start);
        last = next;
    }
}

// ---- settings ------------------------------------------------------------------------------

TEST_P(CameraContract, DoesWhatWasAskedAndSaysSoInEveryFrame) {
    const CaptureSettings wanted = rig_->settings();
    auto camera = rig_->open();
    const CaptureSettings actual = camera->configure(wanted);
    EXPECT_FALSE(first_difference(wanted, actual, 1000.0).has_value());
    EXPECT_EQ(actual.bits, wanted.bits);
    EXPECT_FALSE(actual.format.empty());
    camera->arm();
    const Frame frame = camera->frame_after(rig_->clock().now(), rig_->retries(), {});
    ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_EQ(frame.image.pixels.size(), cv::Size(wanted.width, wanted.height));
    EXPECT_EQ(frame.image.bits, wanted.bits);
    EXPECT_TRUE(bits_fit_depth(frame.image.bits, frame.image.pixels.depth()));
    EXPECT_FALSE(exceeds_full_scale(frame.image));
    EXPECT_FALSE(first_difference(actual, frame.settings, 0.0).has_value());
    EXPECT_EQ(frame.settings.format, actual.format);
}

TEST_P(CameraContract, RefusesWhatTheDeviceCannotDoAndNamesIt) {
    auto camera = rig_->open();
    for (const CameraRig::Refusal& refusal : rig_->refusals()) {
        CaptureSettings settings = rig_->settings();
        refusal.change(settings);
        const std::string error = device_error_of([&] { camera->configure(settings); });
        EXPECT_TRUE(has(error, refusal.named)) << refusal.named << ": " << error;
        EXPECT_THROW(camera->arm(), DeviceError)
            << "armed although " << refusal.named << " was refused";
    }
    camera->configure(rig_->settings());  // and is none the worse for it
    camera->arm();
    EXPECT_EQ(camera->frame_after(rig_->clock().now(), rig_->retries(), {}).status,
              FrameStatus::complete);
}

TEST_P(CameraContract, CanBeConfiguredAgainAndAgain) {
    auto camera = rig_->open();
    for (int i = 0; i < 3; ++i) {
        camera->configure(rig_->settings());
        camera->arm();
        EXPECT_EQ(camera->frame_after(rig_->clock().now(), rig_->retries(), {}).status,
                  FrameStatus::complete);
        camera->disarm();
    }
}

TEST_P(CameraContract, ListsTheFormatAndTheSizeInForce) {
    auto camera = rig_->open();
    const CaptureSettings actual = camera->configure(rig_->settings());
    const CameraAbilities abilities = camera->abilities();
    if (abilities.formats.empty())
        GTEST_SKIP() << "it is no device";
    bool listed = false;
    for (const CameraFormat& format : abilities.formats)
        for (const FrameSizes& sizes : format.sizes)
            listed =
                listed ||
                (format.name == actual.format && format.bits >= actual.bits &&
                 sizes.smallest.width <= actual.width && sizes.smallest.height <= actual.height &&
                 sizes.largest.width >= actual.width && sizes.largest.height >= actual.height);
    EXPECT_TRUE(listed) << actual.format;
    for (const CameraControl& control : abilities.controls) {
        EXPECT_FALSE(control.name.empty());
        if (control.low && control.high) {
            EXPECT_LE(*control.low, *control.high) << control.name;
        }
    }
}

// ---- status --------------------------------------------------------------------------------

TEST_P(CameraContract, HandsNoBadFrameOnAsGood) {
    int brought_about = 0;
    for (const FrameFault fault :
         {FrameFault::cut_short, FrameFault::damaged, FrameFault::lost, FrameFault::late}) {
        auto camera = armed();
        const auto status = rig_->spoil(fault, 1);
        if (!status)
            continue;
        ++brought_about;
        const long rejected = camera->statistics().rejected;
        const Frame frame = camera->frame_after(rig_->clock().now(), 0, {});
        EXPECT_EQ(frame.status, *status) << frame.status_detail;
        EXPECT_TRUE(frame.image.pixels.empty());
        EXPECT_FALSE(frame.status_detail.empty());
        EXPECT_GT(camera->statistics().rejected, rejected);
        const Frame next = camera->frame_after(rig_->clock().now(), rig_->retries(), {});
        EXPECT_EQ(next.status, FrameStatus::complete) << next.status_detail;
    }
    if (brought_about == 0)
        GTEST_SKIP() << "no fault can be brought about here";
}

TEST_P(CameraContract, TriesAgainAndCountsIt) {
    auto camera = armed();
    if (!rig_->spoil(FrameFault::damaged, 2) && !rig_->spoil(FrameFault::cut_short, 2))
        GTEST_SKIP() << "no fault can be brought about here";
    const long rejected = camera->statistics().rejected;
    const Frame frame = camera->frame_after(rig_->clock().now(), 2 + rig_->retries(), {});
    EXPECT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_GE(camera->statistics().rejected, rejected + 2);
    EXPECT_EQ(camera->statistics().delivered, 1);
}

// ---- states --------------------------------------------------------------------------------

TEST_P(CameraContract, FollowsItsStates) {
    auto camera = rig_->open();
    EXPECT_THROW(camera->arm(), DeviceError);
    EXPECT_THROW(camera->frame_after(rig_->clock().now(), 0, {}), DeviceError);
    camera->disarm();
    camera->configure(rig_->settings());
    EXPECT_THROW(camera->frame_after(rig_->clock().now(), 0, {}), DeviceError);
    camera->arm();
    camera->arm();
    EXPECT_THROW(camera->configure(rig_->settings()), DeviceError);
    camera->disarm();
    camera->disarm();
    EXPECT_THROW(camera->frame_after(rig_->clock().now(), 0, {}), DeviceError);
    camera->arm();
    EXPECT_EQ(camera->frame_after(rig_->clock().now(), rig_->retries(), {}).status,
              FrameStatus::complete);
}

TEST_P(CameraContract, EndsWithinSecondsInEveryState) {
    auto idle = rig_->open();
    EXPECT_LT(seconds([&] { idle.reset(); }), 3.0);
    auto configured = rig_->open();
    configured->configure(rig_->settings());
    EXPECT_LT(seconds([&] { configured.reset(); }), 3.0);
    auto camera = armed();
    EXPECT_LT(seconds([&] { camera->disarm(); }), 3.0);
    camera->arm();
    EXPECT_LT(seconds([&] { camera.reset(); }), 3.0);
}

// The one thing that another thread may do.
TEST_P(CameraContract, StopsWaitingWhenAnotherThreadAsks) {
    auto camera = armed();
    std::stop_source stop;
    std::thread other([&] { stop.request_stop(); });
    const auto frame = [&] { camera->frame_after(rig_->clock().now() + 5ms, 0, stop.get_token()); };
    bool interrupted = false;
    const auto wait = [&] {
        try {
            for (int i = 0; i < 10; ++i)
                frame();
        } catch (const Interrupted&) {
            interrupted = true;
        }
    };
    EXPECT_LT(seconds(wait), 3.0);
    other.join();
    if (!interrupted) {
        EXPECT_THROW(frame(), Interrupted);
    }
}

// ---- a device that goes --------------------------------------------------------------------

TEST_P(CameraContract, SaysWithinSecondsThatTheDeviceIsGone) {
    auto camera = armed();
    if (!rig_->unplug())
        GTEST_SKIP() << "it cannot be taken away here";
    const auto lose = [&] {
        EXPECT_THROW(camera->frame_after(rig_->clock().now(), 100, {}), DeviceError);
    };
    EXPECT_LT(seconds(lose), 5.0);
    EXPECT_LT(seconds(lose), 1.0) << "it forgot";
    EXPECT_LT(seconds([&] { camera->disarm(); }), 3.0);
    EXPECT_LT(seconds([&] { camera.reset(); }), 3.0);
}

TEST_P(CameraContract, EndsWithinSecondsWhenTheDeviceWentUnnoticed) {
    auto camera = armed();
    if (!rig_->unplug())
        GTEST_SKIP() << "it cannot be taken away here";
    EXPECT_LT(seconds([&] { camera->disarm(); }), 3.0);
    EXPECT_LT(seconds([&] { camera.reset(); }), 3.0);
}

TEST_P(CameraContract, ComesBackAsItWas) {
    auto camera = rig_->open();
    const CaptureSettings before = camera->configure(rig_->settings());
    camera->arm();
    if (!rig_->unplug())
        GTEST_SKIP() << "it cannot be taken away here";
    EXPECT_THROW(camera->frame_after(rig_->clock().now(), 100, {}), DeviceError);
    EXPECT_THROW(camera->reconnect(rig_->clock().now() + 200ms, {}), DeviceError);
    if (!rig_->plug_in())
        GTEST_SKIP() << "it cannot be brought back here";
    camera->reconnect(rig_->clock().now() + 15s, {});
    EXPECT_EQ(camera->statistics().reconnects, 1);
    const CodeImage shown = scene(77);
    const bool ours = rig_->show(shown);
    const Instant t = rig_->clock().now();
    const Frame frame = camera->frame_after(t, rig_->retries(), {});
    ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_GT(frame.exposure_start - frame.exposure_start_uncertainty, t);
    EXPECT_FALSE(first_difference(before, frame.settings, 0.0).has_value());
    EXPECT_EQ(frame.settings.format, before.format);
    if (ours) {
        EXPECT_TRUE(same(frame.image.pixels, shown.pixels));
    }
}

}  // namespace etalon
