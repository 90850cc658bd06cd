#include "compare/expect/pose_statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/geometry/units.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

double angle_between(const Eigen::Quaterniond& one, const Eigen::Quaterniond& two) {
    return rotation_vector(one.conjugate() * two).norm();
}

std::vector<double> column(std::span<const ErrorRow> rows, std::size_t measure) {
    std::vector<double> values;
    values.reserve(rows.size());
    for (const ErrorRow& row : rows)
        values.push_back(row[measure]);
    return values;
}

constexpr std::size_t max_groups = 500;
constexpr std::size_t bootstrap_draws = 999;  // 2.5 % of bootstrap_draws + 1 is the whole number 25
constexpr std::uint32_t shuffle_stream = 410, draw_stream = 411;

using MeasureArray = Eigen::Array<double, error_measure_count, 1>;

MeasureArray array_of(const ErrorRow& row) {
    return Eigen::Map<const MeasureArray>(row.data());
}

// Sums over a group of rows; squares are of distances from the mean of all rows, so that no digits
// cancel.
struct Sums {
    double count = 0.0;
    MeasureArray error = MeasureArray::Zero(), square = error, absolute = error;

    void add_row(const ErrorRow& row, const MeasureArray& mean) {
        const MeasureArray distance = array_of(row) - mean;
        *this += {1.0, distance, distance.square(), array_of(row).abs()};
    }
    void operator+=(const Sums& other) {
        count += other.count;
        error += other.error;
        square += other.square;
        absolute += other.absolute;
    }
    double mean_distance(std::size_t k) const { return error[k] / count; }
    double deviation(std::size_t k) const {  // needs count > 1
        const double square_of_mean = error[k] * error[k] / count;
        return std::sqrt(std::max(0.0, square[k] - square_of_mean) / (count - 1.0));
    }
    double mean_absolute(std::size_t k) const { return absolute[k] / count; }
};

std::size_t index_below(RandomStream& random, std::size_t bound) {
    return static_cast<std::size_t>((std::uint64_t{random.bits()} * bound) >> 32);
}

// Which group each row belongs to: groups of equal size (but for one) in random order, as
// neighbours in a well-spread sequence of poses are not independent.
std::vector<std::uint32_t> shuffled_groups(std::size_t rows, std::size_t groups,
                                           std::uint64_t seed) {
    std::vector<std::uint32_t> group(rows);
    for (std::size_t i = 0; i < rows; ++i)
        group[i] = static_cast<std::uint32_t>(i % groups);
    RandomStream random(seed, shuffle_stream);
    for (std::size_t i = rows; i > 1; --i)
        std::swap(group[i - 1], group[index_below(random, i)]);
    return group;
}

std::vector<Sums> drawn_sums(std::span<const Sums> groups, std::uint64_t seed) {
    std::vector<Sums> drawn(bootstrap_draws);
    for (std::size_t draw = 0; draw < bootstrap_draws; ++draw) {
        RandomStream random(seed, draw_stream, draw);
        for (std::size_t i = 0; i < groups.size(); ++i)
            drawn[draw] += groups[index_below(random, groups.size())];
    }
    return drawn;
}

// The percentiles of one statistic over the draws.
template <typename Statistic>
std::optional<ConfidenceInterval> percentiles(std::span<const Sums> drawn,
                                              const Statistic& statistic) {
    if (drawn.empty())
        return std::nullopt;
    std::vector<double> values;
    for (const Sums& sums : drawn)
        values.push_back(statistic(sums));
    constexpr std::ptrdiff_t rank = (bootstrap_draws + 1) / 40;  // 2.5 %
    const auto low = values.begin() + rank - 1, high = values.end() - rank;
    std::nth_element(values.begin(), low, values.end());
    std::nth_element(low + 1, high, values.end());
    return ConfidenceInterval{*low, *high};
}

// Everything but the medians. `rows` must not be empty.
MeasureStatistics moment_statistics(std::span<const ErrorRow> rows, std::uint64_t seed) {
    Sums all, total;
    for (const ErrorRow& row : rows)
        all.add_row(row, MeasureArray::Zero());
    const MeasureArray mean = all.error / all.count;
    std::vector<Sums> groups(std::min(rows.size(), max_groups));
    const std::vector<std::uint32_t> group = shuffled_groups(rows.size(), groups.size(), seed);
    for (std::size_t i = 0; i < rows.size(); ++i)
        groups[group[i]].add_row(rows[i], mean);
    for (const Sums& sums : groups)
        total += sums;
    std::vector<Sums> drawn;
    if (rows.size() >= min_bootstrap_values)
        drawn = drawn_sums(groups, seed);
    MeasureStatistics statistics;
    for (std::size_t k = 0; k < error_measure_count; ++k) {
        const auto with_interval = [&](double value, const auto& statistic) {
            return Estimate{value, percentiles(drawn, statistic)};
        };
        statistics[k].mean = with_interval(
            mean[k], [&](const Sums& sums) { return mean[k] + sums.mean_distance(k); });
        if (total.count > 1.0)
            statistics[k].standard_deviation = with_interval(
                total.deviation(k), [k](const Sums& sums) { return sums.deviation(k); });
        statistics[k].mean_absolute = with_interval(
            total.mean_absolute(k), [k](const Sums& sums) { return sums.mean_absolute(k); });
    }
    return statistics;
}

