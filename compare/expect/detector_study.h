// What a detector makes of the marker at given poses: its bias and its noise, from real renders and
// real detections. Studies of whole runs draw corners from it instead of rendering every frame.
//
// Each pose is rendered once, exposed through the camera's sensor without noise and then with N
// different noises, and every one of these images is detected as a photograph is.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "compare/expect/expected_view.h"

namespace etalon {

// At one pose. Vectors stack the corners in the order of Marker::points_mm: x, y of the first...
struct DetectorStatistics {
    Eigen::VectorXd bias;        // of the render without noise: detected - projected, px
    Eigen::VectorXd noise_bias;  // what noise adds to it on average, px
    // F with F F^T = covariance of a single frame's corners, px^2.
    Eigen::MatrixXd noise_factor;
    int frames = 0;  // with noise, in which the marker was detected
};

struct DetectorStudy {
    // Nothing where the marker is not detected without noise, or in less than half of the frames.
    std::vector<std::optional<DetectorStatistics>> poses;
    double noise_px = 0.0;       // of one coordinate of a corner in one frame, RMS over the poses
    double bias_px = 0.0;        // without noise, RMS over the coordinates and poses
    double noise_bias_px = 0.0;  // what noise adds to it, RMS, after the following
    // How much of the measured noise biases' power is more than chance, 0 to 1: they are means of
    // a few frames. `poses` hold them multiplied by it (positive-part James-Stein shrinkage).
    double noise_bias_share = 0.0;
    int frames = 0;  // asked for, per pose
};

// Noises are a pure function of (seed, pose, frame). `step` is called after every pose, from any
// thread; may be empty. Parallel over the poses; the result does not depend on the threads. CPU
// time: frames x (6 ns a pixel of the marker + one detection) per pose.
//
// Throws NumericalError when the camera declares no sensor noise, for less than 8 frames, and what
// Renderer::render throws.
DetectorStudy study_detector(const ExpectedScene& scene, std::span<const Rigid> camera_from_marker,
                             int frames, std::uint64_t seed,
                             const std::function<void()>& step = {});

}  // namespace etalon
