#include "calib/intrinsics/calibration_covariance.h"

#include <Eigen/Dense>

#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

const CalibrationModel three_parameters{"three", {"fx", "fy", "cx"}};

// A regression with clusters, without poses: rows X, errors e, solved in one piece.
struct Regression {
    std::vector<Eigen::MatrixXd> x;
    std::vector<Eigen::VectorXd> y;

    Eigen::Matrix3d inverse() const {
        Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
        for (const Eigen::MatrixXd& each : x)
            information += each.transpose() * each;
        return information.inverse();
    }
    std::vector<Eigen::VectorXd> residuals() const {
        Eigen::Vector3d score = Eigen::Vector3d::Zero();
        for (std::size_t g = 0; g < x.size(); ++g)
            score += x[g].transpose() * y[g];
        const Eigen::Vector3d solution = inverse() * score;
        std::vector<Eigen::VectorXd> all;
        for (std::size_t g = 0; g < x.size(); ++g)
            all.push_back(y[g] - x[g] * solution);
        return all;
    }
    // What view_equations() would give at the solution.
    std::vector<ViewEquations> equations() const {
        std::vector<ViewEquations> all;
        const auto r = residuals();
        for (std::size_t g = 0; g < x.size(); ++g) {
            const Eigen::HouseholderQR<Eigen::MatrixXd> qr(x[g]);
            ViewEquations view;
            view.triangle =
                Eigen::MatrixXd(qr.matrixQR().topRows(3).triangularView<Eigen::Upper>());
            view.rhs = (qr.householderQ().transpose() * r[g]).head(3);
            all.push_back(view);
        }
        return all;
    }
};

Regression regression(int seed, double noise) {
    RandomStream design(77, 1), errors(seed, 2);
    Regression made;
    for (const int rows : {7, 5, 11, 6, 4}) {
        Eigen::MatrixXd x(rows, 3);
        for (double& each : x.reshaped())
            each = design.normal();
        x.col(1) *= 1e3;  // units differ
        Eigen::VectorXd y(rows);
        for (double& each : y)
            each = noise * errors.normal();
        made.x.push_back(x);
        made.y.push_back(y);
    }
    return made;
}

// Bell and McCaffrey's formula on all rows, without any QR.
TEST(ClusterRobust, IsTheDenseFormulas) {
    const Regression data = regression(5, 0.7);
    const auto residuals = data.residuals();
    const Eigen::Matrix3d inverse = data.inverse();
    Eigen::Matrix3d middle = Eigen::Matrix3d::Zero();
    for (std::size_t g = 0; g < data.x.size(); ++g) {
        const Eigen::MatrixXd rest = Eigen::MatrixXd::Identity(data.x[g].rows(), data.x[g].rows()) -
                                     data.x[g] * inverse * data.x[g].transpose();
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(rest);
        const Eigen::Vector3d score =
            data.x[g].transpose() * (eigen.operatorInverseSqrt() * residuals[g]);
        middle += score * score.transpose();
    }
    const Eigen::Matrix3d dense = inverse * middle * inverse;
    const Eigen::MatrixXd ours =
        covariances_of(data.equations(), three_parameters, 0.49).cluster_robust;
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            EXPECT_NEAR(ours(i, k) / std::sqrt(dense(i, i) * dense(k, k)),
                        dense(i, k) / std::sqrt(dense(i, i) * dense(k, k)), 1e-9);
}

// Of independent errors with variance s^2 the correction makes the mean s^2 (X^T X)^-1 exactly,
// however few clusters. Mean of 4000, each a sum of five squares with a relative deviation below
// sqrt(2): standard error below 0.0224; 3.5 of it.
TEST(ClusterRobust, IsUnbiasedForFiveClusters) {
    const int runs = 4000;
    const double noise = 0.7;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (int run = 0; run < runs; ++run)
        mean += covariances_of(regression(1000 + run, noise).equations(), three_parameters, 0.49)
                    .cluster_robust.diagonal() /
                runs;
    const Eigen::Matrix3d truth = noise * noise * regression(0, noise).inverse();
    for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(mean[i] / truth(i, i), 1.0, 3.5 * 0.0224) << i;
}

