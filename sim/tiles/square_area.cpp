#include "sim/tiles/square_area.h"

#include <algorithm>
#include <array>
#include <cmath>

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

}  // namespace etalon
