// Newton's method for the point of a plane that a smooth map takes to a target: damped, so that
// every step comes nearer, and kept inside a region in which the map is invertible.
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <optional>

namespace etalon {

// `map` gives `point` and `jacobian` of a point, and is_regular(); `contains` says whether a point
// is in the region. Right to 1e-12 of `scale`, asked for to 1e-14; nothing where no such point is
// found.
template <class Map, class Contains>
std::optional<Eigen::Vector2d> damped_newton(const Map& map, const Contains& contains,
                                             const Eigen::Vector2d& target,
                                             const Eigen::Vector2d& start, double scale) {
    constexpr double tolerance = 1e-12;       // asked of the result
    constexpr double stop_tolerance = 1e-14;  // at which no further step is worth its time
    Eigen::Vector2d x = start;
    auto at = map(x);
    double error = (target - at.point).norm();
    for (int i = 0; i < 60 && error > stop_tolerance * scale; ++i) {
        const Eigen::Vector2d step = at.jacobian.inverse() * (target - at.point);
        bool advanced = false;
        for (double part = 1.0; part > 1e-6 && !advanced; part *= 0.5) {
            const Eigen::Vector2d next = x + part * step;
            if (!contains(next))
                continue;
            const auto there = map(next);
            const double next_error = (target - there.point).norm();
            if (!there.is_regular() || !(next_error < error)) {
                if (error <= tolerance * scale)
                    break;  // rounding is all that is left
                continue;
            }
            x = next;
            at = there;
            error = next_error;
            advanced = true;
        }
        if (!advanced)
            break;
    }
    if (!(error <= tolerance * scale) || !contains(x) || !at.is_regular())
        return std::nullopt;
    return x;
}

}  // namespace etalon
