#include "sim/sampling_bound.h"

#include <cmath>
#include <numbers>

#include "sim/lagrange.h"

namespace etalon {
namespace {

constexpr double full_scale_gray = 255.0;
// Steps of the edge's place and of the spread in a sample's width.
constexpr int steps_per_sample = 8;
// How far the spread is followed; the energy beyond counts as if it smoothed nothing.
constexpr double spread_reach_px = 2.0;

// Part of the blur disk (radius 1) beyond a line at t from its centre, and that part's integral
// from -infinity to t.
double segment(double t) {
    if (std::abs(t) >= 1.0)
        return t > 0.0 ? 1.0 : 0.0;
    const double q = std::sqrt(1.0 - t * t);
    return (std::atan2(q, -t) + t * q) / std::numbers::pi;
}
double segment_integral(double t) {
    if (std::abs(t) >= 1.0)
        return std::max(t, 0.0);
    const double q = std::sqrt(1.0 - t * t);
    return t * segment(t) + 2.0 / (3.0 * std::numbers::pi) * q * q * q;
}

// Largest value of |sum of spread(b) errors(m - b)|; both symmetric about their middle elements.
double largest_smoothed(const std::vector<double>& errors, const std::vector<double>& spread) {
    const auto n = static_cast<int>(errors.size()), reach = static_cast<int>(spread.size()) - 1;
    double largest = 0.0;
    for (int m = -reach; m < n + reach; ++m) {
        double sum = 0.0;
        for (int b = std::max(-reach, m - n + 1); b <= std::min(reach, m); ++b)
            sum += spread[static_cast<std::size_t>(std::abs(b))] *
                   errors[static_cast<std::size_t>(m - b)];
        largest = std::max(largest, std::abs(sum));
    }
    return largest;
}

// Error of the pixel box on the interpolated samples, by the place of the edge.
std::vector<double> point_errors(int k, double blur_radius_px) {
    const double step = 1.0 / (steps_per_sample * k);
    const int reach = static_cast<int>(std::ceil((blur_radius_px + 0.5 + 4.0 / k) / step));
    std::vector<double> weights, places, errors;
    for (int i = -4; i < k + 4; ++i) {
        places.push_back((i + 0.5) / k - 0.5);
        weights.push_back(
            lagrange6_integral(k * (-0.5 - places.back()), k * (0.5 - places.back())) / k);
    }
    for (int m = -reach; m <= reach; ++m) {
        const double edge = m * step;
        double sum = 0.0;
        for (std::size_t i = 0; i < places.size(); ++i)
            sum += weights[i] * segment((places[i] - edge) / blur_radius_px);
        const double exact = blur_radius_px * (segment_integral((0.5 - edge) / blur_radius_px) -
                                               segment_integral((-0.5 - edge) / blur_radius_px));
        errors.push_back(sum - exact);
    }
    return errors;
}

// Error of the interpolant of box averages around a sharp edge at `phase` steps beyond a sample, by
// the distance from the edge in steps; lengths in samples.
constexpr int box_reach = 4 * steps_per_sample;
std::vector<double> box_errors(int phase) {
    const double edge = static_cast<double>(phase) / steps_per_sample;
    std::vector<double> errors;
    for (int d = -box_reach; d <= box_reach; ++d) {
        const double place = edge + static_cast<double>(d) / steps_per_sample;
        double sum = 0.0;
        for (int i = -8; i <= 8; ++i)
            sum += lagrange6(place - i) * std::clamp(i + 0.5 - edge, 0.0, 1.0);
        errors.push_back(sum - std::clamp(place + 0.5 - edge, 0.0, 1.0));
    }
    return errors;
}

}  // namespace

SamplingBound::SamplingBound(const PointSpreadFunction* spread) : spread_(spread) {
    if (spread_ == nullptr)
        return;
    constexpr int bins_per_px = 256;
    const std::vector<double> bins = line_spread(bins_per_px);
    const double beyond = 1.0 - spread_->energy_within(spread_reach_px);
    peak_ = bins_per_px * (bins[0] - beyond);
    // At the corner of the box's profile: the mean distance that the spread moves light to one
    // side, and at most half of what it moves beyond the reach.
    double moved = 0.5 * beyond;
    for (std::size_t b = 1; b < bins.size(); ++b)
        moved += bins[b] * std::min(1.0, static_cast<double>(b) / bins_per_px);
    of_no_spread_ = full_scale_gray * moved;
}

// A ring of radius r, seen along one axis, has the part 1/2 + asin(x / r) / pi of its energy below
// x.
std::vector<double> SamplingBound::line_spread(int bins_per_px) const {
    if (spread_ == nullptr)
        return {1.0};
    constexpr int rings = 300;
    std::vector<double> bins(static_cast<std::size_t>(spread_reach_px * bins_per_px) + 2, 0.0);
    double within = 0.0;
    for (int ring = 0; ring < rings; ++ring) {
        const double r = spread_reach_px * (ring + 0.5) / rings;
        const double next = spread_->energy_within(spread_reach_px * (ring + 1.0) / rings);
        double below = 0.0;  // energy between -x and x, to be shared by the bins of both sides
        for (std::size_t b = 0; b < bins.size(); ++b) {
            const double x = (static_cast<double>(b) + 0.5) / bins_per_px;
            const double up_to = x < r ? 2.0 * std::asin(x / r) / std::numbers::pi : 1.0;
            bins[b] += (next - within) * (up_to - below) * (b == 0 ? 1.0 : 0.5);
            below = up_to;
        }
        within = next;
    }
    bins[0] += 1.0 - within;
    return bins;
}

double SamplingBound::of_points(int k, double blur_radius_px) const {
    // Where the blur is wide, the error comes from the disk's rim alone, where its profile rises
    // with the 3/2th power: 0.0213 measured, and the spread hardly helps.
    if (blur_radius_px >= 1.0)
        return full_scale_gray * 0.0216 * std::pow(k, -2.5) * std::pow(blur_radius_px, -1.5);
    constexpr double bin = 1.05;
    const int index = static_cast<int>(std::floor(std::log(blur_radius_px) / std::log(bin)));
    const std::lock_guard lock(mutex_);
    const auto [entry, is_new] = of_points_.try_emplace({k, index}, 0.0);
    if (is_new)
        entry->second = full_scale_gray * largest_smoothed(point_errors(k, std::pow(bin, index)),
                                                           line_spread(steps_per_sample * k));
    return entry->second;
}

double SamplingBound::of_boxes(int k) const {
    if (spread_ == nullptr)
        return 0.0;  // the mean of k box averages is the pixel's average
    const std::lock_guard lock(mutex_);
    const auto [entry, is_new] = of_boxes_.try_emplace(k, 0.0);
    if (!is_new)
        return entry->second;
    const std::vector<double> spread = line_spread(steps_per_sample * k);
    const int reach = static_cast<int>(spread.size()) - 1;
    double largest = 0.0;
    for (int phase = 0; phase < steps_per_sample; ++phase) {
        const std::vector<double> one = box_errors(phase);
        // The pixel's k boxes lie a sample apart: their mean error, by the distance of the first.
        std::vector<double> pixel(one.size() +
                                  static_cast<std::size_t>(steps_per_sample * (k - 1)));
        for (int m = 0; m < k; ++m)
            for (std::size_t d = 0; d < one.size(); ++d)
                pixel[d + static_cast<std::size_t>(steps_per_sample * m)] += one[d] / k;
        for (int at = -reach; at < static_cast<int>(pixel.size()) + reach; ++at) {
            const bool on_the_grid = (at + box_reach + phase) % steps_per_sample == 0;
            if (!on_the_grid)
                continue;
            double sum = 0.0;
            for (int b = std::max(-reach, at - static_cast<int>(pixel.size()) + 1);
                 b <= std::min(reach, at); ++b)
                sum += spread[static_cast<std::size_t>(std::abs(b))] *
                       pixel[static_cast<std::size_t>(at - b)];
            largest = std::max(largest, std::abs(sum));
        }
    }
    return entry->second = full_scale_gray * largest;
}

}  // namespace etalon
