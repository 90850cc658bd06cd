#include "core/geometry/rigid.h"

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

const Rigid a_from_b{rotation_from_vector({0.3, -0.7, 0.2}), {7.0, -5.0, 11.0}};
const Rigid b_from_c{rotation_from_vector({-1.1, 0.4, 0.9}), {-2.0, 13.0, 3.0}};

TEST(Rigid, ChainsAsItsNamesSay) {
    const Eigen::Vector3d p_c(1.5, -4.0, 6.0);
    EXPECT_LT(((a_from_b * b_from_c) * p_c - a_from_b * (b_from_c * p_c)).norm(), 1e-13);
}

TEST(Rigid, InverseUndoesIt) {
    const Eigen::Vector3d p_b(1.5, -4.0, 6.0);
    EXPECT_LT((a_from_b.inverse() * (a_from_b * p_b) - p_b).norm(), 1e-13);
}

TEST(Rigid, QuarterTurnAboutZTakesXToY) {
    const Eigen::Quaterniond turn = rotation_from_vector({0, 0, std::numbers::pi / 2});
    EXPECT_LT((turn * Eigen::Vector3d(7, 5, 3) - Eigen::Vector3d(-5, 7, 3)).norm(), 1e-14);
}

TEST(Rigid, RotationBetweenTakesOneDirectionToTheOtherOppositeOnesToo) {
    const Eigen::Vector3d a(2.0, -3.0, 6.0);
    for (const Eigen::Vector3d& b : {Eigen::Vector3d(1, 5, -2), Eigen::Vector3d(-a * 0.3), a,
                                     Eigen::Vector3d(-a + Eigen::Vector3d(1e-7, 2e-7, 0))}) {
        const Eigen::Quaterniond turn = rotation_between(a, b);
        EXPECT_NEAR(turn.norm(), 1.0, 1e-15);
        EXPECT_LT((turn * a.normalized() - b.normalized()).norm(), 1e-14);
    }
    const Eigen::AngleAxisd smallest(rotation_between(a, {1, 5, -2}));
    EXPECT_NEAR(smallest.angle(),
                std::acos(a.dot(Eigen::Vector3d(1, 5, -2)) / 7.0 / std::sqrt(30.0)), 1e-14);
}

TEST(Rigid, RotationVectorSurvivesTheRoundTripFromTinyToHalfATurn) {
    for (const double angle : {0.0, 1e-300, 1e-9, 1e-6, 1e-3, 0.5, 3.0, std::numbers::pi - 1e-9}) {
        const Eigen::Vector3d v = angle * Eigen::Vector3d(2, -3, 6) / 7.0;
        EXPECT_LT((rotation_vector(rotation_from_vector(v)) - v).norm(), 1e-14 + 1e-15 * angle)
            << "angle " << angle;
    }
}

TEST(Rigid, LongRotationVectorComesBackAsTheShortestOne) {
    const Eigen::Vector3d v = 4.0 * Eigen::Vector3d(2, -3, 6) / 7.0;
    const Eigen::Vector3d shortest = v - 2.0 * std::numbers::pi * v.normalized();
    EXPECT_LT((rotation_vector(rotation_from_vector(v)) - shortest).norm(), 1e-14);
}

TEST(Rigid, LeftPerturbationTurnsInTheOuterFrame) {
    Vector6d delta;
    delta << 0, 0, std::numbers::pi / 2, 1, 2, 3;
    const Rigid moved = left_perturbed(a_from_b, delta);
    const Eigen::Vector3d direction_b(1, 0, 0);
    const Eigen::Vector3d before = a_from_b.rotation * direction_b;
    const Eigen::Vector3d expected(-before.y(), before.x(), before.z());
    EXPECT_LT((moved.rotation * direction_b - expected).norm(), 1e-14);
    EXPECT_LT((moved.translation - Eigen::Vector3d(8, -3, 14)).norm(), 1e-14);
}

TEST(Rigid, LeftDifferenceInvertsLeftPerturbation) {
    const Vector6d delta = left_difference(a_from_b, b_from_c);
    const Rigid back = left_perturbed(a_from_b, delta);
    EXPECT_LT(left_difference(back, b_from_c).norm(), 1e-13);
}

constexpr double pi = std::numbers::pi, degree = pi / 180.0;

// The nine elements as textbooks write them out (e.g. ISO 1151-2 for aircraft).
TEST(RollPitchYaw, AreTheTextbooksMatrix) {
    const Eigen::Vector3d angles(0.3, -0.7, 2.1);
    const double cr = std::cos(0.3), sr = std::sin(0.3), cp = std::cos(-0.7), sp = std::sin(-0.7),
                 cy = std::cos(2.1), sy = std::sin(2.1);
    Eigen::Matrix3d expected;
    expected << cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,  //
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,          //
        -sp, cp * sr, cp * cr;
    EXPECT_LT((rotation_from_roll_pitch_yaw(angles).toRotationMatrix() - expected).norm(), 1e-14);
}

TEST(RollPitchYaw, ComeBack) {
    for (std::uint64_t i = 0; i < 1000; ++i) {
        RandomStream random(5, 0, i);
        const Eigen::Vector3d angles{(2.0 * random.uniform() - 1.0) * 179.0 * degree,
                                     (2.0 * random.uniform() - 1.0) * 89.0 * degree,
                                     (2.0 * random.uniform() - 1.0) * 179.0 * degree};
        EXPECT_LT((roll_pitch_yaw(rotation_from_roll_pitch_yaw(angles)) - angles).norm(), 1e-12);
    }
}

TEST(RollPitchYaw, GiveTheSameRotationWhereTheyAreNotUnique) {
    for (const double pitch : {0.5 * pi, -0.5 * pi}) {
        const Eigen::Quaterniond upright = rotation_from_roll_pitch_yaw({0.4, pitch, -1.1});
        const Eigen::Vector3d angles = roll_pitch_yaw(upright);
        ASSERT_TRUE(angles.allFinite());
        EXPECT_LT(upright.angularDistance(rotation_from_roll_pitch_yaw(angles)), 3e-7);
    }
}

TEST(RollPitchYaw, WrapToHalfATurn) {
    EXPECT_NEAR(wrapped(190.0 * degree), -170.0 * degree, 1e-12);
    EXPECT_NEAR(wrapped(-725.0 * degree), -5.0 * degree, 1e-12);
    EXPECT_EQ(wrapped(0.25), 0.25);
}

}  // namespace
}  // namespace etalon
