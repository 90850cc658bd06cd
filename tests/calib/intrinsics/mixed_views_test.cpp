// Sets of views of which some were taken with another zoom, focus or camera; from points projected
// here, 0.1 px of noise each.
#include "calib/intrinsics/mixed_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/calib/synthetic_views.h"

namespace etalon::test {
namespace {

using testing::ElementsAre;

constexpr double noise_px = 0.1;

CameraModel zoomed(double zoom, double distortion = 1.0) {
    CameraModel camera = calibration_truth();
    camera.intrinsics.fx *= zoom;
    camera.intrinsics.fy *= zoom;
    camera.distortion.k1 *= distortion;
    camera.distortion.k2 *= distortion;
    return camera;
}

// Twelve views, those of `aside` with another camera.
std::vector<CalibrationView> mixed(const std::vector<std::size_t>& aside, const CameraModel& other,
                                   int seed = 5) {
    auto views = synthetic_views(calibration_truth(), 12, noise_px, seed);
    for (const std::size_t i : aside)
        views[i] = synthetic_view(other, synthetic_pose(int(i)), noise_px, 500 + int(i));
    return views;
}

struct Mix {
    std::vector<std::size_t> aside;
    double zoom, distortion;
};

class MixedViews : public testing::TestWithParam<Mix> {};

// Half a set may be either the largest group or the other.
TEST_P(MixedViews, AreToldApart) {
    const Mix& mix = GetParam();
    auto groups = camera_groups(mixed(mix.aside, zoomed(mix.zoom, mix.distortion)), image_size);
    ASSERT_EQ(groups.size(), 2u);
    EXPECT_GE(groups[0].views.size(), groups[1].views.size());
    if (groups[0].views == mix.aside)
        std::swap(groups[0], groups[1]);
    EXPECT_EQ(groups[1].views, mix.aside);
    const double truth = 537.0;  // (541 + 533) / 2
    EXPECT_NEAR(groups[0].focal_px, truth, 5.0 * groups[0].deviation_px);
    EXPECT_LT(groups[0].deviation_px, 2.0);
    // Of one view with the others' distortion the focal length makes up for its own.
    const double by_distortion = mix.aside.size() < 3 && mix.distortion != 1.0 ? 6.0 : 0.0;
    EXPECT_NEAR(groups[1].focal_px, mix.zoom * truth, 5.0 * groups[1].deviation_px + by_distortion);
    EXPECT_LT(groups[1].deviation_px, 8.0);
}

using I = std::vector<std::size_t>;
INSTANTIATE_TEST_SUITE_P(OneThreeAndSixOfTwelve, MixedViews,
                         testing::Values(Mix{I{5}, 1.03, 1.0}, Mix{I{5}, 0.97, 0.8},
                                         Mix{I{0}, 1.3, 0.8}, Mix{I{0, 5, 8}, 1.03, 1.0},
                                         Mix{I{0, 5, 8}, 0.97, 0.8}, Mix{I{0, 1, 2}, 1.3, 1.0},
                                         Mix{I{0, 1, 2, 3, 4, 5}, 0.97, 1.0},
                                         Mix{I{0, 2, 5, 6, 8, 10}, 1.03, 0.8},
                                         Mix{I{0, 2, 5, 6, 8, 10}, 1.3, 0.8}));

TEST(MixedViews, OfAnotherCameraWithTheSameFocalLengthAreFoundByItsCentre) {
    CameraModel other = calibration_truth();
    other.intrinsics.cx += 18.0;
    other.intrinsics.cy -= 11.0;
    const auto groups = camera_groups(mixed({1, 4, 6, 9}, other), image_size);
    ASSERT_EQ(groups.size(), 2u);
    EXPECT_THAT(groups[1].views, ElementsAre(1u, 4u, 6u, 9u));
}

TEST(MixedViews, OfThreeZoomsAreThreeGroups) {
    auto views = mixed({0, 5, 8}, zoomed(1.3));
    for (const int i : {1, 4, 9})
        views[std::size_t(i)] = synthetic_view(zoomed(1.12), synthetic_pose(i), noise_px, 700 + i);
    const auto groups = camera_groups(views, image_size);
    ASSERT_EQ(groups.size(), 3u);
    EXPECT_THAT(groups[0].views, ElementsAre(2u, 3u, 6u, 7u, 10u, 11u));
    for (const auto& group : {groups[1], groups[2]})
        EXPECT_THAT(group.views, testing::AnyOf(ElementsAre(0u, 5u, 8u), ElementsAre(1u, 4u, 9u)));
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

TEST(MixedViews, NeedFiveViewsThatDetermineACamera) {
    auto views = mixed({0}, zoomed(1.3));
    views.resize(4);
    const auto groups = camera_groups(views, image_size);
    ASSERT_EQ(groups.size(), 1u);
    EXPECT_EQ(groups[0].views.size(), 4u);
    const std::vector<CalibrationView> alike(6, mixed({}, calibration_truth())[2]);
    EXPECT_EQ(camera_groups(alike, image_size).size(), 1u);  // determine nothing
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