std::optional<MeasureStatistics> measure_statistics(std::span<const ErrorRow> rows,
                                                    std::uint64_t seed) {
    if (rows.empty())
        return std::nullopt;
    MeasureStatistics statistics = moment_statistics(rows, seed);
    for (std::size_t k = 0; k < error_measure_count; ++k) {
        std::vector<double> values = column(rows, k);
        statistics[k].median = median_estimate(values);
        for (double& value : values)
            value = std::abs(value);
        statistics[k].median_absolute = median_estimate(values);
    }
    return statistics;
}

std::vector<double> axis_edges(std::span<const double> axis, std::size_t most_bins) {
    std::vector<double> levels(axis.begin(), axis.end());
    std::sort(levels.begin(), levels.end());
    levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
    if (levels.empty())
        return {};
    const double low = levels.front(), high = levels.back();
    std::vector<double> edges{low};
    if (levels.size() <= most_bins) {
        for (std::size_t i = 1; i < levels.size(); ++i)
            edges.push_back(0.5 * (levels[i - 1] + levels[i]));
    } else {
        for (std::size_t i = 1; i < most_bins; ++i)
            edges.push_back(low +
                            (high - low) * static_cast<double>(i) / static_cast<double>(most_bins));
    }
    edges.push_back(high);
    return edges;
}

std::vector<std::vector<std::size_t>> members(std::span<const double> axis,
                                              std::span<const double> edges) {
    std::vector<std::vector<std::size_t>> bins(edges.empty() ? 0 : edges.size() - 1);
    for (std::size_t i = 0; i < axis.size(); ++i) {
        const auto above = std::upper_bound(edges.begin() + 1, edges.end() - 1, axis[i]);
        bins[static_cast<std::size_t>(above - edges.begin()) - 1].push_back(i);
    }
    return bins;
}

std::array<BinnedError, error_measure_count> binned_errors(std::span<const ErrorRow> rows) {
    std::array<BinnedError, error_measure_count> result;
    for (std::size_t k = 0; k < error_measure_count; ++k) {
        std::vector<double> values = column(rows, k);
        RunningMoments moments;
        for (double& value : values) {
            moments.add(value);
            value = std::abs(value);
        }
        result[k] = {*moments.mean(), moments.standard_deviation(), median_estimate(values)};
    }
    return result;
}

void fill(AxisBin& bin, const DetectorErrors& errors, std::span<const double> axis,
          std::span<const std::size_t> poses) {
    bin.place = 0.5 * (bin.low + bin.high);
    bin.poses = poses.size();
    if (poses.empty())
        return;
    RunningMoments places;
    std::vector<ErrorRow> rows;
    for (const std::size_t i : poses) {
        places.add(axis[i]);
        if (errors[i])
            rows.push_back(errors[i]->measures);
    }
    bin.place = *places.mean();
    bin.detected = wilson_share(rows.size(), poses.size());
    if (!rows.empty())
        bin.errors = binned_errors(rows);
}

}  // namespace

PoseComponents pose_components(const Rigid& camera_from_marker) {
    const Eigen::Vector3d& t = camera_from_marker.translation;
    const Eigen::Vector3d angles = deg_per_rad * roll_pitch_yaw(camera_from_marker.rotation);
    return {t.x(), t.y(), t.z(), angles.x(), angles.y(), angles.z()};
}

DetectedError detected_error(const Rigid& estimated, const Rigid& truth, bool flip) {
    const Eigen::Vector3d shift = estimated.translation - truth.translation;
    const Eigen::Vector3d turn =
        roll_pitch_yaw(estimated.rotation) - roll_pitch_yaw(truth.rotation);
    const double angle = angle_between(truth.rotation, estimated.rotation);
    if (!shift.allFinite() || !turn.allFinite() || !std::isfinite(angle))
        throw NumericalError("pose statistics: an estimated pose is not finite");
    return {{shift.x(), shift.y(), shift.z(), deg_per_rad * wrapped(turn.x()),
             deg_per_rad * wrapped(turn.y()), deg_per_rad * wrapped(turn.z()), shift.norm(),
             deg_per_rad * angle},
            flip};
}

