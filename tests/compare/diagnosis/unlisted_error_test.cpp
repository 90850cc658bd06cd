// Truth: the density of a Gaussian with its whole covariance written out, and corners of a stage
// whose axis is misread.
#include "compare/diagnosis/unlisted_error.h"

#include <Eigen/Dense>

#include "tests/compare/qualification/injected_errors.h"
#include "tests/test.h"

namespace etalon {
namespace {

struct DemoRequest {
    SimulatedRun run = demo_run();
    Projector projector{run.camera};
    SignatureChain chain{
        projector, run.points_mm, run.camera_from_base, run.carriage_from_marker, {}};
    CandidateRequest request{chain, {}, {}, {}};

    DemoRequest() {
        const auto all = positions(run, run.plan_seed.value());
        for (std::size_t i = 0; i < all.size(); ++i) {
            chain.poses.emplace_back().base_from_carriage = base_from_carriage(run.axes, all[i]);
            request.times_s.push_back(2.0 * static_cast<double>(i));
        }
        for (std::size_t k = 0; k < run.axes.size(); ++k)
            request.axes.push_back(axis_motion(run, all, k));
    }
};

Eigen::VectorXd normal_numbers(Eigen::Index count, std::uint64_t seed) {
    RandomStream random(seed, 1);
    Eigen::VectorXd all(count);
    for (double& each : all)
        each = random.normal();
    return all;
}

// Log density of rows that `left` (an orthonormal basis) keeps, up to a constant.
double log_density(const Eigen::MatrixXd& left, const Eigen::VectorXd& rows,
                   const Eigen::MatrixXd& covariance) {
    const Eigen::LLT<Eigen::MatrixXd> factor(Eigen::MatrixXd(left.transpose() * covariance * left));
    const Eigen::VectorXd seen = left.transpose() * rows;
    return -0.5 * seen.dot(factor.solve(seen)) -
           Eigen::MatrixXd(factor.matrixL()).diagonal().array().log().sum();
}

TEST(UnlistedErrors, AreAsProbableAsTheirCovarianceSays) {
    constexpr Eigen::Index poses = 5, rows = 6 * poses;
    std::vector<Eigen::MatrixXd> moves;
    ObservedPoses observed;
    for (std::uint64_t i = 0; i < poses; ++i) {
        moves.emplace_back(normal_numbers(6, 20 + i));
        observed.seen_by.emplace_back(normal_numbers(36, 40 + i).reshaped(6, 6));
    }
    const Eigen::MatrixXd factor = normal_numbers(2 * poses, 3).reshaped(poses, 2);
    const UnlistedError error{"", "mm", std::make_shared<const std::vector<Eigen::MatrixXd>>(moves),
                              std::make_shared<const Eigen::MatrixXd>(factor)};
    const Eigen::MatrixXd basis =
        Eigen::HouseholderQR<Eigen::MatrixXd>(normal_numbers(rows * rows, 5).reshaped(rows, rows))
            .householderQ();
    const Eigen::MatrixXd left = basis.rightCols(rows - 4);
    observed.absorbed = basis.leftCols(4);
    Eigen::MatrixXd columns = error.perturbations();
    for (Eigen::Index i = 0; i < poses; ++i)
        columns.middleRows<6>(6 * i) =
            observed.seen_by[static_cast<std::size_t>(i)] * columns.middleRows<6>(6 * i).eval();
    const Eigen::VectorXd seen = normal_numbers(rows, 6) + columns * Eigen::Vector2d(0.7, -1.1);
    observed.values = left * (left.transpose() * seen);
    observed.square = observed.values.squaredNorm();
    observed.freedom = 1e9;  // no more scatter than is stated

    const UnlistedFit fit = fit_unlisted({error}, observed);
    const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(rows, rows);
    const double without = log_density(left, seen, one);
    double sum = 0.0, best = 0.0;
    for (int k = 0; k < 14; ++k) {
        const double size = std::ldexp(1e-3, k);
        const double gained =
            log_density(left, seen, one + size * size * columns * columns.transpose()) - without;
        sum += std::exp(gained);
        best = std::max(best, gained);
    }
    EXPECT_NEAR(fit.best, best, 1e-8);
    EXPECT_NEAR(fit.mean, std::log(sum / 14.0), 1e-8);
    EXPECT_GT(fit.best, 5.0);
}

// z is misread as a wave of y, once over its travel: no shift that follows anything else explains
// it as well.
TEST(UnlistedErrors, ArePutDownToWhatTheyFollow) {
    const DemoRequest demo;
    const std::vector<UnlistedError> all = unlisted_errors(demo.request);
    EXPECT_GT(all.size(), 150u);
    ObservedPoses observed;
    const StageAxisMotion& y = demo.request.axes[1];
    const StageAxisMotion& z = demo.request.axes[2];
    constexpr double noise_px = 0.01;
    const auto poses = demo.chain.poses.size();
    observed.values.resize(6 * static_cast<Eigen::Index>(poses));
    const Eigen::VectorXd advance = sensitivity_px(demo.request, z) / z.step;
    for (std::size_t i = 0; i < poses; ++i) {
        const Eigen::HouseholderQR<Eigen::MatrixXd> solver(
            Eigen::MatrixXd(demo.chain.pose_jacobian(i) / noise_px));
        const Eigen::MatrixXd directions = solver.householderQ() * Eigen::MatrixXd::Identity(8, 6);
        observed.seen_by.emplace_back(
            Matrix6d(solver.matrixQR().topRows<6>().triangularView<Eigen::Upper>()));
        const auto at = static_cast<Eigen::Index>(i);
        const double off_mm = 0.4 * std::sin(std::numbers::pi * y.position[i] / 80.0);
        observed.values.segment<6>(6 * at) =
            directions.transpose() *
            (off_mm / noise_px * advance.segment(8 * at, 8) + normal_numbers(8, 100 + i));
    }
    observed.absorbed = Eigen::MatrixXd::Zero(observed.values.size(), 0);
    observed.square = observed.values.squaredNorm();
    observed.freedom = static_cast<double>(observed.values.size());
    const UnlistedFit fit = fit_unlisted(all, observed);
    EXPECT_EQ(all[fit.error].text, "an error of z that follows y");
    EXPECT_GT(fit.mean, 100.0);
    EXPECT_LT((all[fit.error].corners_px(demo.chain).topRows(8) -
               demo.chain.pose_jacobian(0) * all[fit.error].perturbations().topRows(6))
                  .norm(),
              1e-9);
}

}  // namespace
}  // namespace etalon
