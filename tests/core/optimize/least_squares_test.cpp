#include "core/optimize/least_squares.h"

#include "tests/test.h"

namespace etalon {
namespace {

constexpr std::array times = {0.0, 0.3, 0.9, 1.4, 2.2, 3.1, 4.5};

// a exp(-b t) at seven times, with derivatives; the third parameter has no effect.
ResidualsAndJacobian decay(const Eigen::Vector3d& at, const Eigen::VectorXd& measured) {
    ResidualsAndJacobian all{Eigen::VectorXd(times.size()), Eigen::MatrixXd(times.size(), 3)};
    for (Eigen::Index i = 0; i < all.residuals.size(); ++i) {
        const double t = times[static_cast<std::size_t>(i)], e = std::exp(-at[1] * t);
        all.residuals[i] = at[0] * e - measured[i];
        all.jacobian.row(i) << e, -at[0] * t * e, 0.0;
    }
    return all;
}

Eigen::VectorXd decaying(double a, double b) {
    return decay({a, b, 0.0}, Eigen::VectorXd::Zero(std::ssize(times))).residuals;
}

std::optional<Eigen::Vector3d> fitted(const Eigen::VectorXd& measured,
                                      const LeastSquaresRule& rule) {
    const auto found = least_squares(
        Eigen::Vector3d(1.0, 0.1, 5.5), rule,
        [&](const Eigen::Vector3d& at) -> std::optional<ResidualsAndJacobian> {
            if (at[1] < 0.0)
                return std::nullopt;
            return decay(at, measured);
        },
        [](const Eigen::Vector3d& at, const Eigen::VectorXd& step) {
            return std::optional(Eigen::Vector3d(at + step));
        });
    if (!found || !found->converged)
        return std::nullopt;
    return found->place.unknowns;
}

TEST(LeastSquares, RecoversADecayAndLeavesWhatNothingDetermines) {
    const auto found = fitted(decaying(3.7, 0.83), {});
    ASSERT_TRUE(found);
    EXPECT_NEAR((*found)[0], 3.7, 1e-9);
    EXPECT_NEAR((*found)[1], 0.83, 1e-9);
    EXPECT_EQ((*found)[2], 5.5);
}

// At Huber's minimum the outlier pulls like a residual at the threshold.
TEST(LeastSquares, LimitsThePullOfAnOutlier) {
    Eigen::VectorXd measured = decaying(3.7, 0.83);
    measured[3] += 40.0;
    const auto found = fitted(measured, {.huber = 0.02});
    ASSERT_TRUE(found);
    ResidualsAndJacobian at = decay(*found, measured);
    EXPECT_LT(at.residuals[3], -39.0);
    at.residuals = at.residuals.cwiseMax(-0.02).cwiseMin(0.02);
    EXPECT_LT((at.jacobian.transpose() * at.residuals).norm(), 1e-6);
}

TEST(LeastSquares, SaysWhenTheStepsWereNotEnough) {
    EXPECT_FALSE(fitted(decaying(3.7, 0.83), {.descent = {.max_tries = 2}}));
    EXPECT_FALSE(fitted(Eigen::VectorXd::Constant(std::ssize(times), std::nan("")), {}));
}

}  // namespace
}  // namespace etalon
