// What pose errors a camera and a marker are to be expected to give with a detector: bias B1
// (compare/pose/pose_bias.h) and noise, from renders at poses all over the volume that the
// camera sees. The routine test after a calibration: no stage and no photograph is needed.
//
// Each pose is rendered once, exposed without noise for the bias and several times with the noise
// that the calibration's sensor section declares, and detected like a photograph.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "compare/expect/expectation_map.h"
#include "compare/expect/expected_view.h"
#include "compare/pose/pose_bias.h"
#include "sim/scene/bench_poses.h"

namespace etalon {

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
