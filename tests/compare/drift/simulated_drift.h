// Corners of a static target as a camera that drifts would see them, without any image.
#pragma once

#include <cmath>

#include "compare/drift/drift_monitor.h"
#include "core/statistics/random.h"

namespace etalon::test {

inline constexpr double width = 640, height = 480;

// columns x rows points, `step` px apart, the first at (x, y).
inline TargetPoints grid_of_points(int columns, int rows, double x, double y, double step) {
    TargetPoints points;
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column)
            points[row * columns + column] = {x + step * column, y + step * row};
    return points;
}

struct SimulatedDrift {
    TargetPoints target = grid_of_points(9, 6, 150, 100, 40);
    // Where a point at `pixel` is after so many minutes.
    std::function<Eigen::Vector2d(const Eigen::Vector2d& pixel, double minutes)> moved =
        [](const Eigen::Vector2d& pixel, double) { return pixel; };
    double noise_px = 0.05;  // of each coordinate of each point, from frame to frame
    // Of the whole image in x and in y, exponentially correlated in time.
    double shake_px = 0.0, shake_time_s = 30.0;
    double interval_s = 1.0, minutes = 60.0;

    // Until stable or over.
    DriftMonitor watch(std::uint64_t seed) const {
        DriftMonitor monitor(drift_plan({static_cast<int>(width), static_cast<int>(height)},
                                        Minutes(interval_s / 60.0), Minutes(minutes)));
        RandomStream random(seed, 5);
        const double memory = std::exp(-interval_s / shake_time_s);
        Eigen::Vector2d shake = Eigen::Vector2d::Zero();
        const auto normals = [&] { return Eigen::Vector2d{random.normal(), random.normal()}; };
        for (int frame = 0; frame * interval_s <= 60.0 * minutes && !monitor.stable(); ++frame) {
            const double time = frame * interval_s / 60.0;
            shake = memory * shake + std::sqrt(1.0 - memory * memory) * shake_px * normals();
            TargetPoints points;
            for (const auto& [id, pixel] : target)
                points[id] = moved(pixel, time) + shake + noise_px * normals();
            monitor.add(Minutes(time), points);
        }
        return monitor;
    }
};

inline auto shift_at(double px_per_min) {
    const Eigen::Vector2d direction(0.6, 0.8);
    return [=](const Eigen::Vector2d& pixel, double minutes) -> Eigen::Vector2d {
        return pixel + px_per_min * minutes * direction;
    };
}

// About the middle of the image, so that its corners move by so much.
inline auto growth_at(double px_per_min_at_corner) {
    const Eigen::Vector2d middle(0.5 * (width - 1), 0.5 * (height - 1));
    const double per_px = px_per_min_at_corner / (0.5 * std::hypot(width, height));
    return [=](const Eigen::Vector2d& pixel, double minutes) -> Eigen::Vector2d {
        return pixel + per_px * minutes * (pixel - middle);
    };
}

}  // namespace etalon::test
