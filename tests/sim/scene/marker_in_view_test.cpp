#include "core/geometry/units.h"
#include "sim/scene/marker_view.h"

#include <gtest/gtest.h>

#include <limits>
#include <numbers>

namespace etalon {
namespace {

CameraModel camera_with(const Distortion& distortion) {
    CameraModel camera;
    camera.width = 640;
    camera.height = 480;
    camera.intrinsics = {500.0, 500.0, 319.5, 239.5};
    camera.distortion = distortion;
    return camera;
}

// 12 x 1 cells of 20 mm, the origin in the middle.
CellGrid wide_grid() {
    return {cv::Mat_<float>(1, 12, 0.5f), {-120.0, -10.0}, {20.0, 20.0}};
}

Rigid turned(double angle, const Eigen::Vector3d& axis, const Eigen::Vector3d& position) {
    return {Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis)), position};
}

// At 500 mm a mm is a pixel: columns 200 - 120 and 200 + 120 at x = -119.5 mm, the row 239.5 - 10.
TEST(MarkerInView, KeepsTheMarginToEachBorder) {
    const Projector projector(camera_with({}));
    const CellGrid grid = wide_grid();
    const auto is_seen = [&](double x, double y, double margin) {
        return is_in_view(projector, grid, {Eigen::Quaterniond::Identity(), {x, y, 500.0}}, margin);
    };
    EXPECT_TRUE(is_seen(-119.5, 0.0, 79.9));
    EXPECT_FALSE(is_seen(-119.5, 0.0, 80.1));
    EXPECT_TRUE(is_seen(150.5, 0.0, 48.9));  // 639 - (319.5 + 150.5 + 120)
    EXPECT_FALSE(is_seen(150.5, 0.0, 49.1));
    EXPECT_TRUE(is_seen(0.0, -199.5, 29.9));
    EXPECT_FALSE(is_seen(0.0, -199.5, 30.1));
    EXPECT_TRUE(is_seen(0.0, 180.5, 48.9));  // 479 - (239.5 + 180.5 + 10)
    EXPECT_FALSE(is_seen(0.0, 180.5, 49.1));
}

// Of the upper edge, 200 mm above the axis at 500 mm, the middle is at y = -0.4 and the ends at
// x = +-0.24, y = -0.4. With k1 = -0.3 the ends come to row 239.5 - 500 * 0.4 (1 - 0.3 * 0.2176)
// = 52.6, the middle to 239.5 - 500 * 0.4 (1 - 0.3 * 0.16) = 49.1.
TEST(MarkerInView, CountsAnEdgeThatBulgesOutBetweenItsEnds) {
    const Projector projector(camera_with({.k1 = -0.3}));
    const Rigid pose{Eigen::Quaterniond::Identity(), {0.0, -190.0, 500.0}};
    EXPECT_TRUE(is_in_view(projector, wide_grid(), pose, 49.0));
    EXPECT_FALSE(is_in_view(projector, wide_grid(), pose, 49.2));
}

TEST(MarkerInView, RefusesTheBackAndWhatIsNotInFrontOfTheCamera) {
    const Projector projector(camera_with({}));
    const CellGrid grid = wide_grid();
    const Eigen::Vector3d y_axis = Eigen::Vector3d::UnitY();
    EXPECT_TRUE(is_in_view(projector, grid, turned(80.0 * rad_per_deg, y_axis, {0, 0, 500}), 5.0));
    EXPECT_FALSE(
        is_in_view(projector, grid, turned(100.0 * rad_per_deg, y_axis, {0, 0, 500}), 5.0));
    EXPECT_FALSE(is_in_view(projector, grid, turned(0.0, y_axis, {0, 0, -500}), 5.0));
    // One end 18 mm behind the camera.
    EXPECT_FALSE(is_in_view(projector, grid, turned(80.0 * rad_per_deg, y_axis, {0, 0, 100}), 5.0));
    // The camera is 1.8 mm behind the marker's plane, and 3.1 mm before it.
    EXPECT_FALSE(
        is_in_view(projector, grid, turned(80.0 * rad_per_deg, y_axis, {-90, 0, 500}), 5.0));
    EXPECT_TRUE(
        is_in_view(projector, grid, turned(80.0 * rad_per_deg, y_axis, {-85, 0, 500}), 5.0));
}

// The plane through (0, 0, 500), turned by 89 degrees, passes the camera at 500 cos 89 = 8.7 mm: a
// lens of 8.5 mm radius reaches 8.5 sin 89 towards it, one of 8.9 mm through it. f = 500 px * 20 um
// = 10 mm (focused at infinity), so these are N = 10 / 17 and 10 / 17.8.
TEST(MarkerInView, WantsTheWholeLensBeforeTheMarkersPlane) {
    CameraModel camera = camera_with({});
    camera.sensor = Sensor{.pixel_pitch_um = 20.0};
    const Rigid pose = turned(89.0 * rad_per_deg, Eigen::Vector3d::UnitY(), {0, 0, 500});
    camera.lens = Lens{10.0 / 17.0, std::numeric_limits<double>::infinity(), 600.0, {}};
    EXPECT_TRUE(is_in_view(Projector(camera), wide_grid(), pose, 5.0));
    camera.lens->f_number = 10.0 / 17.8;
    EXPECT_FALSE(is_in_view(Projector(camera), wide_grid(), pose, 5.0));
}

// Rays of a telecentric lens are inclined by up to asin(0.2) = 11.5 degrees wherever the marker is:
// tilted by 78 degrees all of them see its front, by 79 not.
TEST(MarkerInView, WantsTheWholeConeOfATelecentricLensBeforeTheMarkersPlane) {
    CameraModel camera = camera_with({});
    camera.projection.kind = Projection::telecentric;
    camera.intrinsics = {2.0, 2.0, 319.5, 239.5};  // px/mm
    camera.sensor = Sensor{.pixel_pitch_um = 5.0};
    camera.lens = Lens{.focus_distance_mm = 200.0, .wavelength_nm = 600.0, .object_na = 0.2};
    const Projector projector(camera);
    for (const double x : {-30.0, 0.0, 60.0}) {
        const auto tilted = [&](double angle) {
            return turned(angle * rad_per_deg, Eigen::Vector3d::UnitY(), {x, 0, 300});
        };
        EXPECT_TRUE(is_in_view(projector, wide_grid(), tilted(78.0), 5.0)) << x;
        EXPECT_FALSE(is_in_view(projector, wide_grid(), tilted(79.0), 5.0)) << x;
    }
}

}  // namespace
}  // namespace etalon
