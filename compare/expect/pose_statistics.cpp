#include "compare/expect/pose_statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compare/expect/error_intervals.h"
#include "core/geometry/roll_pitch_yaw.h"
#include "core/geometry/units.h"
#include "core/program/errors.h"

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

// Edges of the bins of an axis, ascending; one more than bins, none without values.
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

// Which poses lie in each bin.
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
            fmt::format("pose statistics: {} values of an axis for {} poses, {} "
                        "bins",
                        axis.size(), errors.size(), most_bins));
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

}  // namespace etalon
