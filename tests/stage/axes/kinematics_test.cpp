#include "stage/axes/kinematics.h"

#include <Eigen/Eigenvalues>

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

using std::numbers::pi;

Axis linear(Eigen::Vector3d direction) {
    Axis axis;
    axis.direction = direction.normalized();
    return axis;
}

Axis rotary(Eigen::Vector3d direction, Eigen::Vector3d point) {
    Axis axis = linear(direction);
    axis.kind = Axis::Kind::rotary;
    axis.point_mm = point;
    return axis;
}

// x, then a quarter turn about (7, 5), then y in the turned frame. By hand: the turn takes the
// origin to (7, 5) + (5, -7) = (12, -2); x adds (3, 0); y = 2 points along -x after the turn.
TEST(Kinematics, ChainFromTheBaseOutwards) {
    const std::vector<Axis> axes = {linear({1, 0, 0}), rotary({0, 0, 1}, {7, 5, 0}),
                                    linear({0, 1, 0})};
    const Rigid base_from_carriage_q = base_from_carriage(axes, std::vector{3.0, pi / 2, 2.0});
    EXPECT_LT((base_from_carriage_q.translation - Eigen::Vector3d(13, -2, 0)).norm(), 1e-14);
    const Eigen::Vector3d turned = base_from_carriage_q.rotation * Eigen::Vector3d(5, 7, 11);
    EXPECT_LT((turned - Eigen::Vector3d(-7, 5, 11)).norm(), 1e-14);
}

// A third of a turn about (1, 1, 1) permutes the coordinates: x -> y -> z -> x.
TEST(Kinematics, TurnAboutAnObliqueDirection) {
    const std::vector<Axis> axes = {rotary({1, 1, 1}, {2, 2, 2})};
    const Rigid turn = base_from_carriage(axes, std::vector{2 * pi / 3});
    EXPECT_LT((turn * Eigen::Vector3d(5, 7, 11) - Eigen::Vector3d(11, 5, 7)).norm(), 1e-14);
}

TEST(Kinematics, LeaveThePointsOfARotaryAxisWhereTheyAre) {
    const std::vector<Axis> axes = {rotary({1, -2, 3}, {7, 5, -3})};
    const Rigid turn = base_from_carriage(axes, std::vector{0.7});
    const Eigen::Vector3d on_axis = axes[0].point_mm + 11.0 * axes[0].direction;
    EXPECT_LT((turn * on_axis - on_axis).norm(), 1e-13);
}

// By hand. The rotary axis is mounted 100 mm above the base with its z along base x, and its point
// is where it is mounted. A quarter turn from its zero (30 degrees) takes mount x to mount y, that
// is base -z to base y: the linear axis, which goes along mount x, moves the carriage along base y.
TEST(Kinematics, ChainsMountedAxesFromTheirZeros) {
    std::vector<Axis> axes = {rotary({0, 0, 1}, {0, 0, 0}), linear({1, 0, 0})};
    axes[0].previous_from_mount = {rotation_from_vector({0, pi / 2, 0}), {0, 0, 100}};
    axes[0].zero = pi / 6;
    axes[1].zero = 7.0;
    const Rigid pose = base_from_carriage(axes, std::vector{pi / 6 + pi / 2, 12.0});
    EXPECT_LT((pose.translation - Eigen::Vector3d(0, 5, 100)).norm(), 1e-13);
    EXPECT_LT((pose.rotation * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(1, 0, 0)).norm(), 1e-15);
    EXPECT_LT((pose.rotation * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(0, 1, 0)).norm(), 1e-15);
}

// Halfway between the points the axis is 3 um further than it reads.
TEST(Kinematics, GoAsFarAsTheErrorMapSays) {
    std::vector<Axis> axes = {linear({0, 0, -1})};
    axes[0].zero = 2.0;
    axes[0].errors = ErrorMap({{-10, 0.002, 0.0}, {30, 0.004, 0.0}}, {"test"});
    const Rigid pose = base_from_carriage(axes, std::vector{10.0});
    EXPECT_NEAR(pose.translation.z(), -8.003, 1e-12);
    EXPECT_THROW(base_from_carriage(axes, std::vector{31.0}), ConfigError);
    EXPECT_THROW(base_from_carriage(axes, std::vector{1.0, 2.0}), ConfigError);
}

