// Stiff and extreme cases of rendering, projection, the twin's servo, calibrating and registering:
// what each must end in, and how far it is from that. `etalon stability` runs them all;
// docs/stability.md explains each.
//
// The cases get the renderer as a function, so that a test can hand them a wrong one.
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "sim/render/renderer.h"

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

// All of them, in the order of the table.
std::vector<StabilityCase> stability_cases();

// The groups that it is made of.
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

// Probed pixels agree with the reference integrator within 0.1 gray + 4 standard errors.
StabilityCase agrees_with_reference(const std::string& name, const CameraModel& camera,
                                    const Scene& scene);
StabilityOutcome compare_with_reference(const Radiance& radiance, const CameraModel& camera,
                                        const Scene& scene);

// Ends in a NumericalError.
StabilityCase is_refused(const std::string& name, const CameraModel& camera, const Scene& scene);

// The largest difference of two images, gray. Both within 0.1 gray of the truth: 0.2 is allowed.
StabilityOutcome differ_by(const Radiance& a, const Radiance& b, double bound_gray = 0.2);

}  // namespace etalon
