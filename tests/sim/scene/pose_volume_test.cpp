#include "sim/scene/pose_volume.h"

#include <opencv2/calib3d.hpp>

#include "core/geometry/units.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

CameraModel webcam() {
    return test::camera_with(640, 480, {822.3, 818.7, 319.5, 242.5},
                             {.k1 = -0.045, .k2 = 1.17, .k3 = -3.63});
}

// Strong distortion that holds for the whole image: rays of up to 60 degrees.
CameraModel barrel_camera() {
    return test::camera_with(1200, 900, {500.0, 505.0, 611.0, 438.0},
                             {.k1 = -0.28, .k2 = 0.08, .p1 = 0.002, .p2 = -0.003, .s1 = 0.001});
}

// `columns` by `rows` cells of 10 mm from a corner.
CellGrid grid_of(int columns, int rows, const Eigen::Vector2d& corner_mm) {
    return {cv::Mat_<float>(rows, columns, 0.5f), corner_mm, {10.0, 10.0}};
}

CellGrid centred_grid(int columns, int rows) {
    return grid_of(columns, rows, {-5.0 * columns, -5.0 * rows});
}

// Depth, roll, pitch and yaw wide; x and y all that is seen.
PoseVolume seen_volume() {
    return {.z_mm = {400.0, 1500.0},
            .roll = {-70.0 * rad_per_deg, 60.0 * rad_per_deg},
            .pitch = {-55.0 * rad_per_deg, 75.0 * rad_per_deg},
            .yaw = {-180.0 * rad_per_deg, 180.0 * rad_per_deg},
            .margin_px = 13.0};
}

std::vector<PoseSampler::Sample> samples_of(PoseSampler sampler, std::size_t count) {
    std::vector<PoseSampler::Sample> samples;
    while (samples.size() < count)
        samples.push_back(sampler.next());
    return samples;
}

std::vector<PoseSampler::Sample> samples_of(const CameraModel& camera,
                                            const std::vector<CellGrid>& grids,
                                            const PoseVolume& volume, SequenceKind kind,
                                            std::size_t count, std::uint64_t seed = 5) {
    return samples_of(PoseSampler(camera, grids, volume, kind, seed), count);
}

// OpenCV's projection, independent of calib/camera/projector.h.
cv::Point2d opencv_pixel(const CameraModel& camera, const Eigen::Vector3d& p) {
    const Intrinsics& i = camera.intrinsics;
    const cv::Matx33d k(i.fx, 0, i.cx, 0, i.fy, i.cy, 0, 0, 1);
    const auto c = camera.distortion.in_opencv_order();
    std::vector<cv::Point2d> pixels;
    cv::projectPoints(std::vector<cv::Point3d>{{p.x(), p.y(), p.z()}}, cv::Vec3d(), cv::Vec3d(), k,
                      std::vector<double>(c.begin(), c.end()), pixels);
    return pixels.front();
}

// The nearest that a pixel comes to the border of the image, from its outermost pixels' centres.
double depth_in_image(const CameraModel& camera, const cv::Point2d& q) {
    return std::min({q.x, q.y, camera.width - 1 - q.x, camera.height - 1 - q.y});
}

// Over the outline in steps of a fifth of a cell; -infinity where some of it is behind the camera.
double outline_depth(const CameraModel& camera, const CellGrid& grid, const Rigid& pose) {
    double least = std::numeric_limits<double>::infinity();
    const double columns = grid.columns(), rows = grid.rows();
    const auto look = [&](double u, double v) {
        const Eigen::Vector3d p = pose * grid.point_mm(u, v);
        least = std::min(least, p.z() > 0.0 ? depth_in_image(camera, opencv_pixel(camera, p))
                                            : -std::numeric_limits<double>::infinity());
    };
    for (double u = 0.0; u <= columns; u += 0.2)
        look(u, 0.0), look(u, rows);
    for (double v = 0.0; v <= rows; v += 0.2)
        look(0.0, v), look(columns, v);
    return least;
}

