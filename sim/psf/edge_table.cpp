#include "sim/psf/edge_table.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <numbers>

namespace etalon {
namespace {

using std::numbers::pi;

constexpr int fine_per_px = 32;
constexpr double fine_step = 1.0 / fine_per_px;

// The weight of a place t from another in the cubic through four.
double lagrange4(double t) {
    t = std::abs(t);
    return t < 1.0 ? (1.0 - t * t) * (2.0 - t) / 2.0 : (1.0 - t) * (2.0 - t) * (3.0 - t) / 6.0;
}

// The part of the unit disk at more than t from its centre on one side.
double segment_beyond(double t) {
    if (t <= -1.0 || t >= 1.0)
        return t <= -1.0 ? 1.0 : 0.0;
    const double half_length = std::sqrt((1.0 - t) * (1.0 + t));
    return (std::atan2(half_length, t) - t * half_length) / pi;
}

// The light of a round pattern in strips of a step, from its middle on.
std::vector<double> line_spread(const std::function<double(double)>& density, double reach_px) {
    std::vector<double> strips;
    for (double x = 0.0; x < reach_px; x += fine_step) {
        double sum = 0.0;
        for (double y = 0.5 * fine_step; y < reach_px; y += fine_step)
            if (const double r = std::hypot(x, y); r < reach_px)
                sum += 2.0 * density(r) * fine_step * fine_step;
        strips.push_back(sum);
    }
    return strips;
}

// A pixel's own line spread: a box, or a triangle as high as its diagonal is long.
double pixel_strip(double x, bool is_diagonal) {
    const double far = std::abs(x);
    if (!is_diagonal)
        return far < 0.5 - 1e-9 ? fine_step : far < 0.5 + 1e-9 ? 0.5 * fine_step : 0.0;
    const double half = std::numbers::sqrt2 / 2.0;
    return std::max(0.0, half - far) / (half * half) * fine_step;
}

std::vector<double> with_pixel(const std::vector<double>& strips, bool is_diagonal, double energy) {
    const int n = static_cast<int>(strips.size()), pixel = fine_per_px;
    std::vector<double> result(strips.size() + static_cast<std::size_t>(pixel));
    for (int i = -n + 1; i < n; ++i)
        for (int p = -pixel; p <= pixel; ++p)
            if (const int at = i + p; at >= 0 && at < n + pixel)
                result[static_cast<std::size_t>(at)] +=
                    strips[static_cast<std::size_t>(std::abs(i))] *
                    pixel_strip(p * fine_step, is_diagonal);
    double sum = -result[0];
    for (const double strip : result)
        sum += 2.0 * strip;
    for (double& strip : result)
        strip *= energy / sum;
    return result;
}

double second_moment(const std::vector<double>& strips, double energy) {
    double sum = 0.0;
    for (std::size_t i = 0; i < strips.size(); ++i)
        sum += 2.0 * strips[i] * std::pow(static_cast<double>(i) * fine_step, 2.0);
    return sum / energy;
}

// The part of a blur disk beyond edges at blur_px + m steps from its centre, for m from `first` on.
std::vector<double> segments(double blur_px, int first, int count) {
    std::vector<double> parts;
    for (int m = first; m < first + count; ++m)
        parts.push_back(segment_beyond((blur_px + m * fine_step) / blur_px));
    return parts;
}

// The sum over the strips on both sides of their middle, which lies at one of the segments.
double response(const std::vector<double>& strips, const double* segment) {
    double sum = strips[0] * segment[0];
    for (std::ptrdiff_t i = 1; i < std::ssize(strips); ++i)
        sum += strips[static_cast<std::size_t>(i)] * (segment[-i] + segment[i]);
    return sum;
}

}  // namespace

EdgeTable::EdgeTable(const std::function<double(double)>& density, double reach_px, double energy)
    : energy_(energy), reach_px_(reach_px + std::numbers::sqrt2 / 2.0) {
    const std::vector<double> strips = line_spread(density, reach_px);
    straight_ = with_pixel(strips, false, energy);
    diagonal_ = with_pixel(strips, true, energy);
    variance_ = second_moment(straight_, energy);
}

double EdgeTable::radius_of(int row) {
    return least_blur_px * std::pow(ratio, row + first_row);
}

// A profile needs rows of up to twice a ratio less than its own blur, as far as its own middle.
void EdgeTable::make(Row& row, double blur_px) const {
    row.before = static_cast<int>(std::ceil((ratio * ratio * 1.01 * blur_px + 1.0) * per_px));
    const int behind = static_cast<int>(std::ceil(reach_px_ * per_px)) + 3;
    const int step = fine_per_px / static_cast<int>(per_px);
    const int reach = static_cast<int>(straight_.size());
    const std::vector<double> parts =
        segments(blur_px, -step * row.before - reach, step * (row.before + behind) + 2 * reach);
    for (int n = 0; n < row.before + behind; ++n) {
        const double* middle = &parts[static_cast<std::size_t>(step * n + reach)];
        const double along = response(straight_, middle);
        row.straight.push_back(static_cast<float>(along));
        row.diagonal.push_back(static_cast<float>(response(diagonal_, middle) - along));
    }
}

const EdgeTable::Row& EdgeTable::row(int index) const {
    Row& row = rows_[static_cast<std::size_t>(index)];
    std::call_once(row.made, [&] { make(row, radius_of(index)); });
    return row;
}

void EdgeTable::profile(double blur_px, double diagonal, EdgeProfile& profile) const {
    const double place = std::log(blur_px / least_blur_px) / std::log(ratio) - first_row;
    const int below = std::clamp(static_cast<int>(place), 1, row_count - 3);
    const int before = static_cast<int>(std::ceil(blur_px * per_px)) + 1;
    profile.shift = static_cast<float>(before - blur_px * per_px);
    std::array<const float*, 4> straight, slanted;
    std::array<float, 4> weights;
    std::size_t count = 0;
    for (int n = 0; n < 4; ++n) {
        const Row& near = row(below - 1 + n);
        const auto i = static_cast<std::size_t>(n);
        straight[i] = &near.straight[static_cast<std::size_t>(near.before - before)];
        slanted[i] = &near.diagonal[static_cast<std::size_t>(near.before - before)];
        count = near.straight.size() - static_cast<std::size_t>(near.before - before);
        weights[i] = static_cast<float>(lagrange4(place - (below - 1 + n)));
    }
    profile.values.resize(count);
    const auto part = static_cast<float>(diagonal);
    for (std::size_t n = 0; n < count; ++n)
        profile.values[n] = (weights[0] * (straight[0][n] + part * slanted[0][n]) +
                             weights[1] * (straight[1][n] + part * slanted[1][n])) +
                            (weights[2] * (straight[2][n] + part * slanted[2][n]) +
                             weights[3] * (straight[3][n] + part * slanted[3][n]));
    profile.values[count - 1] = profile.values[count - 2] = 0.0f;
}

double EdgeTable::gray_of_bend(double blur_px) const {
    // The steepest change of the profile's slope, at the rim: that of the disk over a distance of
    // the filter's deviation; and the slope itself, for what bends within 8 px.
    const double deviation = std::sqrt(variance_), t = 1.0 - deviation / blur_px;
    const double bend = 2.0 / pi * t / (blur_px * blur_px * std::sqrt(1.0 - t * t));
    return 255.0 * variance_ * (bend + 2.0 / (pi * blur_px) / 8.0);
}

}  // namespace etalon
