// Stiff and extreme cases of rendering, projection, the twin's servo, calibrating and registering:
// what each must end in, and how far it is from that. `etalon stability` runs them all;
// docs/stability.md explains each.
//
// The cases get the renderer as a function, so that a test can hand them a wrong one.
#pragma once

#include "bench/benchmark_scenes.h"
#include "sim/render/reference_integrator.h"

namespace etalon {

inline constexpr double infinity = std::numeric_limits<double>::infinity();

using RenderFunction =
    std::function<RenderedImage(const CameraModel&, const Scene&, const RenderOptions&)>;

// The renderer itself.
RenderedImage render_once(const CameraModel& camera, const Scene& scene,
                          const RenderOptions& options);

struct StabilityOutcome {
    bool passed = false;
    double figure = 0.0, bound = 0.0;  // |figure| <= bound is expected; in the expectation's unit
    std::string words;                 // what happened, or why it failed
};

struct StabilityCase {
    std::string name;         // at most 32 characters
    std::string expectation;  // at most 22
    std::function<StabilityOutcome(const RenderFunction&)> run;
};

// All of them, in the order of the table, and the groups of which they are.
std::vector<StabilityCase> stability_cases();
std::vector<StabilityCase> geometry_cases();      // tilt, focus, blur, size, behind the lens
std::vector<StabilityCase> camera_cases();        // distortion, f-number, focal length, image size
std::vector<StabilityCase> input_cases();         // what is refused, and the sensor's bits
std::vector<StabilityCase> invariant_cases();     // symmetries and limits
std::vector<StabilityCase> projection_cases();    // there and back
std::vector<StabilityCase> wide_lens_cases();     // the same of lenses that see more than a plane
std::vector<StabilityCase> wide_render_cases();   // renders through such lenses
std::vector<StabilityCase> servo_cases();         // the twin's stage; no renderer is asked
std::vector<StabilityCase> calibration_cases();   // fits in double and long double; none either
std::vector<StabilityCase> registration_cases();  // what a stage leaves free; none either

// An exception is a failure with its message.
StabilityOutcome outcome_of(const StabilityCase& one, const RenderFunction& render);

// ---- What cases are made of

StabilityOutcome at_most(double bound, double figure, const std::string& words);

// That no renderer is asked for.
StabilityCase without_render(const std::string& name, const std::string& expectation,
                             std::function<StabilityOutcome()> run);

// Probed pixels agree with the reference integrator within 0.1 gray + 4 standard errors.
StabilityCase agrees_with_reference(const std::string& name, const CameraModel& camera,
                                    const Scene& scene);
StabilityOutcome compare_with_reference(const Radiance& radiance, const CameraModel& camera,
                                        const Scene& scene);

// Ends in a NumericalError.
StabilityCase is_refused(const std::string& name, const CameraModel& camera, const Scene& scene);

// The largest difference of two images, gray. Both within 0.1 gray of the truth: 0.2 is allowed.
StabilityOutcome differ_by(const Radiance& a, const Radiance& b, double bound_gray = 0.2);

// Pixels where something can be wrong: at the markers' corners, on their outlines and grid lines,
// and anywhere in the image. Distinct, inside the image, at most `count`.
std::vector<cv::Point> probe_pixels(const CameraModel& camera, const Scene& scene, int count,
                                    std::uint64_t seed);

struct ReferenceEffort {
    int samples_per_scramble = 2048;  // of 16; a power of two
    int rounds = 3;                   // pixels in doubt get 8 times as many in each further one
};

// The pixel whose difference is the largest part of its bound. Gray: 1/255 of full scale.
struct ReferenceCheck {
    cv::Point pixel{-1, -1};
    double difference_gray = 0.0;      // render minus reference
    double standard_error_gray = 0.0;  // of the reference
    double bound_gray = 0.0;           // tolerance + 4 standard errors
    int pixels = 0;

    bool within() const { return std::abs(difference_gray) <= bound_gray; }
    double part_of_bound() const { return std::abs(difference_gray) / bound_gray; }
};

// In doubt is a pixel beyond its bound, or in the first round one whose standard error is more than
// half the tolerance. Throws NumericalError as integrate_reference().
ReferenceCheck check_against_reference(const Radiance& radiance, const CameraModel& camera,
                                       const Scene& scene, const std::vector<cv::Point>& pixels,
                                       double tolerance_gray, const ReferenceEffort& effort = {});

// ---- Cameras and scenes

// A marker of 10 x 10 cells without symmetry.
struct StabilityMarker {
    double side_px = 70.0;  // of the grid, were it not tilted, at the image's depth
    double depth_mm = 400.0;
    double tilt_deg = 25.0;  // about an axis at 35 degrees in the image, after a turn of 20
    Eigen::Vector2d off_centre_px = {4.3, -2.7};
};

// 160 x 120 px of 10 um, f = 800 px (image distance 8 mm), 550 nm, no distortion.
CameraModel short_camera(double f_number, double focus_mm);

// All 14 coefficients, each of a size of its own.
Distortion every_distortion();

// The marker before the image's centre.
Scene marker_scene(const CameraModel& camera, const StabilityMarker& place);

// Cells of radiance 0 or 1 without a pattern.
cv::Mat random_cells(int rows, int columns, std::uint64_t seed);

}  // namespace etalon
