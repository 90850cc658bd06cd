#include "compare/detect/detector.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Points = std::vector<Eigen::Vector3d>;
using Pixels = std::vector<Eigen::Vector2d>;

// The webcam of the published study: strong barrel distortion, f_x and f_y told apart.
CameraModel webcam() {
    return camera_with(640, 480, {538.55, 541.2, 319.5, 239.5},
                       {.k1 = -0.286, .k2 = 0.057, .p1 = 0.0013, .p2 = -0.0007, .k3 = 0.112});
}

Points square(double side) {
    const double h = side / 2;
    return {{-h, -h, 0}, {h, -h, 0}, {h, h, 0}, {-h, h, 0}};
}

// The first corner is the origin.
Points board(const char* size) {
    return parse_marker(std::string("chessboard:") + size, "test").points_mm;
}

class EstimatePose : public testing::Test {
protected:
    const Projector projector{webcam()};
    const Points corners = square(50.0);

    static void expect_same_pose(const Rigid& estimate, const Rigid& truth, double rad, double mm) {
        const Vector6d delta = left_difference(truth, estimate);
        EXPECT_LT(delta.head<3>().norm(), rad);
        EXPECT_LT(delta.tail<3>().norm(), mm);
    }
    // From exact pixels: the truth, to these limits.
    PoseEstimate found_at(const Points& points, const Rigid& truth, double rad, double mm) const {
        const auto estimate =
            estimate_pose(projector, points, corners_at(projector, points, truth));
        EXPECT_TRUE(estimate);
        expect_same_pose(estimate.value().camera_from_marker, truth, rad, mm);
        return *estimate;
    }
};

TEST_F(EstimatePose, RecoversTagPosesFromTheirProjectionsIncludingDistortion) {
    RandomStream random(7, 5);
    for (int n = 0; n < 40; ++n) {
        const auto between = [&](double low, double high) {
            return low + (high - low) * random.uniform();
        };
        const Vector6d v{between(-0.9, 0.9), between(-0.9, 0.9), between(-3, 3),
                         between(-90, 90),   between(-60, 60),   between(250, 900)};
        SCOPED_TRACE(n);
        // 1e-12 of the pixel coordinates (rounding and unproject) times 900 mm / 30 px and the
        // tilt's lever leaves nanometres.
        EXPECT_LT(found_at(corners, rigid_from_vector(v), 1e-7, 1e-5).reprojection_rms_px, 1e-8);
    }
}

TEST_F(EstimatePose, RecoversABoardWhoseOriginIsItsFirstCorner) {
    found_at(board("9x6@25mm"), rigid_from_vector({0.41, -0.33, 0.2, -85.0, -61.0, 410.0}), 1e-9,
             1e-7);
}

TEST_F(EstimatePose, AcceptsPointsInAnyPlaneOfTheMarkersFrame) {
    const Rigid tilted{rotation_from_vector({0.5, 0.3, -0.2}), {5.0, 7.0, 30.0}};
    Points points = square(60.0);
    for (Eigen::Vector3d& point : points)
        point = tilted * point;
    found_at(points, {rotation_from_vector({0.2, -0.3, 0.7}), {20.0, -10.0, 400.0}}, 1e-7, 1e-5);
}

TEST_F(EstimatePose, KeepsBothSolutionsOfASmallTagNearlySquareToTheCamera) {
    const Points corners = square(20.0);
    const Rigid truth{rotation_from_vector({0.21, 0.14, 0.0}), {30.0, 20.0, 800.0}};
    const PoseEstimate estimate = found_at(corners, truth, 1e-6, 1e-4);
    ASSERT_TRUE(estimate.alternative);
    // The other solution mirrors the normal at the line of sight: as much tilt, nearly as good.
    const Eigen::Vector3d sight = truth.translation.normalized();
    const Eigen::Vector3d normal = truth.rotation * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d other = estimate.alternative->rotation * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d mirrored = 2.0 * normal.dot(sight) * sight - normal;
    EXPECT_LT((other - mirrored).norm(), 0.03);
    EXPECT_GT((other - normal).norm(), 0.3);
    EXPECT_GT(estimate.alternative_rms_px, estimate.reprojection_rms_px);
    EXPECT_LT(estimate.alternative_rms_px, 0.05);
}

