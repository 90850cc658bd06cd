#include "core/statistics/covariance.h"

#include <Eigen/Dense>

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

// rad and mm: diagonal elements twelve orders of magnitude apart, and correlated.
TEST(Information, IsInvertedWhateverItsUnits) {
    Eigen::Matrix3d information;
    information << 4e9, 1.2e3, -8e4, 1.2e3, 9e-3, -0.03, -8e4, -0.03, 2.5e1;
    const auto inverse = covariance_from_information(information);
    ASSERT_TRUE(inverse);
    const Eigen::Vector3d unit = information.diagonal().cwiseSqrt();
    const Eigen::Matrix3d rest =
        unit.asDiagonal() * (*inverse) * information * unit.cwiseInverse().asDiagonal();
    EXPECT_LT((rest - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Information, HasNoInverseWhereADirectionIsUntold) {
    const Eigen::Vector3d row(1.0, -2.0, 0.5), other(0.3, 0.7, 1.1);
    EXPECT_FALSE(covariance_from_information(row * row.transpose() + other * other.transpose()));
    EXPECT_FALSE(covariance_from_information(Eigen::Vector3d(1.0, 0.0, 2.0).asDiagonal()));
    EXPECT_FALSE(covariance_from_information(
        Eigen::Vector3d(1.0, std::nan(""), 2.0).asDiagonal().toDenseMatrix()));
}

TEST(Information, TakesTheCallersBoundOfWhatIsRounding) {
    Eigen::Matrix2d information;
    information << 1.0, 0.999, 0.999, 1.0;  // eigenvalues 0.001 and 1.999
    EXPECT_TRUE(covariance_from_information(information, 0.9e-3));
    EXPECT_FALSE(covariance_from_information(information, 1.1e-3));
}

// 4000 independent groups: the scatter's elements are right to sqrt(2 / 4000) = 2.2 %.
TEST(ExcessScatter, OfIndependentGroupsIsTheirCovariance) {
    RandomStream random(7, 1);
    constexpr int groups = 4000;
    const Eigen::Vector3d deviations(1.0, 2.0, 3.0);
    Eigen::MatrixXd effects(3, groups);
    for (int i = 0; i < groups; ++i)
        for (int k = 0; k < 3; ++k)
            effects(k, i) = deviations[k] * random.normal() / std::sqrt(groups);
    const Eigen::MatrixXd found = excess_scatter(effects);
    const Eigen::Matrix3d expected = deviations.cwiseAbs2().asDiagonal();
    EXPECT_LT((found - expected).norm(), 5.0 * 0.022 * expected.norm());
}

// Few groups say little of the directions: what they show of them is drawn towards the mean.
TEST(ExcessScatter, OfFewGroupsIsDrawnTowardsTheSameEverywhere) {
    RandomStream random(8, 1);
    Eigen::MatrixXd effects(6, 8);
    for (double& effect : effects.reshaped())
        effect = 2.0 * random.normal() / std::sqrt(8.0);
    const auto spread = [](const Eigen::MatrixXd& matrix) {
        const Eigen::VectorXd values = matrix.selfadjointView<Eigen::Lower>().eigenvalues();
        return values.maxCoeff() / values.minCoeff();
    };
    const Eigen::MatrixXd sandwich = effects * effects.transpose(), found = excess_scatter(effects);
    EXPECT_NEAR(found.trace(), sandwich.trace(), 1e-12);
    EXPECT_LT(spread(found), 0.2 * spread(sandwich));
}

TEST(ExcessScatter, IsNeverBelowTheNoise) {
    const Eigen::MatrixXd little = Eigen::MatrixXd::Constant(2, 5, 0.01);
    EXPECT_GE(excess_scatter(little).trace(), 2.0 - 1e-12);
    EXPECT_EQ(excess_scatter(Eigen::MatrixXd::Zero(2, 5)), Eigen::MatrixXd::Identity(2, 2));
}

}  // namespace
}  // namespace etalon