bool shows_front(const Rigid& pose) {
    return (pose.rotation * Eigen::Vector3d::UnitZ()).dot(pose.translation) > 0.0;
}

// The largest distance of the values' distribution from the uniform one in the interval
// (Kolmogorov and Smirnov); 1 when one lies outside.
double distance_from_uniform(std::vector<double> values, const Interval& interval) {
    std::sort(values.begin(), values.end());
    if (values.front() < interval.low || values.back() > interval.high)
        return 1.0;
    double distance = 0.0;
    const auto count = static_cast<double>(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
        const double x = (values[i] - interval.low) / (interval.high - interval.low);
        const auto below = static_cast<double>(i);
        distance = std::max({distance, x - below / count, (below + 1.0) / count - x});
    }
    return distance;
}

class AnyKind : public testing::TestWithParam<SequenceKind> {};

// All of the volume is seen, so nothing is left out. The first N points of a sequence in base b are
// blocks of b^k, at most b - 1 of each size, and as many again before a random start is aligned;
// each is off by one point at most: 2 (b - 1) ceil(log_b N) / N. Of N = 2000 that is 0.011 in base
// 2 and 0.024, 0.04 and 0.036 in bases 7, 11 and 13. Random points: 0.03 typically.
TEST_P(AnyKind, IsUniformOnEveryAxis) {
    const PoseVolume volume{.x_mm = Interval{-30.0, 80.0},
                            .y_mm = Interval{-70.0, 50.0},
                            .z_mm = {800.0, 1300.0},
                            .roll = {-0.3, 0.5},
                            .pitch = {-0.4, 0.2},
                            .yaw = {-3.0, 2.0},
                            .margin_px = 13.0};
    const auto samples = samples_of(webcam(), {centred_grid(3, 2)}, volume, GetParam(), 2000);
    std::array<std::vector<double>, 6> axes;
    for (std::size_t i = 0; i < samples.size(); ++i) {
        EXPECT_EQ(samples[i].index, i);
        const Rigid& pose = samples[i].camera_from_marker;
        const Eigen::Vector3d angles = roll_pitch_yaw(pose.rotation);
        for (Eigen::Index k = 0; k < 3; ++k) {
            axes[static_cast<std::size_t>(k)].push_back(pose.translation[k]);
            axes[static_cast<std::size_t>(k + 3)].push_back(angles[k]);
        }
    }
    const Interval intervals[] = {*volume.x_mm, *volume.y_mm, volume.z_mm,
                                  volume.roll,  volume.pitch, volume.yaw};
    for (std::size_t axis = 0; axis < 6; ++axis) {
        // A rounding error of the angles beyond the ends is none.
        const Interval within{intervals[axis].low - 1e-12, intervals[axis].high + 1e-12};
        EXPECT_LT(distance_from_uniform(axes[axis], within), 0.04) << "axis " << axis;
    }
}

TEST_P(AnyKind, BeginsWithTheFewerPosesAndDependsOnTheSeed) {
    const std::vector<CellGrid> grids{centred_grid(8, 8)};
    const auto few = samples_of(barrel_camera(), grids, seen_volume(), GetParam(), 20);
    const auto many = samples_of(barrel_camera(), grids, seen_volume(), GetParam(), 50);
    const auto other = samples_of(barrel_camera(), grids, seen_volume(), GetParam(), 20, 7);
    for (std::size_t i = 0; i < few.size(); ++i) {
        EXPECT_EQ(few[i].index, many[i].index);
        EXPECT_EQ(few[i].camera_from_marker.translation, many[i].camera_from_marker.translation);
        EXPECT_EQ(few[i].camera_from_marker.rotation.coeffs(),
                  many[i].camera_from_marker.rotation.coeffs());
        EXPECT_NE(few[i].camera_from_marker.translation.z(),
                  other[i].camera_from_marker.translation.z());
    }
}

