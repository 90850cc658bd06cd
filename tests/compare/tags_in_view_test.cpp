// Which tag stands in another one's place.
#include "compare/make_detector.h"

#include <gtest/gtest.h>

#include "tests/compare/match/adversarial_photos.h"

namespace etalon {
namespace {

CodeImage photo_of(const std::string& marker) {
    test::TrueScene scene = test::tag_scene(0);
    scene.shown = parse_marker(marker, "test").grid;
    return test::exposed(test::radiance_of(scene), 1);
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

}  // namespace
}  // namespace etalon
