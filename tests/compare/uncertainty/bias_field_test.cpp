#include "compare/uncertainty/bias_field.h"

#include "compare/uncertainty/budget_monte_carlo.h"
#include "compare/uncertainty/uncertainty_budget.h"
#include "tests/compare/uncertainty/field_samples.h"
#include "tests/test.h"

namespace etalon {
namespace {

using namespace field_samples;

TEST(BiasField, ReproducesAFieldOfItsOwnTermsEverywhere) {
    const BiasField field = fit_smooth_field(samples(40, 1.0, 0.0, 1), FieldBasis::position);
    for (std::size_t i = 100; i < 120; ++i)
        EXPECT_LT((field.at(position(i)) - truth(position(i))).norm(), 1e-9);
    EXPECT_EQ(field.degrees_of_freedom, 3 * 40 - 15);
}

// A third-order term of an equidistant lens that is off turns every line of sight outwards by
// size theta^3. Some positions are behind the camera's plane.
TEST(BiasField, OfAWideLensFollowsAWrongDistortionAllAround) {
    const auto place = [](std::size_t i) {
        const double theta = 0.06 + 1.85 * std::fmod(0.618 * static_cast<double>(i), 1.0);
        const double phi = 2.4 * static_cast<double>(i);
        const double distance = 300.0 + 120.0 * std::sin(1.7 * static_cast<double>(i));
        return Eigen::Vector3d(distance * std::sin(theta) * std::cos(phi),
                               distance * std::sin(theta) * std::sin(phi),
                               distance * std::cos(theta));
    };
    const auto error = [](const Eigen::Vector3d& p) {
        const double theta = std::acos(p.z() / p.norm());
        const Eigen::Vector3d axis = Eigen::Vector3d::UnitZ().cross(p).normalized();
        return Eigen::Vector3d(Eigen::AngleAxisd(1e-6 * std::pow(theta, 3), axis) * p - p);
    };
    std::vector<FieldSample> all;
    for (std::size_t i = 1; i <= 60; ++i)
        all.push_back({.position_mm = place(i), .error = error(place(i))});
    const BiasField field = fit_smooth_field(all, FieldBasis::position_by_angle);
    for (std::size_t i = 100; i < 120; ++i)
        EXPECT_LT((field.at(place(i)) - error(place(i))).norm(), 1e-8);
    EXPECT_THROW(fit_smooth_field(all, FieldBasis::position), NumericalError);
}

// Nothing tells how the errors change across the plane z = 420 mm; in it they are found as ever.
TEST(BiasField, OfAPlaneIsTheFieldInThatPlane) {
    const auto in_plane = [](std::size_t i) {
        Eigen::Vector3d p = position(i);
        p.z() = 420.0;
        return p;
    };
    for (const FieldBasis basis :
         {FieldBasis::position, FieldBasis::position_by_angle, FieldBasis::linear}) {
        std::vector<FieldSample> all;
        for (std::size_t i = 0; i < 40; ++i) {
            const Eigen::Vector3d p = in_plane(i);
            all.push_back({.position_mm = p,
                           .error = {0.02 + 1e-4 * p.x(), 3e-4 * p.x() - 2e-4 * p.y(), 0.1}});
        }
        const BiasField field = fit_smooth_field(all, basis);
        EXPECT_FALSE(field.is_full());
        for (std::size_t i = 100; i < 120; ++i) {
            const Eigen::Vector3d p = in_plane(i);
            const Eigen::Vector3d expected(0.02 + 1e-4 * p.x(), 3e-4 * p.x() - 2e-4 * p.y(), 0.1);
            EXPECT_LT((field.at(p) - expected).norm(), 1e-9);
        }
    }
    EXPECT_TRUE(fit_smooth_field(samples(40, 1.0, 0.0, 1), FieldBasis::position).is_full());
}

TEST(BiasField, ByAngleIsTheOneByTangentNearTheAxis) {
    for (const Eigen::Vector3d& p : {Eigen::Vector3d(1.1, -0.7, 400.0), Eigen::Vector3d(0, 0, 250)})
        for (Eigen::Index column = 12; column < 15; ++column) {
            const Eigen::Vector3d centre(0.0, 0.0, 330.0);
            const BiasField tangent{.basis = FieldBasis::position, .centre_mm = centre},
                angle{.basis = FieldBasis::position_by_angle, .centre_mm = centre};
            const Eigen::Vector3d expected = tangent.design(p).col(column);
            EXPECT_LT((angle.design(p).col(column) - expected).norm(),
                      0.004 * expected.norm() + 1e-15);
        }
}

TEST(BiasField, SummarisesAFieldAsItsTrueRmsAndMaximum) {
    const BiasField field = fit_smooth_field(samples(40, 1.0, 0.0, 1), FieldBasis::position);
    double sum = 0.0, largest = 0.0;
    for (std::size_t i = 0; i < 60; ++i)
        sum += truth(position(i)).squaredNorm() / 60;
    for (const Eigen::Vector3d& p : hull_positions(positions(60)))
        largest = std::max(largest, truth(p).norm());
    const FieldSummary summary = summarize(field, positions(60), NoiseDraws(1));
    EXPECT_NEAR(summary.rms, std::sqrt(sum), 1e-8);
    EXPECT_NEAR(summary.max, largest, 1e-8);
    EXPECT_LT(summary.rms_uncertainty + summary.max_uncertainty, 1e-6);
}

TEST(BiasField, TakesThePowerOfNoiseOutOfTheRmsAndNeverGoesBelowZero) {
    for (const double size : {1.0, 0.0}) {
        const BiasField field = fit_smooth_field(samples(40, size, 0.05, 3), FieldBasis::position);
        double power = 0.0;
        for (const Eigen::Vector3d& p : positions(40))
            power += field.at(p).squaredNorm() / 40;
        const FieldSummary summary = summarize(field, positions(40), NoiseDraws(1));
        EXPECT_GT(summary.noise_rms, 0.0);
        EXPECT_NEAR(summary.rms * summary.rms,
                    std::max(0.0, power - summary.noise_rms * summary.noise_rms), 1e-12);
    }
}

TEST(BiasField, IsHardlyMovedByOneWildSample) {
    std::vector<FieldSample> all = samples(40, 1.0, 0.01, 5);
    all[17].error += Eigen::Vector3d(3.0, -2.0, 8.0);
    const BiasField field = fit_smooth_field(all, FieldBasis::position);
    EXPECT_GE(field.down_weighted, 1);
    double sum = 0.0;
    for (const Eigen::Vector3d& p : positions(40))
        sum += (field.at(p) - truth(p)).squaredNorm() / 40;
    EXPECT_LT(std::sqrt(sum), 0.1);  // plain least squares: 8 mm sqrt(15 / 120) / sqrt(40) and more
}

TEST(BiasField, RefusesSamplesThatCannotCarryIt) {
    EXPECT_THROW(fit_smooth_field(samples(9, 1.0, 0.01, 1), FieldBasis::linear), NumericalError);
    std::vector<FieldSample> bad = samples(40, 1.0, 0.01, 1);
    bad[3].error.y() = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(fit_smooth_field(bad, FieldBasis::position), NumericalError);
    bad = samples(40, 1.0, 0.01, 1);
    bad[3].sigma_along = 0.0;
    EXPECT_THROW(fit_smooth_field(bad, FieldBasis::position), NumericalError);
}

// By all vectors in all draws: the rank is that of 0.977 of 2000.
TEST(NoiseQuantile, LeavesOutOnlyWhatCannotMatter) {
    const BiasField field = fit_smooth_field(samples(40, 1.0, 0.05, 5), FieldBasis::position);
    const NoiseDraws draws(9);
    Eigen::MatrixXd rows(3 * 200, 15);
    for (std::size_t i = 0; i < 200; ++i)
        rows.middleRows<3>(static_cast<Eigen::Index>(3 * i)) = field.design(position(i));
    const Eigen::MatrixXd all = rows * covariance_factor(field) * draws.deviates;
    for (const int components : {1, 3}) {
        std::vector<double> largest;
        for (const auto& draw : all.colwise())
            largest.push_back(
                draw.reshaped(components, all.rows() / components).colwise().norm().maxCoeff());
        std::ranges::sort(largest);
        const auto some = [&](Eigen::Index first, Eigen::Index count) -> Eigen::MatrixXd {
            return rows.middleRows(first * components, count * components);
        };
        EXPECT_NEAR(noise_quantile(field, draws, {all.rows() / components, components, some}),
                    largest[1954], 1e-12);
    }
}

TEST(HullPositions, AreTheGivenOnesAndTheMidpointsOfAllPairs) {
    const std::vector<Eigen::Vector3d> corners = {{0, 0, 1}, {4, 0, 1}, {0, 6, 3}};
    const std::vector<Eigen::Vector3d> all = hull_positions(corners);
    ASSERT_EQ(all.size(), 6u);
    EXPECT_EQ(all[3], Eigen::Vector3d(2, 0, 1));
    EXPECT_EQ(all[5], Eigen::Vector3d(2, 3, 2));
}

TEST(MonteCarloStop, IsAnInterruption) {
    const auto all = samples(40, 1.0, 0.0, 1);
    const BiasField field = fit_smooth_field(all, FieldBasis::position);
    std::stop_source stop;
    EXPECT_NO_THROW(monte_carlo_uncertainty(field, all, positions(40), {}, 1, stop.get_token()));
    stop.request_stop();
    EXPECT_THROW(monte_carlo_uncertainty(field, all, positions(40), {}, 1, stop.get_token()),
                 Interrupted);
}

// ---- uncertainty budget

BudgetRow row(const std::string& source, std::optional<double> uncertainty, double sensitivity,
              double degrees_of_freedom = std::numeric_limits<double>::infinity()) {
    return {.source = source,
            .standard_uncertainty = uncertainty,
            .unit = "mm",
            .degrees_of_freedom = degrees_of_freedom,
            .sensitivity = {{"y", sensitivity}}};
}

// Coverage factors for 95.45 % two-sided, the same as 97.72 % one-sided: GUM, table G.2.
TEST(UncertaintyBudget, TakesCoverageFactorsFromStudentsDistribution) {
    EXPECT_NEAR(coverage_factor(1), 13.97, 0.005);
    EXPECT_NEAR(coverage_factor(7), 2.43, 0.005);
    EXPECT_NEAR(coverage_factor(50), 2.05, 0.005);
    EXPECT_NEAR(coverage_factor(7.9), 2.43, 0.005);  // not rounded up (G.4.1)
    EXPECT_NEAR(coverage_factor(4999), 2.0, 0.001);
    EXPECT_EQ(coverage_factor(std::numeric_limits<double>::infinity()), 2.0);
}

// Contributions 3 (5 degrees of freedom) and 4: standard 5, 5^4 / (3^4 / 5) = 38.58 degrees.
TEST(UncertaintyBudget, AddsInQuadratureWithEffectiveDegreesOfFreedom) {
    const std::vector<BudgetRow> budget{row("a", 1.5, 2.0, 5.0), row("b", 8.0, 0.5)};
    EXPECT_DOUBLE_EQ(budget[0].contribution("y"), 3.0);
    EXPECT_EQ(budget[0].contribution("other"), 0.0);
    const CombinedUncertainty result = combined(budget, "y");
    EXPECT_DOUBLE_EQ(result.standard, 5.0);
    EXPECT_NEAR(result.degrees_of_freedom, 625.0 / (81.0 / 5.0), 1e-9);
    EXPECT_DOUBLE_EQ(result.coverage_factor, coverage_factor(38.0));
    EXPECT_DOUBLE_EQ(result.expanded, 5.0 * result.coverage_factor);
    EXPECT_EQ(combined(budget, "other").expanded, 0.0);
}

TEST(UncertaintyBudget, LeavesOutWhatIsNotCounted) {
    std::vector<BudgetRow> budget{row("a", 3.0, 1.0), row("b", 4.0, 1.0)};
    budget[1].counted = false;
    EXPECT_DOUBLE_EQ(combined(budget, "y").standard, 3.0);
    budget[1].standard_uncertainty.reset();
    EXPECT_THAT(unknown_sources(budget, "y", true), IsEmpty());
}

TEST(UncertaintyBudget, KnowsWhichUnknownInputsReachAQuantity) {
    std::vector<BudgetRow> budget{row("known", 3.0, 1.0), row("unbounded", {}, 1.0),
                                  row("bounded", {}, 2.0), row("without effect", {}, 0.0)};
    budget[2].widest = 2.0;
    EXPECT_THAT(unknown_sources(budget, "y", true), ElementsAre("unbounded"));
    EXPECT_THAT(unknown_sources(budget, "y", false), ElementsAre("bounded"));
    EXPECT_THAT(unknown_sources(budget, "other", true), IsEmpty());
    EXPECT_DOUBLE_EQ(combined(budget, "y").standard, 3.0);
    EXPECT_DOUBLE_EQ(combined(budget, "y", true).standard, 5.0);  // 3 and 2 x 2
}

TEST(UncertaintyBudget, RefusesFiguresThatAreNoUncertainties) {
    for (const double bad : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()})
        EXPECT_THROW(combined(std::vector{row("a", bad, 1.0)}, "y"), NumericalError);
    EXPECT_THROW(combined(std::vector{row("a", 1.0, 1.0, 0.5)}, "y"), NumericalError);
}

}  // namespace
}  // namespace etalon
