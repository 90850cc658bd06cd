#include "compare/expect/pose_statistics.h"
#include "core/geometry/units.h"
#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

Rigid pose(double roll_deg, double pitch_deg, double yaw_deg, const Eigen::Vector3d& place) {
    return {
        rotation_from_roll_pitch_yaw(rad_per_deg * Eigen::Vector3d(roll_deg, pitch_deg, yaw_deg)),
        place};
}

// An error of this size in X, nothing elsewhere.
DetectedError in_x(double error_mm, bool flip = false) {
    DetectedError error;
    error.measures[0] = error_mm;
    error.measures[6] = std::abs(error_mm);
    error.flip = flip;
    return error;
}

TEST(PoseErrors, AreDifferencesOfThePublishedStudysSixComponents) {
    const Rigid truth = pose(20.0, -30.0, 65.0, {40.0, -25.0, 900.0});
    const Rigid estimated = pose(21.5, -32.5, 65.25, {47.0, -30.0, 903.0});
    const auto error = detected_error(estimated, truth, false).measures;
    const double expected[] = {7.0, -5.0, 3.0, 1.5, -2.5, 0.25, std::sqrt(83.0)};
    for (std::size_t k = 0; k < 7; ++k)
        EXPECT_NEAR(error[k], expected[k], 1e-9) << error_measures[k].name;
    const PoseComponents components = pose_components(truth);
    const double of_truth[] = {40.0, -25.0, 900.0, 20.0, -30.0, 65.0};
    for (std::size_t k = 0; k < 6; ++k)
        EXPECT_NEAR(components[k], of_truth[k], 1e-9) << k;
}

// From yaw 179.25 to -179.5 is a turn by 1.25 degrees about the camera's axis.
TEST(PoseErrors, TakeTheShortWayRoundAtHalfATurn) {
    const Rigid truth = pose(7.0, 5.0, 179.25, {0.0, 0.0, 700.0});
    const Rigid estimated = pose(7.0, 5.0, -179.5, {0.0, 0.0, 700.0});
    const auto error = detected_error(estimated, truth, false).measures;
    EXPECT_NEAR(error[5], 1.25, 1e-9);
    EXPECT_NEAR(detected_error(truth, estimated, false).measures[5], -1.25, 1e-9);
    EXPECT_NEAR(error[7], 1.25, 1e-9);
}

TEST(PoseErrors, AreNeverNotANumber) {
    Rigid estimated = pose(7.0, 5.0, 3.0, {0.0, 0.0, 700.0});
    estimated.translation.y() = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(detected_error(estimated, Rigid{}, false), NumericalError);
    estimated = pose(5.0, 90.0, 3.0, {0.0, 0.0, 700.0});  // where roll and yaw are one
    const auto error = detected_error(estimated, Rigid{}, false).measures;
    for (const double each : error)
        EXPECT_TRUE(std::isfinite(each));
}

TEST(PoseErrors, CallAnEstimateAFlipWhenItsOtherSolutionIsNearer) {
    const Rigid truth = pose(20.0, -5.0, 10.0, {0.0, 0.0, 700.0});
    PoseEstimate estimate;
    estimate.camera_from_marker = pose(-19.0, 6.0, 10.0, truth.translation);
    EXPECT_FALSE(is_flip(estimate, truth));  // no other solution
    estimate.alternative = pose(21.0, -5.0, 10.0, truth.translation);
    EXPECT_TRUE(is_flip(estimate, truth));
    std::swap(*estimate.alternative, estimate.camera_from_marker);
    EXPECT_FALSE(is_flip(estimate, truth));
}

// Of 1, -2, 4, 5: mean 2, squares about it 1 + 16 + 4 + 9 = 30 over 3.
TEST(PoseStatistics, AreThoseOfASmallSetByHand) {
    const DetectorErrors errors{in_x(1.0), in_x(-2.0), std::nullopt, in_x(4.0), in_x(5.0)};
    const PoseStatistics statistics = pose_statistics(errors, 1);
    ASSERT_TRUE(statistics.all && statistics.detected && statistics.flips);
    EXPECT_EQ(statistics.poses, 5u);
    EXPECT_EQ(statistics.detected->count, 4u);
    EXPECT_EQ(statistics.detected->trials, 5u);
    EXPECT_EQ(statistics.flips->count, 0u);
    const ErrorStatistics& x = (*statistics.all)[0];
    EXPECT_DOUBLE_EQ(x.mean.value, 2.0);
    ASSERT_TRUE(x.standard_deviation);
    EXPECT_DOUBLE_EQ(x.standard_deviation->value, std::sqrt(10.0));
    EXPECT_DOUBLE_EQ(x.mean_absolute.value, 3.0);
    EXPECT_DOUBLE_EQ(x.median.value, 2.5);
    EXPECT_DOUBLE_EQ(x.median_absolute.value, 3.0);
    EXPECT_FALSE(x.mean.interval || x.median.interval || x.standard_deviation->interval);
    EXPECT_DOUBLE_EQ((*statistics.all)[6].mean.value, 3.0);
    EXPECT_DOUBLE_EQ((*statistics.all)[1].standard_deviation->value, 0.0);
}

