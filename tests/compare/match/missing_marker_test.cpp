// Why nothing was found, and which tag stands there instead: the photographs are made so that the
// detector cannot find the marker.

#include "compare/match/overlay.h"
#include "tests/compare/match/adversarial_photos.h"
#include "tests/test.h"

namespace etalon {
namespace {

Findings missing(const CodeImage& photo) {
    const auto detector = make_detector("auto", tag_scene(0).marker, "test");
    EXPECT_FALSE(detector->detect(photo).corners);
    return examine_missing_marker(photo, *detector);
}

Finding only_finding(const CodeImage& photo) {
    const Findings findings = missing(photo);
    EXPECT_EQ(findings.size(), 1u);
    return findings.empty() ? Finding{} : findings.front();
}

CodeImage photo_of(const std::string& marker) {
    TrueScene scene = tag_scene(0);
    scene.shown = parse_marker(marker, "test").grid;
    return exposed(radiance_of(scene), 1);
}

CodeImage tag_photo() {
    return photo_of("apriltag:36h11:5@50mm");
}

TEST(MissingMarker, IsFoundInTheNegativeOfANegative) {
    const Finding finding = only_finding(negative(tag_photo()));
    EXPECT_EQ(finding.name, "negative");
    EXPECT_TRUE(finding.is_not_assessable);
}

TEST(MissingMarker, IsFoundInTheMirroredPhotograph) {
    cv::Mat mirrored;
    cv::flip(tag_photo().pixels, mirrored, 1);
    EXPECT_EQ(only_finding({mirrored, 8}).name, "mirrored");
}

TEST(MissingMarker, IsNotInAPhotographWithoutContrastOrAllWhite) {
    const cv::Size size(320, 240);
    EXPECT_EQ(only_finding({cv::Mat(size, CV_8UC1, cv::Scalar(90)), 8}).name, "low_contrast");
    cv::Mat glaring(size, CV_8UC1, cv::Scalar(255));
    glaring.rowRange(0, 40) = 100;
    const Finding white = only_finding({glaring, 8});
    EXPECT_EQ(white.name, "saturated");
    EXPECT_NEAR(white.value, 100.0 * 200 / 240, 0.1);
}

// Another tag, well exposed: nothing that was tried helps, and nothing is said.
TEST(MissingMarker, LeavesTheCauseOpenWhereNothingHelps) {
    EXPECT_TRUE(missing(photo_of("apriltag:36h11:17@50mm")).empty());
    EXPECT_TRUE(
        examine_missing_marker({}, *make_detector("auto", tag_scene(0).marker, "test")).empty());
}

std::vector<std::string> seen_in(const CodeImage& photo, const std::string& wanted) {
    return tags_in_view(photo, parse_marker(wanted, "test"));
}

using Names = std::vector<std::string>;

TEST(TagsInView, NamesFamilyAndIdOfWhatIsNotWanted) {
    for (const std::string shown : {"apriltag:36h11:17", "apriltag:25h9:3", "aruco:6X6_50:7",
                                    "aruco:4X4_50:11", "aruco:5X5_250:175"})
        EXPECT_EQ(seen_in(photo_of(shown + "@50mm"), "apriltag:36h11:5@50mm"), Names{shown});
}

// OpenCV has no dictionary of them: only who wants one can see its neighbour.
TEST(TagsInView, LooksForTheWantedFamilyFirst) {
    EXPECT_EQ(seen_in(photo_of("apriltag:Standard41h12:9@30mm"), "apriltag:Standard41h12:4@30mm"),
              Names{"apriltag:Standard41h12:9"});
    EXPECT_EQ(seen_in(photo_of("aruco:5X5_250:7@50mm"), "aruco:5X5_250:8@50mm"),
              Names{"aruco:5X5_250:7"});
}

TEST(TagsInView, SeesNothingInAGrayImage) {
    EXPECT_TRUE(
        seen_in({cv::Mat(240, 320, CV_8UC1, cv::Scalar(130)), 8}, "aruco:4X4_50:7@50mm").empty());
}

// ---- overlay

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
