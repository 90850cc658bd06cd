// What pose errors a camera and a marker are to be expected to give with a detector: bias B1
// (compare/pose/pose_bias.h) and noise, from renders at poses all over the volume that the
// camera sees. The routine test after a calibration: no stage and no photograph is needed.
//
// Each pose is rendered once, exposed without noise for the bias and several times with the noise
// that the calibration's sensor section declares, and detected like a photograph.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "compare/expect/expected_view.h"
#include "compare/pose/pose_bias.h"
#include "sim/scene/pose_volume.h"

namespace etalon {

// What a detector makes of the marker at given poses: its bias and its noise, from real renders and
// real detections. Studies of whole runs draw corners from it instead of rendering every frame.
//
// Each pose is rendered once, exposed through the camera's sensor without noise and then with N
// different noises, and every one of these images is detected as a photograph is.

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

// A smooth map of one component of a pose error over distance, image position and tilt, with
// bootstrap intervals.
//
// Least squares of 1, z, z^2, r, r^2, tilt^2, z r, z tilt^2 (z, r and tilt from -1 or 0 to 1 over
// the poses). The poses are drawn again with replacement for the intervals (Efron and Tibshirani,
// An Introduction to the Bootstrap, 1993, chapter 13: percentiles): no assumption about how errors
// scatter about the map, which for corner detectors is anything but normal.

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

// The six components of a pose error, in directions that mean the same all over the image.
struct ErrorComponent {
    const char* name;
    const char* unit;  // "mm", "mrad"
};
inline constexpr std::array<ErrorComponent, 6> error_components = {{
    {"along the line of sight", "mm"},  // away from the camera
    {"outwards in the image", "mm"},    // across the line of sight, away from the optical axis
    {"around the axis", "mm"},          // across both
    {"turn in its plane", "mrad"},
    {"tilt", "mrad"},         // away from the line of sight
    {"across tilt", "mrad"},  // about the direction into which it tilts
}};
using SixErrors = std::array<double, 6>;

SixErrors components_of(const PoseError& error, const Rigid& camera_from_marker);
MarkerPlace place_of(const Projector& projector, const Rigid& camera_from_marker);

// Mean and standard deviation of errors that come one by one (Welford 1962).
class ErrorSpread {
public:
    void add(const SixErrors& errors);
    std::optional<SixErrors> deviations() const;  // of two or more

private:
    int count_ = 0;
    SixErrors mean_{}, squares_{};
};

struct ExpectationRequest {
    ExpectedScene scene;
    SeenVolume volume;
    int poses = 200;
    int frames = 8;  // with noise, per pose; 0: bias alone
    std::uint64_t seed = 1;
};

struct ExpectedPose {
    Rigid camera_from_marker;
    MarkerPlace place;
    std::optional<SixErrors> bias;  // nothing: not detected without noise
    // Standard deviations over the frames with noise that were detected, if two or more were.
    std::optional<SixErrors> noise;
    int detections = 0;  // of the frames with noise
    int flips = 0;       // of those: the other planar solution fits the corners better
};

struct Expectation {
    std::vector<ExpectedPose> poses;
    int frames = 0;        // with noise, per pose; 0 where the camera declares none
    std::string no_noise;  // why there is no noise; empty where there is
    // Nothing where too few poses were detected.
    std::optional<std::array<ExpectationMap, 6>> bias_maps;
    // Of the logarithm of the deviations.
    std::optional<std::array<ExpectationMap, 6>> noise_maps;

    int detected() const;                             // poses, without noise
    double detection_rate() const;                    // of all frames, with and without noise
    double flip_rate() const;                         // of the detected frames with noise
    std::vector<double> biases(int component) const;  // of the detected poses
    std::vector<double> noises(int component) const;
};

// The maps of given poses, for reports whose poses were rendered anyway.
void fit_maps(Expectation& expectation, std::uint64_t seed);

// Parallel over the poses; the result does not depend on the threads. `step` is called after every
// pose, from any thread. CPU time: a render, and per frame 6 ns a pixel of the marker and a
// detection. Throws ConfigError for a detector that cannot see the marker, NumericalError for a
// volume into which the marker hardly fits, and what Renderer::render throws.
Expectation expect_errors(const ExpectationRequest& request,
                          const std::function<void()>& step = {});

}  // namespace etalon