TEST(FormalCovariance, IsTheVarianceTimesTheInverseInformation) {
    const Regression data = regression(5, 0.7);
    const Eigen::Matrix3d expected = 0.49 * data.inverse();
    const Eigen::MatrixXd ours = covariances_of(data.equations(), three_parameters, 0.49).formal;
    for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(ours(i, i) / expected(i, i), 1.0, 1e-9);
}

// Draws 1, 2, 4 of one parameter: mean 7/3, squares 42/9, over 2 degrees of freedom 7/3; times
// 8/7 for eight views.
TEST(Bootstrap, CovarianceIsTheScatterOfTheDraws) {
    Bootstrap bootstrap;
    for (const double draw : {1.0, 2.0, 4.0})
        bootstrap.parameters.push_back(Eigen::VectorXd::Constant(1, draw));
    EXPECT_NEAR(bootstrap.covariance(8)(0, 0), 8.0 / 7.0 * 7.0 / 3.0, 1e-12);
}

TEST(ParameterDeviation, ComparesWhatIsStatedWithTheFormalOne) {
    EXPECT_EQ((ParameterDeviation{"fx", 2.0, 2.5, 2.0, 3.0}.ratio()), 1.5);
    EXPECT_EQ((ParameterDeviation{"fx", 0.0, 0.0, std::nullopt, 0.0}.ratio()), 1.0);
}

// In the units in which the formal covariance is the identity.
Eigen::Matrix3d in_formal_units(const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& formal) {
    const Eigen::LLT<Eigen::MatrixXd> root(formal);
    const Eigen::MatrixXd half = root.matrixL().solve(covariance);
    return root.matrixL().solve(half.transpose());
}

// The dense formula of Ledoit and Wolf (2004), their section 3.3, with the zero mean that scores
// have at the solution.
TEST(StatedCovariance, IsTheRobustOneDrawnTowardsTheFormalOne) {
    const double variance = 0.49;
    for (const int seed : {5, 6, 7}) {
        const Regression data = regression(seed, 1.4);
        const auto found = covariances_of(data.equations(), three_parameters, variance);
        const Eigen::Matrix3d s = in_formal_units(found.cluster_robust, found.formal),
                              ours = in_formal_units(found.stated, found.formal);
        const double mean = std::max(1.0, s.trace() / 3.0);
        EXPECT_NEAR(ours.trace(), 3.0 * mean, 1e-9 * mean);
        // What is not the identity is a share of the robust one's.
        const Eigen::Matrix3d of_ours = ours / mean - Eigen::Matrix3d::Identity(),
                              of_s = s / (s.trace() / 3.0) - Eigen::Matrix3d::Identity();
        const double share = of_ours.cwiseProduct(of_s).sum() / of_s.squaredNorm();
        EXPECT_GE(share, 0.0);
        EXPECT_LE(share, 1.0);
        EXPECT_LT((of_ours - share * of_s).norm(), 1e-9);
    }
}

// Fewer clusters than parameters: the robust covariance has no width in some directions.
TEST(StatedCovariance, HasNoDirectionNarrowerThanFewClustersAllow) {
    Regression data = regression(5, 0.7);
    data.x.resize(2);
    data.y.resize(2);
    const auto found = covariances_of(data.equations(), three_parameters, 0.49);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> robust(
        Eigen::MatrixXd(in_formal_units(found.cluster_robust, found.formal)));
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> stated(
        Eigen::MatrixXd(in_formal_units(found.stated, found.formal)));
    EXPECT_LT(robust.eigenvalues()[0], 1e-9);
    EXPECT_GT(stated.eigenvalues()[0], 0.1);
}

}  // namespace
}  // namespace etalon
