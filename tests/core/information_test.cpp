#include "core/information.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

namespace etalon {
namespace {

// rad and mm: diagonal elements twelve orders of magnitude apart, and correlated.
TEST(Information, IsInvertedWhateverItsUnits) {
    Eigen::Matrix3d information;
    information << 4e9, 1.2e3, -8e4, 1.2e3, 9e-3, -0.03, -8e4, -0.03, 2.5e1;
    const auto inverse = inverse_of_information(information);
    ASSERT_TRUE(inverse);
    const Eigen::Vector3d unit = information.diagonal().cwiseSqrt();
    const Eigen::Matrix3d rest = unit.asDiagonal() * (*inverse) * information *
                                 unit.cwiseInverse().asDiagonal();
    EXPECT_LT((rest - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Information, HasNoInverseWhereADirectionIsUntold) {
    const Eigen::Vector3d row(1.0, -2.0, 0.5), other(0.3, 0.7, 1.1);
    EXPECT_FALSE(inverse_of_information(row * row.transpose() + other * other.transpose()));
    EXPECT_FALSE(inverse_of_information(Eigen::Vector3d(1.0, 0.0, 2.0).asDiagonal()));
    EXPECT_FALSE(inverse_of_information(
        Eigen::Vector3d(1.0, std::nan(""), 2.0).asDiagonal().toDenseMatrix()));
}

TEST(Information, TakesTheCallersBoundOfWhatIsRounding) {
    Eigen::Matrix2d information;
    information << 1.0, 0.999, 0.999, 1.0;  // eigenvalues 0.001 and 1.999
    EXPECT_TRUE(inverse_of_information(information, 0.9e-3));
    EXPECT_FALSE(inverse_of_information(information, 1.1e-3));
}

}  // namespace
}  // namespace etalon
