// How often an honest set is split: camera_groups() allows one in 100 000. And how mixed sets are
// told apart.

#include "calib/intrinsics/camera_consistency.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon::test {
namespace {

// As photos err: each view as a whole as much as all of its points do, the board bent by a
// paraboloid of its own, 0.15 mm from middle to corner.
CalibrationView bent(CalibrationView view, const CameraModel& camera, const Rigid& pose, int seed) {
    RandomStream random(seed, 2);
    const double across = 0.15 * random.normal(), along = 0.15 * random.normal();
    const Projector projector(camera);
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const Eigen::Vector3d flat = view.points_mm[i];
        const double x = (flat.x() - 100.0) / 100.0, y = (flat.y() - 62.5) / 62.5;
        const Eigen::Vector3d curled(flat.x(), flat.y(), across * x * x + along * y * y);
        view.pixels[i] +=
            projector.project(pose * curled).value() - projector.project(pose * flat).value();
    }
    return view;
}

// 120 sets each: that one is split has a chance of 0.0012 where views err independently.
void expect_no_split(bool with_bent_boards) {
    const CameraModel camera = calibration_truth();
    int split = 0;
    for (int set = 0; set < 120; ++set) {
        auto views = synthetic_views(camera, 8 + set % 7, 0.15, 100 + set);
        if (with_bent_boards)
            for (std::size_t i = 0; i < views.size(); ++i)
                views[i] = bent(views[i], camera, synthetic_pose(int(i)), 1000 * set + int(i));
        split += camera_groups(views, image_size).size() > 1 ? 1 : 0;
    }
    EXPECT_EQ(split, 0);
}

TEST(MixedViewsStatistics, SetsOfOneCameraAreNotSplit) {
    expect_no_split(false);
}
TEST(MixedViewsStatistics, NorThoseOfBentBoards) {
    expect_no_split(true);
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

TEST(MixedViews, OfThreeZoomsAreThreeGroups) {
    auto views = mixed({0, 5, 8}, zoomed(1.3));
    for (const int i : {1, 4, 9})
        views[std::size_t(i)] =
            synthetic_view(zoomed(1.12), synthetic_pose(i), mixed_noise_px, 700 + i);
    const auto groups = camera_groups(views, image_size);
    ASSERT_EQ(groups.size(), 3u);
    EXPECT_THAT(groups[0].views, ElementsAre(2u, 3u, 6u, 7u, 10u, 11u));
    for (const auto& group : {groups[1], groups[2]})
        EXPECT_THAT(group.views, testing::AnyOf(ElementsAre(0u, 5u, 8u), ElementsAre(1u, 4u, 9u)));
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

}  // namespace
}  // namespace etalon::test