// By hand: 250 mm from its zero 20 ppm are 5 um; the map says 3 um, the reading 1 um, repeatability
// 2 um, backlash 8 um from either side 4 um. Across it leans by 30 urad: 7.5 um.
TEST(StagePose, OfALinearAxisByHand) {
    std::vector<Axis> axes = {linear({0, 1, 0})};
    Axis& y = axes[0];
    y.zero = 50.0;
    y.scale_uncertainty = 20e-6;
    y.errors = ErrorMap({{0, 0, 0.003}, {400, 0, 0.003}}, {"test"});
    y.read_noise = 0.001;
    y.repeatability = 0.002;
    y.backlash = 0.008;
    y.direction_uncertainty = 30e-6;
    const StagePose pose = stage_pose(axes, std::vector{300.0});
    Matrix6d expected = Matrix6d::Zero();
    expected(4, 4) = 1e-6 * (25 + 9 + 1 + 4 + 16);
    expected(3, 3) = expected(5, 5) = std::pow(7.5e-3, 2);
    EXPECT_LT((pose.covariance - expected).norm(), 1e-15) << pose.covariance;
    // Always from the same side the backlash is a constant; a measured spread replaces the noise.
    y.approach = 1;
    y.backlash_uncertainty = 0.0015;
    expected(4, 4) = 1e-6 * (25 + 9 + 36 + 4 + 2.25);
    const StagePose measured = stage_pose(axes, std::vector{300.0}, std::vector{0.006});
    EXPECT_LT((measured.covariance - expected).norm(), 1e-15) << measured.covariance;
}

// By hand: the carriage's origin is 40 mm from a rotary axis along z; 0.1 mrad of angle are 4 um
// along the arc, fully correlated with the rotation.
TEST(StagePose, OfARotaryAxisMovesTheOriginAlongTheArc) {
    std::vector<Axis> axes = {rotary({0, 0, 1}, {40, 0, 5})};
    axes[0].repeatability = 1e-4;
    const StagePose pose = stage_pose(axes, std::vector{pi / 2});
    // The origin went from (0, 0) to (40, -40): seen from the axis it is at (0, -40).
    Vector6d arc = Vector6d::Zero();
    arc[2] = 1e-4;
    arc[3] = 40e-4;
    EXPECT_LT((pose.covariance - arc * arc.transpose()).norm(), 1e-17) << pose.covariance;
}

// Half a turn takes the point's error to the other side: the origin moves by twice as much. Halfway
// round, a leaning axis tips the carriage by twice its lean.
TEST(StagePose, OfARotaryAxisKnowsItsPointAndDirection) {
    std::vector<Axis> axes = {rotary({0, 0, 1}, {0, 0, 0})};
    axes[0].point_uncertainty = 0.007;
    axes[0].direction_uncertainty = 5e-5;
    const Matrix6d turned = stage_pose(axes, std::vector{pi}).covariance;
    Matrix6d expected = Matrix6d::Zero();
    expected(0, 0) = expected(1, 1) = std::pow(1e-4, 2);
    expected(3, 3) = expected(4, 4) = std::pow(0.014, 2);
    EXPECT_LT((turned - expected).norm(), 1e-16) << turned;
    EXPECT_EQ(stage_pose(axes, std::vector{0.0}).covariance.norm(), 0.0);
}

// ---- The covariance against draws of axes that are truly as wrong as declared.