bool is_flip(const PoseEstimate& estimate, const Rigid& truth) {
    return estimate.alternative &&
           angle_between(estimate.alternative->rotation, truth.rotation) <
               angle_between(estimate.camera_from_marker.rotation, truth.rotation);
}

PoseStatistics pose_statistics(const DetectorErrors& errors, std::uint64_t seed,
                               const std::vector<bool>& mask) {
    if (!mask.empty() && mask.size() != errors.size())
        throw NumericalError(
            fmt::format("pose statistics: a mask of {} for {} poses", mask.size(), errors.size()));
    PoseStatistics statistics;
    std::vector<ErrorRow> all, without_flips;
    for (std::size_t i = 0; i < errors.size(); ++i) {
        if (!mask.empty() && !mask[i])
            continue;
        ++statistics.poses;
        if (!errors[i])
            continue;
        all.push_back(errors[i]->measures);
        if (!errors[i]->flip)
            without_flips.push_back(errors[i]->measures);
    }
    if (statistics.poses > 0)
        statistics.detected = wilson_share(all.size(), statistics.poses);
    if (!all.empty())
        statistics.flips = wilson_share(all.size() - without_flips.size(), all.size());
    statistics.all = measure_statistics(all, seed);
    statistics.without_flips = without_flips.size() == all.size()
                                   ? statistics.all
                                   : measure_statistics(without_flips, seed);
    return statistics;
}

std::vector<bool> commonly_detected(std::span<const DetectorErrors> detectors) {
    if (detectors.empty())
        return {};
    std::vector<bool> mask(detectors[0].size(), true);
    for (const DetectorErrors& detector : detectors) {
        if (detector.size() != mask.size())
            throw NumericalError(fmt::format("pose statistics: detectors with {} and {} poses",
                                             mask.size(), detector.size()));
        for (std::size_t i = 0; i < mask.size(); ++i)
            mask[i] = mask[i] && detector[i].has_value();
    }
    return mask;
}

std::vector<AxisBin> binned_statistics(const DetectorErrors& errors, std::span<const double> axis,
                                       std::size_t most_bins) {
    if (axis.size() != errors.size() || most_bins < 1)
        throw NumericalError(
            fmt::format("pose statistics: {} values of an axis for {} poses, {} bins", axis.size(),
                        errors.size(), most_bins));
    if (!std::ranges::all_of(axis, [](double value) { return std::isfinite(value); }))
        throw NumericalError("pose statistics: a value of an axis is not finite");
    const std::vector<double> edges = axis_edges(axis, most_bins);
    const std::vector<std::vector<std::size_t>> poses = members(axis, edges);
    std::vector<AxisBin> bins(poses.size());
    for (std::size_t i = 0; i < bins.size(); ++i) {
        bins[i].low = edges[i];
        bins[i].high = edges[i + 1];
        fill(bins[i], errors, axis, poses[i]);
    }
    return bins;
}

void RunningMoments::add(double value) {
    ++count_;
    const double step = value - mean_;
    mean_ += step / static_cast<double>(count_);
    squares_ += step * (value - mean_);
}

std::optional<double> RunningMoments::mean() const {
    return count_ > 0 ? std::optional(mean_) : std::nullopt;
}

std::optional<double> RunningMoments::standard_deviation() const {
    if (count_ < 2)
        return std::nullopt;
    return std::sqrt(squares_ / static_cast<double>(count_ - 1));
}

Estimate median_estimate(std::span<double> values) {
    const std::size_t n = values.size();
    const auto at = [&](std::size_t i) { return values.begin() + static_cast<std::ptrdiff_t>(i); };
    const auto middle = at(n / 2);
    std::nth_element(values.begin(), middle, values.end());
    Estimate median{*middle, std::nullopt};
    if (n % 2 == 0)
        median.value = 0.5 * (*middle + *std::max_element(values.begin(), middle));
    if (const auto rank = median_interval_rank(n)) {
        const auto low = at(*rank - 1), high = at(n - *rank);
        std::nth_element(values.begin(), low, middle);
        std::nth_element(middle, high, values.end());
        median.interval = {*low, *high};
    }
    return median;
}

// The number of values below the median is binomial with n and 1/2: the largest rank l with
// P(fewer than l) <= 2.5 %.
std::optional<std::size_t> median_interval_rank(std::size_t n) {
    if (n < 6)
        return std::nullopt;
    return coin_quantile(0.025, n) + 1;
}

}  // namespace etalon