// The disturbances are sampled with the poses and change nothing of them.
TEST_P(AnyKind, GivesExtraCoordinatesAfterThePoses) {
    const std::vector<CellGrid> grids{centred_grid(2, 2)};
    const auto without = samples_of(webcam(), grids, seen_volume(), GetParam(), 500);
    const auto with =
        samples_of(PoseSampler(webcam(), grids, seen_volume(), GetParam(), 5, 10), 500);
    std::vector<std::vector<double>> extra(10);
    for (std::size_t i = 0; i < with.size(); ++i) {
        EXPECT_TRUE(without[i].extra.empty());
        EXPECT_EQ(with[i].camera_from_marker.translation,
                  without[i].camera_from_marker.translation);
        ASSERT_EQ(with[i].extra.size(), 10u);
        for (std::size_t k = 0; k < 10; ++k)
            extra[k].push_back(with[i].extra[k]);
    }
    // Independent points: 1.95 / sqrt(500) in 999 of 1000 cases.
    for (const auto& coordinates : extra)
        EXPECT_LT(distance_from_uniform(coordinates, {0.0, 1.0}), 0.087);
}

INSTANTIATE_TEST_SUITE_P(AllKinds, AnyKind,
                         testing::Values(SequenceKind::halton, SequenceKind::halton_faure,
                                         SequenceKind::sobol));

// The corners to rounding. An edge that bulges out by 40 px between its ends may pass the seven
// points of it by a sixty-fourth of that.
void expect_in_view(const CameraModel& camera, const std::vector<CellGrid>& grids) {
    double nearest = 1e9;
    for (const auto& sample : samples_of(camera, grids, seen_volume(), SequenceKind::sobol, 200))
        for (const CellGrid& grid : grids) {
            const Rigid& pose = sample.camera_from_marker;
            EXPECT_TRUE(shows_front(pose));
            for (const int u : {0, grid.columns()})
                for (const int v : {0, grid.rows()}) {
                    const Eigen::Vector3d p = pose * grid.point_mm(u, v);
                    ASSERT_GT(p.z(), 0.0);
                    EXPECT_GT(depth_in_image(camera, opencv_pixel(camera, p)), 13.0 - 1e-6);
                }
            const double least = outline_depth(camera, grid, pose);
            EXPECT_GT(least, 13.0 - 40.0 / 64.0);
            nearest = std::min(nearest, least);
        }
    EXPECT_LT(nearest, 20.0);  // and goes to the border
}

// A chessboard's origin is an inner corner; of three grids none is within another.
TEST(WholeMarker, IsInViewAtEveryPose) {
    expect_in_view(webcam(), {centred_grid(8, 8)});
    expect_in_view(barrel_camera(), {centred_grid(8, 8)});
    expect_in_view(barrel_camera(), {centred_grid(60, 7)});
    expect_in_view(barrel_camera(),
                   {centred_grid(5, 20), grid_of(9, 7, {-10.0, -10.0}), centred_grid(20, 5)});
}

// Without distortion the corners decide: every point that was left out must have had one too near.
// The pose of a left out point is made here from the point itself.
TEST(PoseSampler, LeavesOutNothingThatIsInView) {
    CameraModel camera = webcam();
    camera.distortion = {};
    const CellGrid grid = centred_grid(9, 5);
    const PoseVolume volume{.x_mm = Interval{-200.0, 300.0},
                            .y_mm = Interval{-170.0, 150.0},
                            .z_mm = {300.0, 900.0},
                            .roll = {-1.5, 1.2},
                            .pitch = {-1.3, 1.5},
                            .yaw = {-3.0, 2.0},
                            .margin_px = 17.0};
    const auto samples = samples_of(camera, {grid}, volume, SequenceKind::halton_faure, 300, 3);
    const PointSequence sequence(SequenceKind::halton_faure, 6, 3);
    std::size_t next = 0, left_out = 0;
    for (std::uint64_t index = 0; next < samples.size(); ++index) {
        const auto u = sequence.point(index);
        const Rigid pose{
            rotation_from_roll_pitch_yaw({2.7 * u[3] - 1.5, 2.8 * u[4] - 1.3, 5.0 * u[5] - 3.0}),
            {500.0 * u[0] - 200.0, 320.0 * u[1] - 170.0, 600.0 * u[2] + 300.0}};
        const bool fits = shows_front(pose) && outline_depth(camera, grid, pose) >= 17.0;
        EXPECT_EQ(fits, samples[next].index == index) << index;
        next += samples[next].index == index ? 1 : 0;
        left_out += fits ? 0 : 1;
    }
    EXPECT_GT(left_out, 200u);
}