// An oblique, mounted chain: linear, rotary, linear, rotary.
std::vector<Axis> uncertain_chain() {
    std::vector<Axis> axes = {linear({3, 1, -2}), rotary({1, -2, 3}, {7, 5, -3}), linear({0, 4, 3}),
                              rotary({2, 7, -1}, {-30, 12, 40})};
    axes[1].previous_from_mount = {rotation_from_vector({0.3, -0.5, 0.7}), {11, -7, 5}};
    axes[3].previous_from_mount = {rotation_from_vector({-0.2, 0.4, 1.1}), {60, 25, -35}};
    axes[0].zero = -20.0;
    axes[1].zero = 0.4;
    axes[0].scale_uncertainty = 200e-6;
    axes[0].direction_uncertainty = 3e-4;
    axes[0].read_noise = 0.01;
    axes[1].repeatability = 2e-4;
    axes[1].direction_uncertainty = 2e-4;
    axes[1].point_uncertainty = 0.02;
    axes[2].errors = ErrorMap({{-50, 0.1, 0.02}, {90, -0.05, 0.04}}, {"test"});
    axes[2].backlash = 0.05;
    axes[2].direction_uncertainty = 5e-4;
    axes[3].backlash_uncertainty = 3e-4;
    axes[3].point_uncertainty = 0.05;
    axes[3].direction_uncertainty = 1e-4;
    return axes;
}

// Independent of the code under test: the model itself is disturbed and the chain evaluated again.
Rigid drawn_pose(std::vector<Axis> axes, std::vector<double> q, RandomStream& random) {
    const auto draw = [&](const std::optional<double>& deviation) {
        return deviation.value_or(0.0) * random.normal();
    };
    for (std::size_t i = 0; i < axes.size(); ++i) {
        Axis& axis = axes[i];
        const double map = axis.errors ? axis.errors->at(q[i])->uncertainty : 0.0;
        const double side = random.uniform() < 0.5 ? -0.5 : 0.5;
        axis.zero -= draw(axis.scale_uncertainty) * (q[i] - axis.zero) + draw(axis.repeatability) +
                     draw(axis.backlash_uncertainty) + draw(axis.read_noise) + draw(map) +
                     side * axis.backlash;
        const Eigen::Vector3d a = axis.direction.unitOrthogonal(), b = axis.direction.cross(a);
        axis.point_mm += draw(axis.point_uncertainty) * a + draw(axis.point_uncertainty) * b;
        const double lean_a = draw(axis.direction_uncertainty),
                     lean_b = draw(axis.direction_uncertainty);
        axis.direction = (axis.direction + lean_a * a + lean_b * b).normalized();
    }
    return base_from_carriage(axes, q);
}

// A sample covariance of n normal draws scatters by sqrt((C_ii C_jj + C_ij^2) / n) about C_ij; the
// two-valued backlash scatters less. 5 of these for each of 21 entries: 1 false alarm in 80 000.
TEST(StagePose, HasTheCovarianceOfDrawnChains) {
    constexpr int draws = 40000;
    const std::vector<Axis> axes = uncertain_chain();
    const std::vector<double> q = {35.0, -0.9, 62.0, 1.3};
    const StagePose pose = stage_pose(axes, q);
    RandomStream random(7, 5);
    Vector6d sum = Vector6d::Zero();
    Matrix6d products = Matrix6d::Zero();
    for (int i = 0; i < draws; ++i) {
        const Vector6d delta =
            left_difference(pose.base_from_carriage, drawn_pose(axes, q, random));
        sum += delta;
        products += delta * delta.transpose();
    }
    const Vector6d mean = sum / draws;
    const Matrix6d sample = products / draws - mean * mean.transpose();
    const Matrix6d& c = pose.covariance;
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j <= i; ++j)
            EXPECT_NEAR(sample(i, j), c(i, j),
                        5 * std::sqrt((c(i, i) * c(j, j) + c(i, j) * c(i, j)) / draws))
                << i << ", " << j;
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix6d>(c).eigenvalues().minCoeff(), 0.0);
}

TEST(ApproachDeviation, IsUnknownWithoutARepeatability) {
    Axis axis = linear({1, 0, 0});
    axis.backlash = 0.008;
    EXPECT_FALSE(approach_deviation(axis));
    axis.repeatability = 0.003;
    EXPECT_DOUBLE_EQ(*approach_deviation(axis), 0.005);
    axis.approach = -1;
    EXPECT_DOUBLE_EQ(*approach_deviation(axis), 0.003);
}

}  // namespace
}  // namespace etalon
