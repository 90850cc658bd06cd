// Statistics of one detector's pose errors over many poses whose truth is known.
//
// Six measures are those of the published comparison of markers (FMAC): X, Y, Z, estimated minus
// true translation in the camera frame, mm; roll, pitch and yaw, differences of the angles of
// core/geometry/rigid.h, deg, in [-180, 180]. Its "accuracy" is the mean of their absolute values.
// The others are the distance between estimated and true origin and the angle between the
// rotations.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "compare/detect/detector.h"
#include "core/statistics/distributions.h"

namespace etalon {

inline constexpr std::size_t pose_component_count = 6, error_measure_count = 8;

struct MeasureName {
    const char* name;
    const char* unit;
};
// In the order of every array below.
inline constexpr std::array<MeasureName, error_measure_count> error_measures{{{"X", "mm"},
                                                                              {"Y", "mm"},
                                                                              {"Z", "mm"},
                                                                              {"roll", "deg"},
                                                                              {"pitch", "deg"},
                                                                              {"yaw", "deg"},
                                                                              {"distance", "mm"},
                                                                              {"angle", "deg"}}};

// x, y, z (mm), roll, pitch, yaw (deg): the degrees of freedom that errors are drawn against.
using PoseComponents = std::array<double, pose_component_count>;
PoseComponents pose_components(const Rigid& camera_from_marker);

using ErrorRow = std::array<double, error_measure_count>;

struct DetectedError {
    ErrorRow measures{};
    bool flip = false;
};
// Entry i belongs to pose i of the study; nothing where the marker was not detected. 80 bytes each.
using DetectorErrors = std::vector<std::optional<DetectedError>>;

// Throws NumericalError when the estimate is not finite.
DetectedError detected_error(const Rigid& estimated, const Rigid& truth, bool flip);

// Whether the other planar solution has the rotation that is nearer to the truth.
bool is_flip(const PoseEstimate& estimate, const Rigid& truth);

struct ConfidenceInterval {
    double low = 0.0, high = 0.0;  // two-sided, 95 %
};
struct Estimate {
    double value = 0.0;
    std::optional<ConfidenceInterval> interval;  // nothing: too few values for one
};

// Of one measure over the detected poses.
//
// Intervals of the mean, the deviation and the mean absolute error are percentiles of a bootstrap
// of 999 draws (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13). Over 500
// poses it draws 500 random groups of poses (Wolter, Introduction to Variance Estimation, 2nd
// edition, chapter 2). Intervals of medians are between two order statistics, exact for any
// distribution (David and Nagaraja, Order Statistics, 3rd edition, section 7.1). All hold for poses
// drawn independently from the same volume; well-spread poses (Halton) make means better.
struct ErrorStatistics {
    Estimate mean;                               // the bias
    std::optional<Estimate> standard_deviation;  // nothing for a single value
    Estimate mean_absolute;                      // the published study's "accuracy"
    Estimate median;                             // of the signed errors
    Estimate median_absolute;
};
using MeasureStatistics = std::array<ErrorStatistics, error_measure_count>;

// Bootstrap intervals need this many values; intervals of medians need 6.
inline constexpr std::size_t min_bootstrap_values = 20;

struct PoseStatistics {
    std::size_t poses = 0;                 // that were asked about
    std::optional<Proportion> detected;    // of the poses; nothing without poses
    std::optional<Proportion> flips;       // of the detected ones; nothing if none was
    std::optional<MeasureStatistics> all;  // nothing if none was detected
    std::optional<MeasureStatistics> without_flips;
};

// Over all poses, or over those of `mask` (empty, or one entry per pose). The same numbers for the
// same `seed`. CPU time: 15 ms and 0.5 us a pose. Throws NumericalError for a mask of another size.
PoseStatistics pose_statistics(const DetectorErrors& errors, std::uint64_t seed,
                               const std::vector<bool>& mask = {});

// The poses that every detector detects. All must have as many entries (NumericalError otherwise).
std::vector<bool> commonly_detected(std::span<const DetectorErrors> detectors);

// Mean and deviation of values as they come (Welford, Technometrics 4, 1962).
class RunningMoments {
public:
    void add(double value);
    std::size_t count() const { return count_; }
    std::optional<double> mean() const;                // nothing of no value
    std::optional<double> standard_deviation() const;  // nothing of fewer than two

private:
    std::size_t count_ = 0;
    double mean_ = 0.0, squares_ = 0.0;
};

struct BinnedError {
    double mean = 0.0;
    std::optional<double> standard_deviation;
    Estimate median_absolute;
};

// The poses of one interval of an axis.
struct AxisBin {
    double low = 0.0, high = 0.0;  // of the axis; a value at an inner edge belongs to the upper bin
    double place = 0.0;            // mean value of its poses; the middle when it has none
    std::size_t poses = 0;
    std::optional<Proportion> detected;
    std::optional<std::array<BinnedError, error_measure_count>> errors;
};

// Statistics against one axis (a degree of freedom, a disturbance, the marker's size in px), one
// value of it per pose. An axis of at most `most_bins` different values has a bin for each, another
// one bins of equal width. 0.4 us a pose. Throws NumericalError when the sizes differ, a value is
// not finite or most_bins is below 1.
std::vector<AxisBin> binned_statistics(const DetectorErrors& errors, std::span<const double> axis,
                                       std::size_t most_bins = 12);

// The ranks (1-based) of the order statistics of n values between which the median lies with at
// least 95 %: this one and n + 1 minus it. Nothing for fewer than 6 values.
std::optional<std::size_t> median_interval_rank(std::size_t n);

// Reorders `values`, which must not be empty.
Estimate median_estimate(std::span<double> values);

}  // namespace etalon