// A marker of 5 px at the nearest: nothing but the border is in the way of its centre. 25 px inside
// the image the centres are then uniform; 3000 random points would come 1.95 / sqrt(3000) = 0.036
// near in 999 of 1000 cases.
TEST(PoseSampler, SpreadsTheMarkersOriginEvenlyOverADistortedImage) {
    const CameraModel camera = barrel_camera();
    PoseVolume volume = seen_volume();
    volume.roll = volume.pitch = {-0.2, 0.25};
    const CellGrid grid{cv::Mat_<float>(1, 1, 0.5f), {-2.0, -2.0}, {4.0, 4.0}};
    std::vector<double> columns, rows;
    for (const auto& sample : samples_of(camera, {grid}, volume, SequenceKind::halton, 3000)) {
        const cv::Point2d q = opencv_pixel(camera, sample.camera_from_marker.translation);
        if (depth_in_image(camera, q) > 25.0) {
            columns.push_back(q.x);
            rows.push_back(q.y);
        }
    }
    EXPECT_GT(columns.size(), 2700u);
    EXPECT_LT(distance_from_uniform(columns, {25.0, 1174.0}), 0.036);
    EXPECT_LT(distance_from_uniform(rows, {25.0, 874.0}), 0.036);
}

// Along the lines x = 210 mm or y = -140 mm at each depth, which the distortion bends: the row (or
// column) of the origin is uniform, within the same tolerance as above.
TEST(PoseSampler, SpreadsOneFreeAxisEvenlyOverTheImageWhereTheOtherIsGiven) {
    const CameraModel camera = barrel_camera();
    const CellGrid grid{cv::Mat_<float>(1, 1, 0.5f), {-2.0, -2.0}, {4.0, 4.0}};
    PoseVolume volume = seen_volume();
    volume.roll = volume.pitch = {-0.2, 0.2};
    const auto expect_even = [&](int given, double mm, SequenceKind kind, const Interval& seen) {
        std::vector<double> pixels;
        for (const auto& sample : samples_of(camera, {grid}, volume, kind, 3000)) {
            const Eigen::Vector3d& origin = sample.camera_from_marker.translation;
            EXPECT_EQ(origin[given], mm);
            const cv::Point2d q = opencv_pixel(camera, origin);
            pixels.push_back(given == 0 ? q.y : q.x);
        }
        std::erase_if(pixels, [&](double q) { return q < seen.low || q > seen.high; });
        EXPECT_GT(pixels.size(), 2800u);
        EXPECT_LT(distance_from_uniform(pixels, seen), 0.036);
    };
    volume.x_mm = Interval{210.0, 210.0};
    expect_even(0, 210.0, SequenceKind::sobol, {20.0, 879.0});
    volume.x_mm.reset();
    volume.y_mm = Interval{-140.0, -140.0};
    expect_even(1, -140.0, SequenceKind::halton, {20.0, 1179.0});
}

