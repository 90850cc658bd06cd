#include "capture/frame/frame_average.h"

#include "tests/test.h"

namespace etalon {
namespace {

// Of frames with these codes, the second pixel one higher.
FrameAverage average_of(const std::vector<int>& codes) {
    FrameAverager averager;
    for (const int code : codes) {
        Frame frame;
        frame.image = {(cv::Mat_<std::uint16_t>(1, 2) << code, code + 1), 16};
        averager.add(frame);
    }
    return averager.average();
}

TEST(FrameAverage, IsTheMeanAndTheVarianceOfOneFrame) {
    const FrameAverage average = average_of({10, 14, 15});
    EXPECT_EQ(average.frames, 3);
    EXPECT_EQ(average.bits, 16);
    EXPECT_NEAR(average.mean.at<double>(0, 0), 13.0, 1e-12);
    EXPECT_NEAR(average.mean.at<double>(0, 1), 14.0, 1e-12);
    EXPECT_NEAR(average.variance.at<double>(0, 1), 7.0, 1e-12);  // (9 + 1 + 4) / 2
    EXPECT_NEAR(average.noise(), std::sqrt(7.0), 1e-12);
}

TEST(FrameAverage, LosesNothingOfSmallNoiseAtTheTopOfSixteenBits) {
    std::vector<int> codes;
    for (int i = 0; i < 400; ++i)
        codes.push_back(65533 + i % 2);
    // 400 values, each half a code from the mean: 400 / 4 / 399.
    EXPECT_NEAR(average_of(codes).variance.at<double>(0, 0), 100.0 / 399.0, 1e-9);
}

TEST(FrameAverage, NeedsTwoFrames) {
    EXPECT_THROW(average_of({3}), ConfigError);
}

}  // namespace
}  // namespace etalon
