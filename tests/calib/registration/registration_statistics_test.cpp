// 2000 Monte-Carlo registrations each on four stages: does the stated covariance tell the scatter?
//
// Per stage: the mean squared Mahalanobis distance of (X, Y) from the truth, the share of
// registrations inside the 95 % ellipsoid, the scatter matrix in every direction, the mean error,
// and for each of 12 parameters the share of registrations inside 1.96 standard deviations. 4 x 16
// = 64 comparisons at a family-wise 1 % are 1.56e-4 each: 3.78 standard deviations of a normal
// deviate, two-sided.

#include <Eigen/Dense>

#include "calib/registration/registration.h"
#include "core/statistics/random.h"
#include "tests/calib/cameras.h"
#include "tests/calib/registration/true_stage.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int registrations = 2000;
constexpr double corner_noise_px = 0.05;
constexpr double risk = 0.01 / 64.0, normal_limit = 3.78;

// 12 poses with [x y z rx ry rz] within +- the reach, mm and rad.
std::vector<Rigid> stage_poses(const Vector6d& reach) {
    std::vector<Rigid> poses;
    for (std::uint64_t i = 0; i < 12; ++i) {
        RandomStream random(17, 1, i);
        Vector6d q;
        for (int k = 0; k < 6; ++k)
            q[k] = reach[k] * (2.0 * random.uniform() - 1.0);
        poses.push_back({rotation_from_vector({0, 0, q[5]}) * rotation_from_vector({q[3], 0, 0}) *
                             rotation_from_vector({0, q[4], 0}),
                         q.head<3>()});
    }
    return poses;
}

std::vector<RegistrationPose> exact_views(const Projector& projector, const Vector6d& reach) {
    std::vector<RegistrationPose> poses;
    for (const Rigid& stage : stage_poses(reach)) {
        RegistrationPose pose{stage, true_x * stage * true_y, {}, corner_noise_px};
        for (const Eigen::Vector3d& point : tag)
            pose.pixels.push_back(projector.project(pose.camera_from_marker * point).value());
        poses.push_back(pose);
    }
    return poses;
}

// Errors of X and Y, run by run, and what the registrations state about them.
struct Runs {
    Eigen::MatrixXd errors{12, registrations};
    Eigen::VectorXd squared_distance{registrations};  // Mahalanobis'
    Vector12d inside = Vector12d::Zero();      // registrations within 1.96 standard deviations
    Matrix12d covariance = Matrix12d::Zero();  // mean of the stated ones
    int rank = 0;
};

// The determined directions, scaled to unit variance: pseudo-inverse by the known rank.
Eigen::MatrixXd whitening(const Matrix12d& covariance, int rank) {
    const Vector12d scale = covariance.diagonal().cwiseSqrt().cwiseMax(1e-12).cwiseInverse();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
        Eigen::MatrixXd(scale.asDiagonal() * covariance * scale.asDiagonal()));
    return solver.eigenvalues().tail(rank).cwiseSqrt().cwiseInverse().asDiagonal() *
           solver.eigenvectors().rightCols(rank).transpose() * scale.asDiagonal();
}

// The freedoms are held at the truth, so that all 12 numbers have an error to speak of.
Runs registered(const Vector6d& reach) {
    const Projector projector(webcam());
    const std::vector<RegistrationPose> exact = exact_views(projector, reach);
    Runs all;
    for (int run = 0; run < registrations; ++run) {
        std::vector<RegistrationPose> poses = exact;
        for (std::size_t i = 0; i < poses.size(); ++i) {
            RandomStream random(static_cast<std::uint64_t>(run), 2, i);
            for (Eigen::Vector2d& pixel : poses[i].pixels)
                pixel += corner_noise_px * Eigen::Vector2d{random.normal(), random.normal()};
        }
        const Registration result = register_stage(projector, tag, poses, true_y);
        Vector12d error;
        error << left_difference(true_x, result.camera_from_base),
            left_difference(true_y, result.carriage_from_marker);
        all.rank = result.rank;
        all.errors.col(run) = error;
        all.squared_distance[run] =
            (whitening(result.covariance, result.rank) * error).squaredNorm();
        all.inside.array() +=
            (error.array().abs() <= 1.96 * result.covariance.diagonal().array().sqrt().max(1e-9))
                .cast<double>();
        all.covariance += result.covariance / registrations;
    }
    return all;
}

