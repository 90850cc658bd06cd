// Why nothing was found: the photographs are made so that the detector cannot find the marker.
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "compare/make_detector.h"
#include "compare/match/photo_findings.h"
#include "tests/compare/match/adversarial_photos.h"

namespace etalon {
namespace {

Findings missing(const CodeImage& photo) {
    const auto detector = make_detector("auto", test::tag_scene(0).marker, "test");
    EXPECT_FALSE(detector->detect(photo).corners);
    return examine_missing_marker(photo, *detector);
}

CodeImage tag_photo() {
    return test::exposed(test::radiance_of(test::tag_scene(0)), 1);
}

TEST(MissingMarker, IsFoundInTheNegativeOfANegative) {
    const Findings findings = missing(test::negative(tag_photo()));
    ASSERT_EQ(findings.size(), 1u);
    EXPECT_EQ(findings.front().name, "negative");
    EXPECT_TRUE(findings.front().is_not_assessable);
}

TEST(MissingMarker, IsFoundInTheMirroredPhotograph) {
    CodeImage photo = tag_photo();
    cv::Mat mirrored;
    cv::flip(photo.pixels, mirrored, 1);
    photo.pixels = mirrored;
    const Findings findings = missing(photo);
    ASSERT_EQ(findings.size(), 1u);
    EXPECT_EQ(findings.front().name, "mirrored");
}

TEST(MissingMarker, IsNotInAPhotographWithoutContrastOrAllWhite) {
    const cv::Size size(320, 240);
    const Findings gray = missing({cv::Mat(size, CV_8UC1, cv::Scalar(90)), 8});
    ASSERT_EQ(gray.size(), 1u);
    EXPECT_EQ(gray.front().name, "low_contrast");
    cv::Mat glaring(size, CV_8UC1, cv::Scalar(255));
    glaring.rowRange(0, 40) = 100;
    const Findings white = missing({glaring, 8});
    ASSERT_EQ(white.size(), 1u);
    EXPECT_EQ(white.front().name, "saturated");
    EXPECT_NEAR(white.front().value, 100.0 * 200 / 240, 0.1);
}

// Another tag, well exposed: nothing that was tried helps, and nothing is said.
TEST(MissingMarker, LeavesTheCauseOpenWhereNothingHelps) {
    test::TrueScene scene = test::tag_scene(0);
    scene.shown = parse_marker("apriltag:36h11:17@50mm", "test").grid;
    EXPECT_TRUE(missing(test::exposed(test::radiance_of(scene), 1)).empty());
    EXPECT_TRUE(
        examine_missing_marker({}, *make_detector("auto", test::tag_scene(0).marker, "test"))
            .empty());
}

}  // namespace
}  // namespace etalon