// The line between the two valleys is where the tag is square to the line of sight.
TEST_F(EstimatePose, FromAStartTakesTheSolutionOnItsSide) {
    const Points corners = square(20.0);
    const Rigid truth{rotation_from_vector({0.21, 0.14, 0.0}), {30.0, 20.0, 800.0}};
    Pixels pixels = corners_at(projector, corners, truth);
    pixels[1] += Eigen::Vector2d(0.013, -0.007);  // else the solution is exact: no rounding to see
    const auto both = estimate_pose(projector, corners, pixels);
    ASSERT_TRUE(both && both->alternative);
    const Vector6d away{0.05, -0.04, 0.03, 1.0, -2.0, 7.0};
    for (const Rigid& solution : {both->camera_from_marker, *both->alternative}) {
        const auto near =
            estimate_pose_near(projector, corners, pixels, left_perturbed(solution, away));
        ASSERT_TRUE(near);
        expect_same_pose(near->camera_from_marker, solution, 1e-9, 1e-7);
        EXPECT_FALSE(near->alternative);
    }
    const Rigid behind{truth.rotation, -truth.translation};
    EXPECT_FALSE(estimate_pose_near(projector, corners, pixels, behind));
}

// Each component of the covariance against 1500 noisy estimates. A sample variance of n normal
// draws has the relative standard deviation sqrt(2/(n-1)) = 3.65 %; with six components and a
// family-wise 1 % the two-sided limit is 3.14 standard deviations = 11.5 %. Second-order terms of
// this pose are below 0.5 % (0.3 px on 150 px): 12 %.
TEST_F(EstimatePose, CovarianceIsThatOfManyNoisyEstimates) {
    constexpr int runs = 1500;
    constexpr double sigma_px = 0.3;
    const Points corners = square(80.0);
    const Rigid truth{rotation_from_vector({0.5, -0.4, 0.3}), {25.0, -15.0, 300.0}};
    const Pixels exact = corners_at(projector, corners, truth);
    Matrix6d scatter = Matrix6d::Zero();
    Matrix6d predicted = Matrix6d::Zero();
    for (int n = 0; n < runs; ++n) {
        RandomStream noise(11, 3, static_cast<std::uint64_t>(n));
        Pixels pixels = exact;
        for (Eigen::Vector2d& pixel : pixels)
            pixel += sigma_px * Eigen::Vector2d{noise.normal(), noise.normal()};
        const auto estimate = estimate_pose(projector, corners, pixels);
        ASSERT_TRUE(estimate);
        const Vector6d delta = left_difference(truth, estimate->camera_from_marker);
        scatter += delta * delta.transpose() / runs;
        predicted += estimate->covariance_per_px2 * sigma_px * sigma_px / runs;
    }
    for (int i = 0; i < 6; ++i)
        EXPECT_NEAR(scatter(i, i) / predicted(i, i), 1.0, 0.12) << "component " << i;
    // The correlation of tilt and position shows that the off-diagonal block is right, sign
    // included: it is far from zero here, and a correlation's standard deviation is below
    // 1/sqrt(n).
    const auto correlation = [](const Matrix6d& m, int i, int j) {
        return m(i, j) / std::sqrt(m(i, i) * m(j, j));
    };
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < i; ++j)
            EXPECT_NEAR(correlation(scatter, i, j), correlation(predicted, i, j),
                        4.0 / std::sqrt(runs));
}

TEST_F(EstimatePose, IsLeastSquaresSoNoNearbyPoseIsBetter) {
    const Points corners = board("4x3@20mm");
    const Rigid truth{rotation_from_vector({0.3, 0.2, -0.4}), {-20.0, 15.0, 350.0}};
    Pixels pixels = corners_at(projector, corners, truth);
    RandomStream noise(3, 1);
    for (Eigen::Vector2d& pixel : pixels)
        pixel += 0.5 * Eigen::Vector2d{noise.normal(), noise.normal()};
    const auto estimate = estimate_pose(projector, corners, pixels);
    ASSERT_TRUE(estimate);
    const auto cost = [&](const Rigid& pose) {
        double sum = 0;
        const Pixels seen = corners_at(projector, corners, pose);
        for (std::size_t i = 0; i < seen.size(); ++i)
            sum += (seen[i] - pixels[i]).squaredNorm();
        return sum;
    };
    const double least = cost(estimate->camera_from_marker);
    EXPECT_NEAR(estimate->reprojection_rms_px, std::sqrt(least / 12.0), 1e-12);
    for (int i = 0; i < 6; ++i)
        for (const double sign : {-1.0, 1.0}) {
            const Vector6d delta = sign * (i < 3 ? 1e-4 : 1e-2) * Vector6d::Unit(i);
            EXPECT_GT(cost(left_perturbed(estimate->camera_from_marker, delta)), least);
        }
}

