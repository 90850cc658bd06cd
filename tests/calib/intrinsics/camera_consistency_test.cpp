// Sets of views of which some were taken with another zoom, focus or camera; from points projected
// here, 0.1 px of noise each.
#include "calib/intrinsics/camera_consistency.h"

#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon::test {
namespace {

TEST(MixedViews, OfAnotherCameraWithTheSameFocalLengthAreFoundByItsCentre) {
    CameraModel other = calibration_truth();
    other.intrinsics.cx += 18.0;
    other.intrinsics.cy -= 11.0;
    const auto groups = camera_groups(mixed({1, 4, 6, 9}, other), image_size);
    ASSERT_EQ(groups.size(), 2u);
    EXPECT_THAT(groups[1].views, ElementsAre(1u, 4u, 6u, 9u));
}

// A board that was found in the wrong order, or corners of dirt, are no other camera: the rules for
// outliers say so.
TEST(MixedViews, AreNotThoseWithWrongCorners) {
    auto views = mixed({}, calibration_truth());
    std::swap_ranges(views[3].pixels.begin(), views[3].pixels.begin() + 9,
                     views[3].pixels.begin() + 18);
    for (const int i : {7, 20, 33})
        views[8].pixels[std::size_t(i)].x() += 9.0;
    EXPECT_EQ(camera_groups(views, image_size).size(), 1u);
}

// A board that is seen in part determines little of a camera of its own.
TEST(MixedViews, OfFewPointsAreNotToldApart) {
    auto views = mixed({}, calibration_truth());
    for (const std::size_t i : {2u, 7u}) {
        views[i].points_mm = {views[i].points_mm[0], views[i].points_mm[4], views[i].points_mm[30],
                              views[i].points_mm[50]};
        views[i].pixels = {views[i].pixels[0], views[i].pixels[4], views[i].pixels[30],
                           views[i].pixels[50]};
    }
    EXPECT_EQ(camera_groups(views, image_size).size(), 1u);
}

// Without noise there is nothing to tell a difference by.
TEST(MixedViews, ExactViewsOfOneCameraAreOneGroup) {
    EXPECT_EQ(camera_groups(synthetic_views(calibration_truth(), 8, 0.0, 1), image_size).size(),
              1u);
}

}  // namespace
}  // namespace etalon::test
