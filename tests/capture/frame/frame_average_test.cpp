#include "capture/frame/frame_average.h"

#include <gtest/gtest.h>

#include "core/errors.h"
#include "mocks/camera/fake_camera.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

// A camera that shows these codes one after the other, the second pixel one higher.
class FrameAverageTest : public testing::Test {
protected:
    FrameAverage of(std::vector<int> codes, int frames) {
        std::size_t next = 0;
        camera_ = std::make_unique<FakeCamera>(
            [codes, next](const CaptureSettings&) mutable {
                const int code = codes.at(next++);
                cv::Mat pixels = (cv::Mat_<std::uint16_t>(1, 2) << code, code + 1);
                return CodeImage{pixels, 16};
            },
            clock_);
        camera_->script = script_;
        camera_->configure({});
        camera_->arm();
        return average_frames(*camera_, frames, clock_.now() + 7ms, 1, {});
    }

    VirtualClock clock_;
    std::deque<FrameStatus> script_;
    std::unique_ptr<FakeCamera> camera_;
};

TEST_F(FrameAverageTest, IsTheMeanAndTheVarianceOfOneFrame) {
    const Instant asked = clock_.now() + 7ms;
    const FrameAverage average = of({10, 14, 15}, 3);
    EXPECT_EQ(average.frames, 3);
    EXPECT_EQ(average.bits, 16);
    EXPECT_NEAR(average.mean.at<double>(0, 0), 13.0, 1e-12);
    EXPECT_NEAR(average.mean.at<double>(0, 1), 14.0, 1e-12);
    EXPECT_NEAR(average.variance.at<double>(0, 1), 7.0, 1e-12);  // (9 + 1 + 4) / 2
    EXPECT_NEAR(average.noise(), std::sqrt(7.0), 1e-12);
    EXPECT_GT(average.first_exposure_start, asked);
    EXPECT_GT(average.last_exposure_start, average.first_exposure_start);
}

TEST_F(FrameAverageTest, LosesNothingOfSmallNoiseAtTheTopOfSixteenBits) {
    std::vector<int> codes;
    for (int i = 0; i < 400; ++i)
        codes.push_back(65533 + i % 2);
    // 400 values, each half a code from the mean: 400 / 4 / 399.
    EXPECT_NEAR(of(codes, 400).variance.at<double>(0, 0), 100.0 / 399.0, 1e-9);
}

TEST_F(FrameAverageTest, TakesNoIncompleteFrame) {
    script_ = {FrameStatus::complete, FrameStatus::corrupt};  // the retry is good
    EXPECT_NEAR(of({3, 5}, 2).mean.at<double>(0, 0), 4.0, 1e-12);
    script_ = {FrameStatus::complete, FrameStatus::corrupt, FrameStatus::short_frame};
    EXPECT_THROW(of({3, 5}, 2), DeviceError);
}

TEST_F(FrameAverageTest, NeedsTwoFrames) {
    EXPECT_THROW(of({3, 5}, 1), ConfigError);
}

}  // namespace
}  // namespace etalon
