#include "compare/expect/expectation_map.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

constexpr int map_draws = 400;

// Least squares; a direction that the poses do not show (all at one depth) stays zero.
Eigen::VectorXd fitted(const Eigen::MatrixXd& rows, const Eigen::VectorXd& values) {
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition;
    decomposition.setThreshold(1e-9);
    decomposition.compute(rows);
    return decomposition.solve(values);
}

}  // namespace

ExpectationMap::ExpectationMap(std::span<const MarkerPlace> places, std::span<const double> values,
                               std::uint64_t seed)
    : places_(places.begin(), places.end()) {
    if (std::ssize(places) < min_poses || places.size() != values.size())
        throw NumericalError(
            fmt::format("expectation map: {} values at {} poses, at least {} needed", values.size(),
                        places.size(), min_poses));
    const auto [near, far] = std::minmax_element(
        places_.begin(), places_.end(),
        [](const MarkerPlace& a, const MarkerPlace& b) { return a.depth_mm < b.depth_mm; });
    middle_mm_ = 0.5 * (near->depth_mm + far->depth_mm);
    half_mm_ = std::max(0.5 * (far->depth_mm - near->depth_mm), 1e-9);
    largest_px_ = largest_rad_ = 1e-9;
    for (const MarkerPlace& place : places_) {
        largest_px_ = std::max(largest_px_, place.radius_px);
        largest_rad_ = std::max(largest_rad_, place.tilt_rad);
    }
    const auto count = std::ssize(places);
    Eigen::MatrixXd rows(count, terms);
    for (Eigen::Index i = 0; i < count; ++i)
        rows.row(i) = row(places_[static_cast<std::size_t>(i)]);
    const Eigen::VectorXd all = Eigen::Map<const Eigen::VectorXd>(values.data(), count);
    if (!rows.allFinite() || !all.allFinite())
        throw NumericalError("expectation map: a value is not finite");
    coefficients_ = fitted(rows, all);
    scatter_ = std::sqrt((all - rows * coefficients_).squaredNorm() / static_cast<double>(count));
    Eigen::Index worst = 0;
    (rows * coefficients_).cwiseAbs().maxCoeff(&worst);
    worst_ = static_cast<std::size_t>(worst);
    drawn_.resize(terms, map_draws);
    for (int draw = 0; draw < map_draws; ++draw) {
        RandomStream random(seed, 300, static_cast<std::uint64_t>(draw));
        Eigen::MatrixXd some_rows(count, terms);
        Eigen::VectorXd some(count);
        for (Eigen::Index i = 0; i < count; ++i) {
            const auto k = static_cast<Eigen::Index>(random.uniform() * static_cast<double>(count));
            some_rows.row(i) = rows.row(k);
            some[i] = all[k];
        }
        drawn_.col(draw) = fitted(some_rows, some);
    }
}

ExpectationMap::Row ExpectationMap::row(const MarkerPlace& place) const {
    const double z = (place.depth_mm - middle_mm_) / half_mm_;
    const double r = place.radius_px / largest_px_;
    const double t = std::pow(place.tilt_rad / largest_rad_, 2);
    return (Row() << 1.0, z, z * z, r, r * r, t, z * r, z * t).finished();
}

MapValue ExpectationMap::value_of(const Row& row) const {
    Eigen::RowVectorXd all = row * drawn_;
    std::sort(all.begin(), all.end());
    return {row.dot(coefficients_), all[map_draws / 40], all[map_draws - 1 - map_draws / 40]};
}

MapValue ExpectationMap::at(const MarkerPlace& place) const {
    return value_of(row(place));
}

MapValue ExpectationMap::average_at(Variable variable, double x) const {
    Row sum = Row::Zero();
    for (MarkerPlace place : places_) {
        if (variable == Variable::depth)
            place.depth_mm = x;
        else if (variable == Variable::radius)
            place.radius_px = x;
        else
            place.tilt_rad = x;
        sum += row(place);
    }
    return value_of(sum / static_cast<double>(places_.size()));
}

MapValue ExpectationMap::mean() const {
    Row sum = Row::Zero();
    for (const MarkerPlace& place : places_)
        sum += row(place);
    return value_of(sum / static_cast<double>(places_.size()));
}

}  // namespace etalon
