// Pose errors to expect of a camera and a marker with a detector: bias B1
// (compare/pose/pose_bias.h) and noise, from renders. Each pose is rendered once, exposed without
// noise for the bias and several times with the calibration's noise, and detected like a
// photograph.
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "compare/expect/expected_view.h"
#include "compare/expect/pose_statistics.h"
#include "sim/scene/pose_volume.h"

namespace etalon {

// What a detector makes of the marker at one pose: simulated runs draw corners from it. Vectors
// stack the corners in the order of Marker::points_mm, x and y of each.
struct DetectorStatistics {
    Eigen::VectorXd bias;          // of the render without noise: detected - projected, px
    Eigen::VectorXd noise_bias;    // what noise adds to it on average, px
    Eigen::MatrixXd noise_factor;  // F F^T: covariance of a single frame's corners, px^2
    int frames = 0;                // with noise, in which the marker was detected
};

struct DetectorFigures {
    double noise_px = 0.0;       // of one coordinate of a corner in one frame, RMS over the poses
    double bias_px = 0.0;        // without noise, RMS over the coordinates and poses
    double noise_bias_px = 0.0;  // what noise adds to it, RMS, after shrinkage
    int frames = 0;              // asked for, per pose
    int seen = 0, asked = 0;     // poses: those whose marker is detected, and all
};

struct DetectorStudy : DetectorFigures {
    // Nothing where the marker is not detected without noise, or in less than half of the frames.
    std::vector<std::optional<DetectorStatistics>> poses;
    // How much of the measured noise biases' power is more than chance, 0 to 1. `poses` hold them
    // multiplied by it (positive-part James-Stein shrinkage).
    double noise_bias_share = 0.0;
};

// Noise depends on (seed, pose, frame) alone. Parallel over the poses; `step` is called after each,
// from any thread. CPU time: frames x (6 ns a pixel of the marker + one detection) a pose. Throws
// NumericalError without stated noise and for less than 8 frames, and what Renderer::render throws.
DetectorStudy study_detector(const ExpectedScene& scene, std::span<const Rigid> camera_from_marker,
                             int frames, std::uint64_t seed,
                             const std::function<void()>& step = {});

struct MarkerPlace {
    double depth_mm = 0.0;   // of the marker's origin; of a wide lens its distance
    double radius_px = 0.0;  // of its image from the principal point
    double tilt_rad = 0.0;   // between its normal and the line of sight
};
MarkerPlace place_of(const Projector& projector, const Rigid& camera_from_marker);

struct MapValue {
    double value = 0.0, low = 0.0, high = 0.0;  // 95 %
};

// A smooth map of one component of a pose error: least squares of 1, z, z^2, r, r^2, tilt^2, z r,
// z tilt^2 (z, r and tilt from -1 or 0 to 1 over the poses). Intervals are percentiles of a
// bootstrap of the poses (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter
// 13): errors of corner detectors do not scatter normally about the map.
class ExpectationMap {
public:
    static constexpr int min_poses = 20;

    // One value per place. Throws NumericalError for fewer than min_poses, or values that are not
    // finite. Some milliseconds for 200 poses.
    ExpectationMap(std::span<const MarkerPlace> places, std::span<const double> values,
                   std::uint64_t seed);

    MapValue at(const MarkerPlace& place) const { return average({place}); }
    MapValue mean() const { return average(places_); }  // over the poses
    // The same with this variable at `x` (mm, px or rad) in all of them.
    MapValue average_at(double MarkerPlace::*variable, double x) const;
    double scatter() const { return scatter_; }   // RMS of what the map leaves
    std::size_t worst() const { return worst_; }  // the pose where the map is farthest from zero

private:
    static constexpr int terms = 8;
    using Row = Eigen::Matrix<double, 1, terms>;

    Row row(const MarkerPlace& place) const;
    MapValue average(const std::vector<MarkerPlace>& places) const;

    std::vector<MarkerPlace> places_;
    double middle_mm_, half_mm_, largest_px_, largest_rad_;
    Eigen::Matrix<double, terms, 1> coefficients_;
    Eigen::Matrix<double, terms, Eigen::Dynamic> drawn_;  // coefficients of the bootstrap
    double scatter_ = 0.0;
    std::size_t worst_ = 0;
};

// The six components of a pose error, in directions that mean the same all over the image.
inline constexpr std::array<MeasureName, 6> error_components = {{
    {"along the line of sight", "mm"},  // away from the camera
    {"outwards in the image", "mm"},    // across the line of sight, away from the optical axis
    {"around the axis", "mm"},          // across both
    {"turn in its plane", "mrad"},
    {"tilt", "mrad"},         // away from the line of sight
    {"across tilt", "mrad"},  // about the direction into which it tilts
}};
using SixErrors = std::array<double, 6>;

SixErrors components_of(const PoseError& error, const Rigid& camera_from_marker);

// Standard deviations by component, of two or more errors.
std::optional<SixErrors> deviations_of(std::span<const SixErrors> errors);

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
    std::optional<SixErrors> bias;   // nothing: not detected without noise
    std::optional<SixErrors> noise;  // standard deviations over the detected frames with noise
    int detections = 0;              // of the frames with noise
    int flips = 0;                   // of those: the other planar solution fits the corners better
};

struct Expectation {
    using Six = std::optional<SixErrors> ExpectedPose::*;

    std::vector<ExpectedPose> poses;
    int frames = 0;        // with noise, per pose; 0 where the camera declares none
    std::string no_noise;  // why there is no noise; empty where there is
    // Of the bias and of the noise's logarithm. Nothing where too few poses have one.
    std::optional<std::array<ExpectationMap, 6>> bias_maps, noise_maps;

    int detected() const;           // poses, without noise
    double detection_rate() const;  // of all frames, with and without noise
    double flip_rate() const;       // of the detected frames with noise
    std::vector<double> values(Six six, std::size_t component) const;  // of the poses that have it
    void fit_maps(std::uint64_t seed);                                 // to the poses
};

// Parallel over the poses; the result does not depend on the threads. `step` and CPU time as above,
// and a render a pose. Throws ConfigError for a detector that cannot see the marker, NumericalError
// for a volume into which the marker hardly fits, and what Renderer::render throws.
Expectation expect_errors(const ExpectationRequest& request,
                          const std::function<void()>& step = {});

}  // namespace etalon
