// A smooth map of one component of a pose error over distance, image position and tilt, with
// bootstrap intervals.
//
// Least squares of 1, z, z^2, r, r^2, tilt^2, z r, z tilt^2 (z, r and tilt from -1 or 0 to 1 over
// the poses). The poses are drawn again with replacement for the intervals (Efron and Tibshirani,
// An Introduction to the Bootstrap, 1993, chapter 13: percentiles): no assumption about how errors
// scatter about the map, which for corner detectors is anything but normal.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace etalon {

struct MarkerPlace {
    double depth_mm = 0.0;   // of the marker's origin; of a wide lens its distance
    double radius_px = 0.0;  // of its image from the principal point
    double tilt_rad = 0.0;   // between its normal and the line of sight
};

struct MapValue {
    double value = 0.0, low = 0.0, high = 0.0;  // 95 %
};

class ExpectationMap {
public:
    static constexpr int min_poses = 20;
    enum class Variable { depth, radius, tilt };

    // One value per place. Throws NumericalError for fewer than min_poses, or values that are not
    // finite. Some milliseconds for 200 poses.
    ExpectationMap(std::span<const MarkerPlace> places, std::span<const double> values,
                   std::uint64_t seed);

    MapValue at(const MarkerPlace& place) const;
    // Averaged over the poses, with this variable at `x` (mm, px or rad) in all of them.
    MapValue average_at(Variable variable, double x) const;
    // The average over the poses, and the root mean square of what the map leaves of their values.
    MapValue mean() const;
    double scatter() const { return scatter_; }
    // The pose at which the map is farthest from zero.
    std::size_t worst() const { return worst_; }

private:
    static constexpr int terms = 8;
    using Row = Eigen::Matrix<double, 1, terms>;

    Row row(const MarkerPlace& place) const;
    MapValue value_of(const Row& row) const;

    std::vector<MarkerPlace> places_;
    double middle_mm_, half_mm_, largest_px_, largest_rad_;
    Eigen::Matrix<double, terms, 1> coefficients_;
    Eigen::Matrix<double, terms, Eigen::Dynamic> drawn_;  // coefficients of the bootstrap
    double scatter_ = 0.0;
    std::size_t worst_ = 0;
};

}  // namespace etalon
