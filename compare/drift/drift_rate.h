// How fast the image of a static target drifts, from its movement over some minutes, and how well
// that is known. The method, to be repeated by hand, is in docs/cameras.md, "Drift".
//
// A straight line through the medians of equal pieces of time (blocks): medians, so that single bad
// frames do not count; blocks, so that vibration and the detector's noise average out before the
// scatter about the line is taken as the uncertainty. Slower fluctuations make neighbouring blocks
// alike: their correlation widens it (Santer et al., J. Geophys. Res. 105, 7337, 2000).
#pragma once

#include <chrono>
#include <optional>
#include <span>

#include <opencv2/core.hpp>

#include "compare/drift/target_movement.h"

namespace etalon {

using Minutes = std::chrono::duration<double, std::ratio<60>>;

// One piece of time.
struct DriftBlock {
    Minutes time{};          // mean of its frames
    Movement movement;       // median of its frames, each of the four
    TargetPoints residuals;  // the same of each point
};

struct DriftRate {
    Minutes from{}, to{};           // the first and the last block
    Movement per_min;               // px/min, see Movement
    Movement standard_uncertainty;  // of each
    // The largest drift over the image. It is that of one of its four corners, as the drift is
    // linear in the pixel, even where the target does not reach: then the uncertainty is large.
    double worst_px_per_min = 0.0;
    Eigen::Vector2d worst_pixel = Eigen::Vector2d::Zero();
    double standard_uncertainty_px_per_min = 0.0;  // of the worst
    double coverage_factor = 0.0;
    double expanded_uncertainty_px_per_min = 0.0;  // their product
    // Largest over the image's corners of value + U: what the drift is below.
    double bound_px_per_min = 0.0;
    // How fast the points drift against each other, root mean square over them, its noise included:
    // what shift, growth and turn do not explain (a tilt, a bending target, the distortion).
    double shape_px_per_min = 0.0;
    double block_correlation = 0.0;  // of neighbouring blocks' residuals; 0 where it is negative

    bool below(double limit_px_per_min) const {
        return bound_px_per_min < limit_px_per_min && shape_px_per_min < limit_px_per_min;
    }
};

inline constexpr std::size_t min_blocks = 15;

// `chance_of_error` is how likely a drift that is as large as the limit or larger may be called
// below it: bound < limit for a true worst drift >= limit has at most this probability, since the
// true worst corner alone would need an error of U in one direction. Nothing for fewer than
// min_blocks blocks or blocks at one time. Times must rise.
std::optional<DriftRate> estimate_drift(std::span<const DriftBlock> blocks,
                                        const TargetReference& reference, cv::Size image,
                                        double chance_of_error);

}  // namespace etalon