TEST(PoseStatistics, StandWithoutFlipsBesideThoseWithThem) {
    const DetectorErrors errors{in_x(1.0), in_x(90.0, true), in_x(4.0)};
    const PoseStatistics statistics = pose_statistics(errors, 1);
    ASSERT_TRUE(statistics.all && statistics.without_flips);
    EXPECT_EQ(statistics.flips->count, 1u);
    EXPECT_EQ(statistics.flips->trials, 3u);
    EXPECT_NEAR((*statistics.all)[0].mean.value, 95.0 / 3.0, 1e-12);
    EXPECT_DOUBLE_EQ((*statistics.all)[0].median.value, 4.0);
    EXPECT_DOUBLE_EQ((*statistics.without_flips)[0].mean.value, 2.5);
}

TEST(PoseStatistics, SayNothingWhereThereIsNothing) {
    const PoseStatistics none = pose_statistics({}, 1);
    EXPECT_FALSE(none.detected || none.flips || none.all || none.without_flips);

    const PoseStatistics missed = pose_statistics({std::nullopt, std::nullopt}, 1);
    ASSERT_TRUE(missed.detected);
    EXPECT_EQ(missed.detected->value, 0.0);
    EXPECT_FALSE(missed.flips || missed.all || missed.without_flips);

    const PoseStatistics one = pose_statistics({in_x(-7.0)}, 1);
    ASSERT_TRUE(one.all);
    EXPECT_EQ((*one.all)[0].mean.value, -7.0);
    EXPECT_EQ((*one.all)[0].median_absolute.value, 7.0);
    EXPECT_FALSE((*one.all)[0].standard_deviation || (*one.all)[0].mean.interval);

    const PoseStatistics flipped = pose_statistics({in_x(-7.0, true)}, 1);
    EXPECT_TRUE(flipped.all);
    EXPECT_FALSE(flipped.without_flips);
}

TEST(PoseStatistics, OfTheCommonSubsetUseOnlyPosesThatAllDetect) {
    const DetectorErrors first{in_x(1.0), in_x(3.0), std::nullopt, in_x(7.0)};
    const DetectorErrors second{in_x(0.1), std::nullopt, in_x(0.2), in_x(0.3)};
    const std::vector<DetectorErrors> both{first, second};
    const std::vector<bool> mask = commonly_detected(both);
    EXPECT_EQ(mask, (std::vector<bool>{true, false, false, true}));
    const PoseStatistics statistics = pose_statistics(first, 1, mask);
    EXPECT_EQ(statistics.poses, 2u);
    EXPECT_EQ(statistics.detected->value, 1.0);
    EXPECT_DOUBLE_EQ((*statistics.all)[0].mean.value, 4.0);
    EXPECT_THROW(pose_statistics(first, 1, {true}), NumericalError);
    const std::vector<DetectorErrors> unequal{first, {}};
    EXPECT_THROW(commonly_detected(unequal), NumericalError);
}

// Means and deviations by the central limit theorem, over more poses than there are groups.
TEST(PoseStatistics, IntervalsHaveTheWidthOfLargeSamples) {
    DetectorErrors errors;
    RandomStream random(3, 1);
    constexpr int count = 20000;
    for (int i = 0; i < count; ++i)
        errors.push_back(in_x(1.5 + 2.0 * random.normal()));
    const PoseStatistics statistics = pose_statistics(errors, 1);
    const ErrorStatistics& x = (*statistics.all)[0];
    const double error = 2.0 / std::sqrt(count), pi = std::numbers::pi;
    const auto width = [](const Estimate& estimate) {
        return estimate.interval->high - estimate.interval->low;
    };
    // 500 groups and 999 draws scatter the width by 3.2 % and 3.4 %: 4 standard deviations of both.
    EXPECT_NEAR(width(x.mean) / (3.92 * error), 1.0, 0.19);
    EXPECT_NEAR(width(*x.standard_deviation) / (3.92 * error / std::sqrt(2.0)), 1.0, 0.19);
    // The spacing of order statistics scatters by some n^-1/4 = 8 %: 3 of it.
    EXPECT_NEAR(width(x.median) / (3.92 * error * std::sqrt(pi / 2.0)), 1.0, 0.25);
    EXPECT_LT(x.mean.interval->low, x.mean.value);
    EXPECT_GT(x.mean.interval->high, x.mean.value);
}

