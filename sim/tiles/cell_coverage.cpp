#include "sim/tiles/cell_coverage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sim/tiles/cell_sum.h"

namespace etalon {
namespace {

// A convex outline; two cuts add at most two corners to a square's four.
struct Outline {
    std::array<Eigen::Vector2d, 6> corners;
    int count = 0;

    void add(const Eigen::Vector2d& corner) { corners[static_cast<std::size_t>(count++)] = corner; }
    const Eigen::Vector2d& at(int i) const { return corners[static_cast<std::size_t>(i % count)]; }
};

Outline clipped(const Outline& outline, const SquareCut& cut) {
    Outline kept;
    for (int i = 0; i < outline.count; ++i) {
        const Eigen::Vector2d &from = outline.at(i), &to = outline.at(i + 1);
        const double f = cut.offset + cut.gradient.dot(from);
        const double g = cut.offset + cut.gradient.dot(to);
        if (f >= 0.0)
            kept.add(from);
        // A convex outline changes sign at most twice; rounding must not add a third crossing.
        if ((f >= 0.0) != (g >= 0.0) && kept.count < 6)
            kept.add(from + f / (f - g) * (to - from));
    }
    return kept;
}

double area(const Outline& outline) {
    double twice = 0.0;
    for (int i = 0; i < outline.count; ++i) {
        const Eigen::Vector2d &p = outline.at(i), &q = outline.at(i + 1);
        twice += p.x() * q.y() - p.y() * q.x();
    }
    return twice / 2.0;
}

// Of the part that holds the square's centre: at least one half.
double major_area(double steep, double flat, double distance) {
    if (distance >= (steep + flat) / 2.0)
        return 1.0;
    if (distance <= (steep - flat) / 2.0)  // cuts two opposite sides: a trapezium
        return 0.5 + distance / steep;
    const double leg = (steep + flat) / 2.0 - distance;  // cuts off a corner
    return 1.0 - leg * leg / (2.0 * steep * flat);
}

}  // namespace

SquareCut square_cut(const Eigen::Vector2d& gradient, double offset) {
    const double gx = std::abs(gradient.x()), gy = std::abs(gradient.y());
    const double major = major_area(std::max(gx, gy), std::min(gx, gy), std::abs(offset));
    return {gradient, offset, offset >= 0.0 ? major : 1.0 - major};
}

// major_area() solved for the distance, for the part without the square's centre.
double offset_of_area(const Eigen::Vector2d& gradient, double area) {
    const double gx = std::abs(gradient.x()), gy = std::abs(gradient.y());
    const double steep = std::max(gx, gy), flat = std::min(gx, gy);
    const double minor = std::min(area, 1.0 - area);
    const double distance = 2.0 * steep * minor >= flat
                                ? (0.5 - minor) * steep
                                : (steep + flat) / 2.0 - std::sqrt(2.0 * steep * flat * minor);
    return area >= 0.5 ? distance : -distance;
}

double square_wedge_area(const SquareCut& a, const SquareCut& b) {
    Outline square;
    for (const auto& [x, y] : {std::pair{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}})
        square.add({x, y});
    const Outline once = clipped(square, a);
    if (once.count < 3)
        return 0.0;
    const Outline both = clipped(once, b);
    if (both.count < 3)
        return 0.0;
    const double least = std::max(0.0, a.area + b.area - 1.0);
    return std::clamp(area(both), least, std::max(least, std::min(a.area, b.area)));
}

namespace {

struct RingRule {
    int rings;
    std::array<double, 4> area, weight;  // enclosed share of the disk's area; share of the weight
};

// Gauss-Legendre on [0, 1] (Abramowitz and Stegun, table 25.4).
constexpr std::array<RingRule, 4> ring_rules{{
    {1, {0.5}, {1.0}},
    {2, {0.2113248654051871, 0.7886751345948129}, {0.5, 0.5}},
    {3,
     {0.1127016653792583, 0.5, 0.8872983346207417},
     {0.2777777777777778, 0.4444444444444444, 0.2777777777777778}},
    {4,
     {0.0694318442029737, 0.3300094782075719, 0.6699905217924281, 0.9305681557970263},
     {0.1739274225687269, 0.3260725774312731, 0.3260725774312731, 0.1739274225687269}},
}};

}  // namespace

std::vector<LensPoint> lens_points(double radius_mm, int rings, int spokes) {
    if (spokes == 0)
        return {{Eigen::Vector2d::Zero(), 1.0}};
    const RingRule& rule = ring_rules[static_cast<std::size_t>(rings - 1)];
    std::vector<LensPoint> points;
    for (int ring = 0; ring < rings; ++ring) {
        const auto r = static_cast<std::size_t>(ring);
        const double radius = radius_mm * std::sqrt(rule.area[r]);
        for (int spoke = 0; spoke < spokes; ++spoke) {
            const double turn = spoke + 0.25 + 0.5 * (ring % 2);
            const double angle = 2.0 * std::numbers::pi * turn / spokes;
            points.push_back(
                {{radius * std::cos(angle), radius * std::sin(angle)}, rule.weight[r] / spokes});
        }
    }
    return points;
}

// Returns the index of the cell before the first line that crosses the box.
int CellCoverage::cut_box(int axis, int first, int last, const Eigen::Vector2d& x,
                          const SensorPoint& point, const Eigen::Matrix2d& sides,
                          const Eigen::Vector2d& l, std::vector<SquareCut>& cuts) const {
    cuts.clear();
    int base = first;
    for (int i = first + 1; i <= last; ++i) {
        const LensLine line = view_.lens_line(axis, i, point);
        const double offset = line.offset + line.slope.dot(l);
        const Eigen::Vector2d gradient = sides.transpose() * view_.line_gradient(axis, i, x, l);
        const double reach = 0.5 * gradient.cwiseAbs().sum();
        if (offset >= reach) {
            base = i;
            cuts.clear();
        } else if (offset <= -reach) {
            break;
        } else {
            cuts.push_back(square_cut(gradient, offset));
        }
    }
    return base;
}

double CellCoverage::over(const Eigen::Vector2d& x, const Eigen::Matrix2d& sides,
                          const CellRange& range) {
    if (range.is_single())
        return view_.cell(range.first_column, range.first_row);
    const SensorPoint point = view_.sensor_point(x);
    double sum = 0.0;
    for (const LensPoint& p : points_) {
        const int column = cut_box(0, range.first_column, range.last_column, x, point, sides,
                                   p.l_mm, column_cuts_);
        const int row =
            cut_box(1, range.first_row, range.last_row, x, point, sides, p.l_mm, row_cuts_);
        sum +=
            p.weight * sum_of_cells(view_, column, row, column_cuts_, row_cuts_, square_wedge_area);
    }
    return sum;
}

}  // namespace etalon