TEST_F(EstimatePose, RefusesATelecentricCamera) {
    CameraModel camera = webcam();
    const Pixels pixels =
        corners_at(Projector(camera), corners, {Eigen::Quaterniond::Identity(), {7.0, 5.0, 400.0}});
    camera.projection.kind = Projection::telecentric;
    EXPECT_THROW(estimate_pose(Projector(camera), corners, pixels), NumericalError);
}

// Markers beside a lens of 200 degrees, their far corners behind the camera; exact pixels.
TEST_F(EstimatePose, WorksBesideAWideLens) {
    for (const auto& [name, camera] : wide_models()) {
        const Projector projector(camera);
        for (const double angle : {0.0, 0.8, 1.55}) {
            const Eigen::Vector3d sight(0.6 * std::sin(angle), -0.8 * std::sin(angle),
                                        std::cos(angle));
            const Eigen::Quaterniond facing = rotation_between(Eigen::Vector3d::UnitZ(), sight) *
                                              rotation_from_vector({0.5, -0.3, 0.2});
            const Rigid truth{facing, 170.0 * sight};
            const Pixels pixels = corners_at(projector, corners, truth);
            const auto found = estimate_pose(projector, corners, pixels);
            ASSERT_TRUE(found) << name << " " << angle;
            EXPECT_LT(left_difference(found->camera_from_marker, truth).norm(), 1e-6)
                << name << " " << angle;
            Rigid off = truth;
            off.translation.x() += 3.0;
            const auto near = estimate_pose_near(projector, corners, pixels, off);
            ASSERT_TRUE(near) << name;
            EXPECT_LT(left_difference(near->camera_from_marker, truth).norm(), 1e-6) << name;
        }
    }
}

TEST_F(EstimatePose, GivesNothingForDegenerateInput) {
    const Pixels pixels =
        corners_at(projector, corners, {Eigen::Quaterniond::Identity(), {7.0, 5.0, 400.0}});
    EXPECT_TRUE(estimate_pose(projector, corners, pixels));

    const double nan = std::numeric_limits<double>::quiet_NaN();
    Pixels broken = pixels;
    for (const double bad : {nan, std::numeric_limits<double>::infinity()}) {
        broken[2].y() = bad;
        EXPECT_FALSE(estimate_pose(projector, corners, broken));
    }
    Points no_number = corners;
    no_number[1].x() = nan;
    EXPECT_FALSE(estimate_pose(projector, no_number, pixels));

    EXPECT_FALSE(estimate_pose(projector, {}, {}));
    EXPECT_FALSE(estimate_pose(projector, corners, Pixels(pixels.begin(), pixels.end() - 1)));
    EXPECT_FALSE(estimate_pose(projector, Points(corners.begin(), corners.end() - 1),
                               Pixels(pixels.begin(), pixels.end() - 1)));
    const Points line = {{0, 0, 0}, {7, 5, 0}, {14, 10, 0}, {21, 15, 0}};
    EXPECT_FALSE(estimate_pose(projector, line, pixels));
    EXPECT_FALSE(estimate_pose(projector, Points(4, Eigen::Vector3d(7, 5, 0)), pixels));
    Points bent = corners;
    bent[0].z() = 10.0;
    EXPECT_FALSE(estimate_pose(projector, bent, pixels));
}

TEST_F(EstimatePose, NeverReturnsAPoseThatIsNotFiniteOrIsBehindTheCamera) {
    const std::vector<Pixels> nasty = {
        Pixels(4, Eigen::Vector2d(320.0, 240.0)),                              // all in one place
        {{300, 200}, {320, 220}, {340, 240}, {360, 260}},                      // on a line
        {{300, 200}, {340, 240}, {340, 200}, {300, 240}},                      // crossed over
        {{300, 200}, {300, 240}, {340, 240}, {340, 200}},                      // mirrored
        {{300, 200}, {300, 200}, {340, 240}, {300, 240}},                      // two in one place
        {{1e9, 200}, {300, 200}, {340, 240}, {300, 240}},                      // far outside
        {{300, 200}, {300.0001, 200}, {300.0001, 200.0001}, {300, 200.0001}},  // a speck
    };
    for (std::size_t n = 0; n < nasty.size(); ++n) {
        const auto estimate = estimate_pose(projector, corners, nasty[n]);
        if (!estimate)
            continue;
        EXPECT_TRUE(vector_from_rigid(estimate->camera_from_marker).allFinite()) << n;
        EXPECT_TRUE(estimate->covariance_per_px2.allFinite()) << n;
        EXPECT_TRUE(std::isfinite(estimate->reprojection_rms_px)) << n;
        for (const Eigen::Vector3d& corner : corners)
            EXPECT_GT((estimate->camera_from_marker * corner).z(), 0.0) << n;
    }
}

}  // namespace
}  // namespace etalon