TEST(PoseStatistics, AreTheSameForTheSameSeed) {
    DetectorErrors errors;
    RandomStream random(3, 2);
    for (int i = 0; i < 700; ++i)
        errors.push_back(in_x(random.normal()));
    const auto low = [&](std::uint64_t seed) {
        return (*pose_statistics(errors, seed).all)[0].mean.interval->low;
    };
    EXPECT_EQ(low(7), low(7));
    EXPECT_NE(low(7), low(5));
}

// Sums of binomial coefficients: P(fewer than 2 of 10) = 11/1024, P(fewer than 3) = 56/1024; the
// others as printed in tables of the sign test (Conover, Practical Nonparametric Statistics, A3).
TEST(MedianInterval, HasTheRanksOfTheSignTest) {
    EXPECT_FALSE(median_interval_rank(0) || median_interval_rank(5));
    const struct {
        std::size_t n, rank;
    } published[] = {{6, 1}, {8, 1}, {9, 2}, {10, 2}, {12, 3}, {20, 6}, {30, 10}, {100, 40}};
    for (const auto& each : published)
        EXPECT_EQ(median_interval_rank(each.n), each.rank) << each.n;
    // 50 000 - 1.96 / 2 sqrt(100 000), by the normal approximation with its half.
    EXPECT_NEAR(static_cast<double>(*median_interval_rank(100000)), 49690.6, 1.0);
}

TEST(MedianInterval, LiesBetweenOrderStatistics) {
    DetectorErrors errors;
    for (int i = 10; i >= 1; --i)
        errors.push_back(in_x(i * i));
    const Estimate median = (*pose_statistics(errors, 1).all)[0].median;
    EXPECT_DOUBLE_EQ(median.value, 30.5);
    ASSERT_TRUE(median.interval);
    EXPECT_DOUBLE_EQ(median.interval->low, 4.0);    // the second
    EXPECT_DOUBLE_EQ(median.interval->high, 81.0);  // the ninth
}

TEST(BinnedStatistics, HaveABinForEachLevelOfADisturbance) {
    const DetectorErrors errors{in_x(1.0), in_x(4.0), std::nullopt, in_x(-3.0), std::nullopt};
    const std::vector<double> level{0.5, 0.5, 0.5, 2.0, 8.0};
    const std::vector<AxisBin> bins = binned_statistics(errors, level);
    ASSERT_EQ(bins.size(), 3u);
    EXPECT_EQ(bins[0].place, 0.5);
    EXPECT_EQ(bins[1].low, 1.25);
    EXPECT_EQ(bins[1].high, 5.0);
    EXPECT_EQ(bins[0].poses, 3u);
    EXPECT_EQ(bins[0].detected->count, 2u);
    const Proportion share = wilson_share(2, 3);
    EXPECT_EQ(bins[0].detected->low, share.low);
    ASSERT_TRUE(bins[0].errors && bins[1].errors);
    EXPECT_DOUBLE_EQ((*bins[0].errors)[0].mean, 2.5);
    EXPECT_DOUBLE_EQ(*(*bins[0].errors)[0].standard_deviation, std::sqrt(4.5));
    EXPECT_FALSE((*bins[1].errors)[0].standard_deviation);
    EXPECT_DOUBLE_EQ((*bins[1].errors)[0].median_absolute.value, 3.0);
    EXPECT_FALSE(bins[2].errors);
    EXPECT_EQ(bins[2].detected->value, 0.0);
}

TEST(BinnedStatistics, HaveEqualWidthsOnAContinuousAxisAndEmptyBinsSayNothing) {
    const std::vector<double> axis{0.0, 10.0, 11.0, 40.0, 30.0};
    const DetectorErrors errors(5, in_x(1.0));
    const std::vector<AxisBin> bins = binned_statistics(errors, axis, 4);
    ASSERT_EQ(bins.size(), 4u);
    const std::size_t counts[] = {1, 2, 0, 2};  // 10 and 30 are edges, and 40 is the end
    for (std::size_t i = 0; i < 4; ++i)
        EXPECT_EQ(bins[i].poses, counts[i]) << i;
    EXPECT_DOUBLE_EQ(bins[1].place, 10.5);
    EXPECT_DOUBLE_EQ(bins[2].place, 25.0);
    EXPECT_FALSE(bins[2].detected || bins[2].errors);
    EXPECT_TRUE(binned_statistics({}, {}).empty());
    EXPECT_THROW(binned_statistics(errors, {}), NumericalError);
}

