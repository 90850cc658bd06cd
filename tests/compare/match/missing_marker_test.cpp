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

Finding only_finding(const CodeImage& photo) {
    const Findings findings = missing(photo);
    EXPECT_EQ(findings.size(), 1u);
    return findings.empty() ? Finding{} : findings.front();
}

CodeImage tag_photo() {
    return test::exposed(test::radiance_of(test::tag_scene(0)), 1);
}

TEST(MissingMarker, IsFoundInTheNegativeOfANegative) {
    const Finding finding = only_finding(test::negative(tag_photo()));
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
    test::TrueScene scene = test::tag_scene(0);
    scene.shown = parse_marker("apriltag:36h11:17@50mm", "test").grid;
    EXPECT_TRUE(missing(test::exposed(test::radiance_of(scene), 1)).empty());
    EXPECT_TRUE(
        examine_missing_marker({}, *make_detector("auto", test::tag_scene(0).marker, "test"))
            .empty());
}

}  // namespace
}  // namespace etalon