// A sum of `count` squares of normal deviates has mean `count` and variance 2 `count`.
void expect_distances(const Runs& all, double quantile_95) {
    EXPECT_NEAR(all.squared_distance.mean(), all.rank,
                normal_limit * std::sqrt(2.0 * all.rank / registrations));
    const double inside =
        static_cast<double>((all.squared_distance.array() <= quantile_95).count()) / registrations;
    EXPECT_NEAR(inside, 0.95, normal_limit * std::sqrt(0.95 * 0.05 / registrations));
}

// Singular values of an n x r matrix of normal deviates over sqrt(n) leave 1 +- (sqrt(r/n) + t)
// with a probability below 2 exp(-n t^2 / 2) (Davidson and Szarek 2001, theorem II.13).
void expect_scatter(const Runs& all) {
    const Eigen::MatrixXd whitened = whitening(all.covariance, all.rank) * all.errors;
    const Eigen::VectorXd values =
        Eigen::JacobiSVD<Eigen::MatrixXd>(whitened / std::sqrt(registrations)).singularValues();
    const double t = std::sqrt(2.0 * std::log(2.0 / risk) / registrations);
    const double reach = std::sqrt(static_cast<double>(all.rank) / registrations) + t;
    EXPECT_LT(values[0], 1.0 + reach);
    EXPECT_GT(values[all.rank - 1], 1.0 - reach);
}

// n |mean|^2 of whitened errors is a chi-square of r degrees of freedom, which exceeds
// r + 2 sqrt(r x) + 2 x with a probability below exp(-x) (Laurent and Massart 2000, lemma 1).
void expect_no_bias(const Runs& all) {
    const Eigen::VectorXd mean =
        (whitening(all.covariance, all.rank) * all.errors).rowwise().mean();
    const double x = std::log(1.0 / risk);
    EXPECT_LT(registrations * mean.squaredNorm(),
              all.rank + 2.0 * std::sqrt(all.rank * x) + 2.0 * x);
}

void expect_coverage(const Runs& all) {
    for (int k = 0; k < 12; ++k)
        if (all.covariance(k, k) > 1e-16) {  // else held at the truth: always inside
            EXPECT_NEAR(all.inside[k] / registrations, 0.95,
                        normal_limit * std::sqrt(0.95 * 0.05 / registrations))
                << "parameter " << k;
        }
}

// `quantile_95` of chi-square with `rank` degrees of freedom: from the table.
void expect_true_covariance(const Vector6d& reach, int rank, double quantile_95) {
    const Runs all = registered(reach);
    ASSERT_EQ(all.rank, rank);
    expect_distances(all, quantile_95);
    expect_scatter(all);
    expect_no_bias(all);
    expect_coverage(all);
}

Vector6d reach(double x, double y, double z, double rx, double ry, double rz) {
    return (Vector6d() << x, y, z, rx, ry, rz).finished();
}

TEST(RegistrationStatistics, HoldOnAStageOfSixAxes) {
    expect_true_covariance(reach(90, 70, 110, 0.4, 0.3, 3.0), 12, 21.026);
}

TEST(RegistrationStatistics, HoldOnXyzWithARotaryAxis) {
    expect_true_covariance(reach(90, 70, 110, 0, 0, 3.0), 11, 19.675);
}

TEST(RegistrationStatistics, HoldOnOneLinearAxisWithFourFreedoms) {
    expect_true_covariance(reach(90, 0, 0, 0, 0, 0), 8, 15.507);
}

// The shifts that two degrees hardly show: their deviation is large, and right.
TEST(RegistrationStatistics, HoldAlongDirectionsThatAreBadlyDetermined) {
    expect_true_covariance(reach(90, 70, 110, 0, 0, 2.0 * std::numbers::pi / 180.0), 11, 19.675);
}

}  // namespace
}  // namespace etalon
