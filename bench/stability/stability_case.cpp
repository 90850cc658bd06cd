#include "bench/stability/stability_case.h"

#include <fmt/format.h>

#include "bench/stability/reference_check.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double tolerance_gray = 0.1;
constexpr int probes = 24;
constexpr ReferenceEffort effort{.samples_per_scramble = 1024, .rounds = 2};

}  // namespace

RenderedImage render_once(const CameraModel& camera, const Scene& scene,
                          const RenderOptions& options) {
    return Renderer(camera).render(scene, options);
}

std::vector<StabilityCase> stability_cases() {
    std::vector<StabilityCase> all;
    for (const auto& group : {geometry_cases(), camera_cases(), input_cases(), invariant_cases(),
                              projection_cases(), wide_lens_cases(), wide_render_cases(),
                              servo_cases(), calibration_cases(), registration_cases()})
        all.insert(all.end(), group.begin(), group.end());
    return all;
}

StabilityOutcome outcome_of(const StabilityCase& one, const RenderFunction& render) {
    try {
        return one.run(render);
    } catch (const std::exception& error) {
        return {.words = error.what()};
    }
}

StabilityOutcome compare_with_reference(const Radiance& radiance, const CameraModel& camera,
                                        const Scene& scene) {
    const ReferenceCheck check = check_against_reference(
        radiance, camera, scene, probe_pixels(camera, scene, probes, 1), tolerance_gray, effort);
    return {check.within() && check.pixels > 0 && cv::checkRange(radiance),
            std::abs(check.difference_gray), check.bound_gray,
            fmt::format("{} pixels, the worst at ({}, {})", check.pixels, check.pixel.x,
                        check.pixel.y)};
}

StabilityCase agrees_with_reference(const std::string& name, const CameraModel& camera,
                                    const Scene& scene) {
    return {name, "reference, gray", [=](const RenderFunction& render) {
                const RenderedImage image = render(camera, scene, {});
                StabilityOutcome outcome = compare_with_reference(image.radiance, camera, scene);
                outcome.words += "; " + image.plan.describe();
                return outcome;
            }};
}

StabilityCase is_refused(const std::string& name, const CameraModel& camera, const Scene& scene) {
    return {name, "refused", [=](const RenderFunction& render) -> StabilityOutcome {
                try {
                    render(camera, scene, {});
                } catch (const NumericalError& refusal) {
                    return {.passed = true, .words = refusal.what()};
                }
                return {.figure = 1.0, .words = "an image instead of a refusal"};
            }};
}

StabilityOutcome differ_by(const Radiance& a, const Radiance& b, double bound_gray) {
    const double gray = 255.0 * cv::norm(a, b, cv::NORM_INF);
    return {gray <= bound_gray, gray, bound_gray, "largest difference of the two images"};
}

}  // namespace etalon