TEST(PoseSampler, KeepsFixedAxesExactlyAndSamplesTheOthers) {
    PoseVolume volume = seen_volume();
    volume.z_mm = {713.7, 713.7};
    volume.roll = {0.31, 0.31};
    volume.pitch = {-0.17, -0.17};
    volume.yaw = {-2.0, 1.0};
    std::vector<double> yaws;
    for (const auto& sample :
         samples_of(webcam(), {centred_grid(2, 2)}, volume, SequenceKind::sobol, 512)) {
        const Rigid& pose = sample.camera_from_marker;
        EXPECT_EQ(pose.translation.z(), 713.7);
        const Eigen::Vector3d angles = roll_pitch_yaw(pose.rotation);
        EXPECT_NEAR(angles[0], 0.31, 1e-14);
        EXPECT_NEAR(angles[1], -0.17, 1e-14);
        yaws.push_back(angles[2]);
    }
    EXPECT_LT(distance_from_uniform(yaws, {-2.0, 1.0}), 1.95 / std::sqrt(512.0));
}

TEST(PoseSampler, RepeatsASinglePose) {
    const PoseVolume volume{.x_mm = Interval{7.0, 7.0},
                            .y_mm = Interval{-5.0, -5.0},
                            .z_mm = {600.0, 600.0},
                            .yaw = {0.3, 0.3}};
    const std::vector<CellGrid> grids{centred_grid(2, 2)};
    for (const auto& sample : samples_of(webcam(), grids, volume, SequenceKind::halton, 5)) {
        EXPECT_EQ(sample.camera_from_marker.translation, Eigen::Vector3d(7.0, -5.0, 600.0));
        EXPECT_EQ(sample.camera_from_marker.rotation.coeffs(),
                  rotation_from_roll_pitch_yaw({0.0, 0.0, 0.3}).coeffs());
        EXPECT_TRUE(sample.extra.empty());
    }
    PoseSampler disturbed(webcam(), grids, volume, SequenceKind::halton, 5, 1);
    EXPECT_NE(disturbed.next().extra, disturbed.next().extra);
}

TEST(PoseSampler, AddsNothingForAMarkerWithinAnother) {
    const auto alone =
        samples_of(webcam(), {centred_grid(8, 6)}, seen_volume(), SequenceKind::halton, 50);
    const auto together =
        samples_of(webcam(), {centred_grid(2, 6), centred_grid(8, 6), grid_of(3, 2, {-30.0, 5.0})},
                   seen_volume(), SequenceKind::halton, 50);
    for (std::size_t i = 0; i < alone.size(); ++i)
        EXPECT_EQ(alone[i].index, together[i].index);
}

// With k1 = -0.3 alone the image turns back at the radius 1 / sqrt(0.9): beyond, a point of the
// scene has a pixel in the image again that no ray belongs to.
TEST(PoseSampler, LeavesOutWhereTheDistortionModelDoesNotHold) {
    CameraModel camera = barrel_camera();
    camera.distortion = {.k1 = -0.3};
    const CellGrid grid = centred_grid(20, 12);
    double largest = 0.0;
    for (const auto& sample : samples_of(camera, {grid}, seen_volume(), SequenceKind::halton, 300))
        for (const int u : {0, 20})
            for (const int v : {0, 12}) {
                const Eigen::Vector3d p = sample.camera_from_marker * grid.point_mm(u, v);
                largest = std::max(largest, p.hnormalized().norm());
            }
    EXPECT_LT(largest, 1.0 / std::sqrt(0.9));
    EXPECT_GT(largest, 0.95 / std::sqrt(0.9));
}

// A telecentric camera of 4 px/mm: the marker's place in the image does not depend on its depth.
TEST(PoseSampler, CoversTheViewOfATelecentricCamera) {
    CameraModel camera = test::camera_with(640, 480, {4.0, 4.0, 319.5, 239.5}, {});
    camera.projection.kind = Projection::telecentric;
    PoseVolume volume = seen_volume();
    volume.roll = volume.pitch = {0.0, 0.0};
    std::vector<double> columns;
    const double half_diagonal = 4.0 * 5.0 * std::sqrt(2.0);
    for (const auto& sample :
         samples_of(camera, {centred_grid(1, 1)}, volume, SequenceKind::sobol, 1024)) {
        const Eigen::Vector3d& p = sample.camera_from_marker.translation;
        EXPECT_GT(std::min(4.0 * p.x() + 319.5, 319.5 - 4.0 * p.x()), 13.0 + 20.0);
        EXPECT_GT(std::min(4.0 * p.y() + 239.5, 239.5 - 4.0 * p.y()), 13.0 + 20.0);
        if (std::abs(4.0 * p.x()) < 319.5 - 13.0 - half_diagonal)
            columns.push_back(4.0 * p.x());
    }
    const double reach = 319.5 - 13.0 - half_diagonal;
    EXPECT_GT(columns.size(), 900u);
    EXPECT_LT(distance_from_uniform(columns, {-reach, reach}), 1.95 / std::sqrt(900.0));
}