TEST(RunningMoments, AreExactFarFromZero) {
    RunningMoments moments;
    EXPECT_FALSE(moments.mean() || moments.standard_deviation());
    moments.add(1e9 + 1.0);
    EXPECT_FALSE(moments.standard_deviation());
    moments.add(1e9 + 3.0);
    moments.add(1e9 + 8.0);
    EXPECT_DOUBLE_EQ(*moments.mean(), 1e9 + 4.0);
    EXPECT_NEAR(*moments.standard_deviation(), std::sqrt(13.0), 1e-6);
}

// ---- pose intervals

// What is true of a distribution of errors.
struct Moments {
    double mean, deviation, mean_absolute, median, median_absolute;
};

double upper_normal(double x) {
    return 0.5 * std::erfc(x / std::numbers::sqrt2);
}

// By bisection of P(|e| < m) = 1/2 for a normal error.
double folded_median(double mean, double deviation) {
    double low = 0.0, high = 10.0 * deviation;
    for (int i = 0; i < 60; ++i) {
        const double m = 0.5 * (low + high);
        const double inside =
            upper_normal((-m - mean) / deviation) - upper_normal((m - mean) / deviation);
        (inside < 0.5 ? low : high) = m;
    }
    return low;
}

// Normal, mean 1.5, deviation 2; exponential, mean 1; uniform from -1 to 3.
std::array<Moments, 3> truths() {
    const double mean = 1.5, s = 2.0, ratio = mean / s;
    const double folded = s * std::sqrt(2.0 / std::numbers::pi) * std::exp(-0.5 * ratio * ratio) +
                          mean * (1.0 - 2.0 * upper_normal(ratio));
    return {{{mean, s, folded, mean, folded_median(mean, s)},
             {1.0, 1.0, 1.0, std::numbers::ln2, std::numbers::ln2},
             {1.0, 4.0 / std::sqrt(12.0), 1.25, 1.0, 1.0}}};
}

DetectorErrors drawn(int poses, std::uint32_t repetition) {
    RandomStream random(17, 5, repetition);
    DetectorErrors errors(static_cast<std::size_t>(poses));
    for (auto& each : errors) {
        each.emplace();
        each->measures[0] = 1.5 + 2.0 * random.normal();
        each->measures[1] = -std::log(random.uniform());
        each->measures[2] = -1.0 + 4.0 * random.uniform();
    }
    return errors;
}

bool covers(const Estimate& estimate, double truth) {
    return estimate.interval->low <= truth && truth <= estimate.interval->high;
}

using Counts = std::array<std::array<int, 5>, 3>;  // by distribution and statistic

Counts covering(int poses, int repetitions) {
    const std::array<Moments, 3> truth = truths();
    Counts counts{};
    for (int i = 0; i < repetitions; ++i) {
        const auto index = static_cast<std::uint32_t>(i);
        const PoseStatistics statistics = pose_statistics(drawn(poses, index), index);
        for (std::size_t k = 0; k < truth.size(); ++k) {
            const ErrorStatistics& one = (*statistics.all)[k];
            counts[k][0] += covers(one.mean, truth[k].mean);
            counts[k][1] += covers(*one.standard_deviation, truth[k].deviation);
            counts[k][2] += covers(one.mean_absolute, truth[k].mean_absolute);
            counts[k][3] += covers(one.median, truth[k].median);
            counts[k][4] += covers(one.median_absolute, truth[k].median_absolute);
        }
    }
    return counts;
}

// 95 % of 400 repetitions scatter by sqrt(0.95 0.05 / 400) = 1.09 %. Thirty shares together
// exceed 3.6 standard deviations (0.01 / 30, two-sided), 3.9 %, in one of 100 seeds. A percentile
// interval of a deviation falls short of its level by some (kurtosis - 1) / n terms: 1 % more is
// allowed. Intervals of medians hold their level or more.
// Of 400 poses every one is a group of its own, 2600 are drawn in groups.
TEST(PoseIntervals, CoverTheTruthInNineteenOfTwentyStudies) {
    constexpr int repetitions = 400;
    for (const int poses : {400, 2600})
        for (const auto& counts : covering(poses, repetitions))
            for (const int count : counts)
                EXPECT_NEAR(1.0 * count / repetitions, 0.95, 0.039 + 0.01) << poses;
}

}  // namespace
}  // namespace etalon
