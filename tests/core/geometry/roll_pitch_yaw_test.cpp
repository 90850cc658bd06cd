#include "core/geometry/rigid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/statistics/random.h"

namespace etalon {
namespace {

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
        const Eigen::Vector3d angles((2.0 * random.uniform() - 1.0) * 179.0 * degree,
                                     (2.0 * random.uniform() - 1.0) * 89.0 * degree,
                                     (2.0 * random.uniform() - 1.0) * 179.0 * degree);
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
