// How often an honest set is split: camera_groups() allows one in 100 000.
#include <gtest/gtest.h>

#include "calib/intrinsics/mixed_views.h"
#include "core/random.h"
#include "tests/calib/synthetic_views.h"

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

}  // namespace
}  // namespace etalon::test
