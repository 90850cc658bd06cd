#include "compare/match/overlay.h"

#include "tests/test.h"

namespace etalon {
namespace {

cv::Mat gray_image(std::initializer_list<float> values) {
    return cv::Mat(std::vector<float>(values), true).reshape(1, 1);
}

const cv::Mat all_inside = cv::Mat(1, 3, CV_8UC1, cv::Scalar(1));

TEST(RedCyanOverlay, IsRedWhereThePhotographIsBrighterAndCyanWhereTheRenderingIs) {
    // Pixels: photo brighter by 40, rendering brighter by 20, equal.
    const cv::Mat overlay =
        red_cyan_overlay(gray_image({140, 90, 70}), gray_image({100, 110, 70}), all_inside, 1.0);
    EXPECT_EQ(overlay.at<cv::Vec3b>(0), cv::Vec3b(100, 100, 140));  // blue, green, red
    EXPECT_EQ(overlay.at<cv::Vec3b>(1), cv::Vec3b(110, 110, 90));
    EXPECT_EQ(overlay.at<cv::Vec3b>(2), cv::Vec3b(70, 70, 70));
}

TEST(RedCyanOverlay, GainMultipliesTheDifferenceAndKeepsTheMean) {
    const cv::Mat overlay =
        red_cyan_overlay(gray_image({140, 90, 250}), gray_image({100, 110, 230}), all_inside, 3.0);
    EXPECT_EQ(overlay.at<cv::Vec3b>(0), cv::Vec3b(60, 60, 180));
    EXPECT_EQ(overlay.at<cv::Vec3b>(1), cv::Vec3b(130, 130, 70));
    EXPECT_EQ(overlay.at<cv::Vec3b>(2), cv::Vec3b(210, 210, 255)) << "cut at full scale";
}

TEST(RedCyanOverlay, ShowsThePhotographAloneOutsideTheMask) {
    cv::Mat mask = all_inside.clone();
    mask.at<uchar>(1) = 0;
    const cv::Mat overlay =
        red_cyan_overlay(gray_image({140, 90, 70}), gray_image({100, 0, 70}), mask, 1.0);
    const cv::Vec3b outside = overlay.at<cv::Vec3b>(1);
    EXPECT_EQ(outside[0], outside[1]);
    EXPECT_EQ(outside[1], outside[2]);
}

TEST(RedCyanOverlay, RefusesImagesOfDifferentSizes) {
    EXPECT_THROW(red_cyan_overlay(gray_image({1, 2, 3}), gray_image({1, 2}), all_inside, 1.0),
                 NumericalError);
}

TEST(ResidualMap, GoesFromCyanThroughWhiteToRed) {
    const cv::Mat map = residual_map(gray_image({0, 10, -10}), all_inside, 20.0);
    EXPECT_EQ(map.at<cv::Vec3b>(0), cv::Vec3b(255, 255, 255));
    const cv::Vec3b warm = map.at<cv::Vec3b>(1), cold = map.at<cv::Vec3b>(2);
    EXPECT_GT(warm[2], warm[0] + 50) << "red over blue";
    EXPECT_GT(cold[0], cold[2] + 50) << "blue over red";
}

TEST(ResidualMap, IsFullColourAtItsScaleAndBeyond) {
    const cv::Mat map = residual_map(gray_image({20, 500, -20}), all_inside, 20.0);
    EXPECT_EQ(map.at<cv::Vec3b>(0), map.at<cv::Vec3b>(1));
    EXPECT_NE(map.at<cv::Vec3b>(0), map.at<cv::Vec3b>(2));
}

TEST(ResidualMap, RefusesAScaleThatIsNotPositive) {
    EXPECT_THROW(residual_map(gray_image({0, 1, 2}), all_inside, 0.0), NumericalError);
}

}  // namespace
}  // namespace etalon
