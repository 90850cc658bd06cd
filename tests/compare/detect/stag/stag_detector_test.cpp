// Truth: markers rendered exactly at known poses, corners where the projector puts them; and images
// made by OpenCV's warping, with and without markers.

#include "tests/compare/detect/stag/stag_images.h"
#include "tests/compare/rendered_tags.h"
#include "tests/test.h"

namespace etalon {
namespace {

Marker marker(const std::string& spec) {
    return parse_marker(spec, "test");
}

// A sharp edge without noise is found to some hundredths of a pixel; a wrong order of the corners
// would be off by the side, 120 px. R16 is our own family.
TEST(StagDetector, FindsTheCornersFromTheTopLeftClockwiseHoweverTheMarkerIsTurned) {
    for (const auto& [spec, tilt, turn] : {std::tuple("stag:HD21:5@50mm", -0.3, 0.3),
                                           {"stag:HD21:5@50mm", -0.3, 1.9},
                                           {"stag:HD21:5@50mm", -0.3, 3.4},
                                           {"stag:HD21:5@50mm", -0.3, 5.1},
                                           {"stag:R16:101@50mm", -0.5, 2.0}}) {
        const Marker stag = marker(spec);
        const auto photo = render_tag(sharp_camera(), stag, {0.2, tilt, turn, 10, -7, 290});
        EXPECT_LT(detection_error_px(stag, photo.image, photo.corners), 0.1) << turn;
    }
}

// The fourth corner is where the two sides meet that go to it, and the circle helps to place it.
TEST(StagDetector, PlacesACornerThatIsHidden) {
    const Marker stag = marker("stag:HD21:5@50mm");
    const auto photo = render_tag(sharp_camera(), stag, {0.4, -0.3, 0.2, 0, 0, 250});
    for (std::size_t hidden = 0; hidden < 4; ++hidden) {
        CodeImage covered{photo.image.pixels.clone(), 8};
        const Eigen::Vector2d corner = photo.corners[hidden];
        cv::circle(covered.pixels,
                   cv::Point(static_cast<int>(corner.x()), static_cast<int>(corner.y())), 14,
                   cv::Scalar(120), cv::FILLED);
        EXPECT_LT(detection_error_px(stag, covered, photo.corners), 0.2) << hidden;
    }
}

// A marker seen at 250 mm, with a start for its refinement.
struct Seen {
    cv::Mat pixels;  // CV_32FC1
    Quad truth;

    Seen() {
        const auto photo =
            render_tag(sharp_camera(), marker("stag:HD21:5@50mm"), {0.4, -0.3, 0.2, 0, 0, 250});
        photo.image.pixels.convertTo(pixels, CV_32F);
        std::ranges::copy(photo.corners, truth.begin());
    }
    auto refined_from(const Eigen::Vector2d& shift) const {
        Quad start = truth;
        start[0] += shift;
        start[2] -= shift;
        return refine_stag(pixels, homography_to(start).value(), stag_codes("HD21")[5], 255.0);
    }
};

TEST(StagRefinement, FindsTheCornersFromTwoPixelsAway) {
    const Seen seen;
    const auto refined = seen.refined_from({1.2, -1.6});
    ASSERT_TRUE(refined);
    for (std::size_t i = 0; i < 4; ++i)
        EXPECT_LT(((*refined)[i] - seen.truth[i]).norm(), 0.05) << "corner " << i;
}

// Of a marker whose upper and right half is hidden, nothing says where its upper right corner is.
TEST(StagRefinement, GivesNoCornersThatTheEdgesDoNotFix) {
    Seen seen;
    const Eigen::Vector2d hidden = seen.truth[1];
    cv::circle(seen.pixels, cv::Point(static_cast<int>(hidden.x()), static_cast<int>(hidden.y())),
               150, cv::Scalar(100.0), cv::FILLED);
    EXPECT_FALSE(seen.refined_from({0.0, 0.0}));
    seen.pixels.setTo(cv::Scalar(100.0));
    EXPECT_FALSE(seen.refined_from({0.0, 0.0}));
}

TEST(StagDetector, SurvivesNoiseOfAnySize) {
    const auto detector = make_detector("auto", marker("stag:HD21:5@50mm"), "test");
    for (int i = 0; i < 60; ++i) {
        cv::Mat noise(1 + (i * 37) % 90, 1 + (i * 53) % 110, CV_8UC1);
        cv::RNG(static_cast<std::uint64_t>(i)).fill(noise, cv::RNG::UNIFORM, 0, 256);
        EXPECT_FALSE(detector->detect({noise, 8}).corners);
    }
}

// The share of the unit tests in tests/evidence/stag_false_ids.cpp, which goes on to 100 000
// images.
TEST(StagFinder, TakesNothingElseForAMarker) {
    const std::vector<StagCode> words = stag_codes("R16");
    const StagImages source(words, 77);
    StagTally tally;
    for (std::uint64_t number = 0; number < 160; ++number) {
        const StagImage image = source.make(number);
        tally.add(image, find_stags({image.pixels, 8}, words, 4));
    }
    EXPECT_EQ(tally.false_ids, 0);
    EXPECT_EQ(tally.misplaced, 0);
    EXPECT_GE(tally.found, 10);  // of 40 markers, many of them partly outside the image
}

}  // namespace
}  // namespace etalon
