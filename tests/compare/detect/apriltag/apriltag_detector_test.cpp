// Truth: tags rendered exactly at known poses; corners where the projector puts them.
#include <gtest/gtest.h>

#include "compare/detect/detector_adaptors.h"
#include "compare/make_detector.h"
#include "core/program/errors.h"
#include "tests/compare/rendered_tags.h"

namespace etalon {
namespace {

using test::mean_offset;
using test::sharp_camera;

TEST(ApriltagDetector, FindsTheCornersFromTheTopLeftClockwise) {
    const Marker tag = parse_marker("apriltag:36h11:5@50mm", "test");
    const auto detector = make_detector("auto", tag, "test");
    EXPECT_EQ(detector->name(), "apriltag");
    const test::RenderedTag photo =
        test::render_tag(sharp_camera(), tag, {0.1, -0.2, 0.3, 10, -7, 300});
    const auto found = detector->detect(photo.image).corners;
    ASSERT_TRUE(found);
    EXPECT_EQ(found->id, 5);
    ASSERT_EQ(found->pixels.size(), 4u);
    for (std::size_t i = 0; i < 4; ++i)
        EXPECT_LT((found->pixels[i] - photo.corners[i]).norm(), 0.5) << "corner " << i;
}

// The library's half pixel is undone: without that the mean offset would be +0.5 px in x and in y.
// 40 poses with 4 corners; a corner's own scatter is about 0.05 px, so the mean's standard
// deviation is 0.05 / sqrt(160) = 0.004 px: 0.02 px is five of them.
TEST(ApriltagDetector, HasNoMeanOffset) {
    const Marker tag = parse_marker("apriltag:36h11:17@50mm", "test");
    const auto detector = make_detector("apriltag", tag, "test");
    const test::Offsets offsets = mean_offset(test::tag_photos(sharp_camera(), tag, 40), *detector);
    EXPECT_GE(offsets.detected, 38);
    EXPECT_LT(std::abs(offsets.mean.x()), 0.02);
    EXPECT_LT(std::abs(offsets.mean.y()), 0.02);
    std::printf("AprilTag: mean offset %+.4f, %+.4f px, inward %+.4f px, %d poses\n",
                offsets.mean.x(), offsets.mean.y(), offsets.inward, offsets.detected);
}

TEST(ApriltagDetector, SeesTwelveBitImagesAsItSeesEightBitOnes) {
    const Marker tag = parse_marker("apriltag:36h11:5@50mm", "test");
    const auto photo = test::render_tag(sharp_camera(), tag, {0.2, 0.1, 0, 3, 5, 300});
    CodeImage deep{{}, 12};
    photo.image.pixels.convertTo(deep.pixels, CV_16U, 4095.0 / 255.0);
    const auto detector = make_detector("auto", tag, "test");
    const auto eight = detector->detect(photo.image).corners,
               twelve = detector->detect(deep).corners;
    ASSERT_TRUE(eight && twelve);
    for (std::size_t i = 0; i < 4; ++i)
        EXPECT_LT((eight->pixels[i] - twelve->pixels[i]).norm(), 1e-9);
}

TEST(MakeDetector, RefusesUnknownNames) {
    const Marker tag = parse_marker("apriltag:36h11:5@50mm", "test");
    EXPECT_THROW(make_detector("apriltags", tag, "--detector"), ConfigError);
}

}  // namespace
}  // namespace etalon