std::string refusal_of(const PoseVolume& volume) {
    const std::vector<CellGrid> grids{centred_grid(8, 8)};
    return config_error_of([&] { PoseSampler(webcam(), grids, volume, SequenceKind::halton, 1); });
}

TEST(PoseSampler, NamesTheAxisOfAnIntervalThatIsNone) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const double infinity = std::numeric_limits<double>::infinity();
    const auto with = [](auto member, const Interval& interval) {
        PoseVolume volume = seen_volume();
        volume.*member = interval;
        return refusal_of(volume);
    };
    EXPECT_THAT(with(&PoseVolume::x_mm, {5.0, -7.0}), HasSubstr("x_mm: from 5 to -7"));
    EXPECT_THAT(with(&PoseVolume::y_mm, {nan, 7.0}), HasSubstr("y_mm: from nan to 7"));
    EXPECT_THAT(with(&PoseVolume::z_mm, {500.0, infinity}), HasSubstr("z_mm: from 500 to inf"));
    EXPECT_THAT(with(&PoseVolume::z_mm, {0.0, 500.0}), HasSubstr("z_mm: a depth of 0 mm"));
    EXPECT_THAT(with(&PoseVolume::roll, {-45.0, 45.0}), HasSubstr("roll: from -45 to 45 rad"));
    EXPECT_THAT(with(&PoseVolume::pitch, {0.3, 0.2}), HasSubstr("pitch: from 0.3 to 0.2"));
    EXPECT_THAT(with(&PoseVolume::yaw, {0.0, 360.0}), HasSubstr("yaw: from 0 to 360"));
    PoseVolume volume = seen_volume();
    volume.margin_px = -1.0;
    EXPECT_THAT(refusal_of(volume), HasSubstr("margin_px"));
    EXPECT_EQ(refusal_of(seen_volume()), "no error");
}

TEST(PoseSampler, RefusesToSampleForNoMarkerOrInTooManyDimensions) {
    const std::vector<CellGrid> grids{centred_grid(8, 8)};
    const auto make = [&](std::span<const CellGrid> of, int extra) {
        PoseSampler(webcam(), of, seen_volume(), SequenceKind::halton, 1, extra);
    };
    EXPECT_NO_THROW(make(grids, 10));
    EXPECT_THROW(make(grids, 11), NumericalError);
    EXPECT_THROW(make(grids, -1), NumericalError);
    EXPECT_THROW(make({}, 0), NumericalError);
}

// x uniform over `width` mm at 1 m, seen where the marker of 20 mm is inside: about 1 in 300 of
// 230 m, 1 in 3000 of 2.3 km.
TEST(PoseSampler, GivesUpWhereOneDrawInAThousandFits) {
    PoseVolume volume = seen_volume();
    volume.z_mm = {1000.0, 1000.0};
    volume.roll = volume.pitch = {0.0, 0.0};
    volume.y_mm = Interval{0.0, 0.0};
    const std::vector<CellGrid> grids{centred_grid(2, 2)};
    volume.x_mm = Interval{-100e3, 130e3};
    EXPECT_NO_THROW(samples_of(webcam(), grids, volume, SequenceKind::halton, 30));
    volume.x_mm = Interval{-1000e3, 1300e3};
    EXPECT_THROW(samples_of(webcam(), grids, volume, SequenceKind::halton, 30), NumericalError);
}

}  // namespace
}  // namespace etalon
