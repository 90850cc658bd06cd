#include "station/devices/live_view.h"

#include <gtest/gtest.h>

namespace etalon {
namespace {

using namespace std::chrono_literals;

Frame frame_of(const cv::Mat& codes, int bits, Instant start) {
    Frame frame;
    frame.image = {codes, bits};
    frame.status = FrameStatus::complete;
    frame.exposure_start = start;
    return frame;
}

TEST(LiveView, MeasuresRateMeanNoiseAndSaturation) {
    cv::Mat first(40, 50, CV_8UC1, cv::Scalar(100)), second;
    first(cv::Rect(0, 0, 50, 4)) = 255;  // a tenth
    cv::Mat noise(40, 50, CV_16SC1);
    cv::RNG random(7);
    random.fill(noise, cv::RNG::NORMAL, 0.0, 5.0);
    noise(cv::Rect(0, 0, 50, 4)) = 0;
    cv::add(first, noise, second, cv::noArray(), CV_8U);
    LiveView view;
    view.add(frame_of(first, 8, Instant(7s)));
    EXPECT_NEAR(view.figures().mean, 115.5, 1e-9);
    EXPECT_NEAR(view.figures().saturated, 0.1, 1e-9);
    view.add(frame_of(second, 8, Instant(7s + 40ms)));
    EXPECT_NEAR(view.figures().frames_per_second, 25.0, 1e-9);
    // Only one of the two is noisy: 5 sqrt(0.9) / sqrt(2), known to 1 / sqrt(2 * 2000) = 1.6 %.
    EXPECT_NEAR(view.figures().noise, 3.354, 5 * 0.016 * 3.354);
}

// The second differences of a step of 80 over one column are +-80 on two columns.
TEST(LiveView, MeasuresSharpnessByEdges) {
    cv::Mat sharp(20, 40, CV_8UC1, cv::Scalar(60)), soft = sharp.clone();
    sharp.colRange(20, 40) = 140;
    soft.col(20) = 100;
    soft.colRange(21, 40) = 140;
    LiveView sharp_view, soft_view;
    sharp_view.add(frame_of(sharp, 8, Instant(1s)));
    soft_view.add(frame_of(soft, 8, Instant(1s)));
    EXPECT_NEAR(sharp_view.figures().sharpness, 1000.0 * std::sqrt(2 * 80.0 * 80.0 / 40.0) / 100.0,
                1e-3);
    EXPECT_LT(soft_view.figures().sharpness, 0.6 * sharp_view.figures().sharpness);
}

TEST(LiveView, FitsATerminalOf80ColumnsAndSaysWhatIsWrong) {
    LiveView view;
    EXPECT_LT(view.line().size(), 80u);
    for (int i = 0; i < 2; ++i)
        view.add(frame_of(cv::Mat(9, 7, CV_16UC1, cv::Scalar(65535)), 16, Instant(i * 1ms)));
    Frame lost;
    lost.status = FrameStatus::lost;
    for (int i = 0; i < 12345; ++i)
        view.add(lost);
    EXPECT_NE(view.line().find("lost"), std::string::npos);
    view.add(frame_of(cv::Mat(9, 7, CV_16UC1, cv::Scalar(65535)), 16, Instant(9ms)));
    EXPECT_LT(view.line().size(), 80u) << view.line();
    EXPECT_NE(view.line().find("100.00 %"), std::string::npos);
    EXPECT_NE(view.line().find("bad 12345"), std::string::npos);
}

}  // namespace
}  // namespace etalon
