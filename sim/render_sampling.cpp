#include "sim/render_sampling.h"

#include <array>

#include "core/errors.h"

namespace etalon {
namespace {

// From this blur radius on, exact lens averages at points are cheaper than exact areas, and their
// samples so close that the blur disk cannot fall between them.
constexpr double exact_lens_from_px = 0.14;
// Samples per pixel side of exact_area for a maximum error of 0.1 gray.
constexpr int area_samples = 9;

struct Step {
    double from_px;  // smallest blur radius
    int count;
};

// Samples per pixel side of exact_lens for a maximum error of 0.1 gray (docs/rendering.md).
int lens_samples(double blur_px) {
    static constexpr std::array<Step, 6> steps{
        {{4.0, 2}, {2.0, 3}, {0.8, 4}, {0.4, 6}, {0.25, 8}, {0.0, 11}}};
    for (const Step& step : steps)
        if (blur_px >= step.from_px)
            return step.count;
    return steps.back().count;
}

// The error falls at least with the third power of k: a larger tolerance saves samples, a smaller
// one costs them.
int scaled(int k, double tolerance_gray) {
    const double factor = std::cbrt(0.1 / tolerance_gray);
    return std::clamp(static_cast<int>(std::ceil(k * factor - 1e-9)), 1, 32);
}

void choose_lens_points(double blur_px, Sampling& sampling) {
    if (blur_px < 0.03)
        return;  // the lens centre alone
    sampling.lens_rings = blur_px < 0.15 ? 2 : blur_px < 0.5 ? 3 : 4;
    sampling.lens_spokes = blur_px < 0.15 ? 6 : blur_px < 0.5 ? 12 : 24;
}

RenderMethod choose_method(const BlurRange& blur, const ImageFilter& filter) {
    if (!filter.has_point_spread())
        return RenderMethod::exact_area;
    return blur.smallest_px >= exact_lens_from_px ? RenderMethod::exact_lens
                                                  : RenderMethod::exact_area;
}

void choose_tail(double contrast, const ImageFilter& filter, double tolerance_gray,
                 RenderPlan& plan) {
    const double allowed = 0.1 * tolerance_gray / (255.0 * std::max(contrast, 1e-9));
    plan.near_tail = filter.has_near_tail();
    if (!filter.has_far_tail())
        return;
    plan.far_tail_reach_px = filter.radius_of_tail(allowed);
    plan.omitted_tail_gray = 0.1 * tolerance_gray;
}

}  // namespace

RenderSampling choose_sampling(const BlurRange& blur, double contrast, const ImageFilter& filter,
                               const RenderOptions& options) {
    RenderSampling chosen;
    RenderPlan& plan = chosen.plan;
    Sampling& sampling = chosen.sampling;
    const bool automatic = options.method == RenderMethod::automatic;
    plan.method = automatic ? choose_method(blur, filter) : options.method;
    plan.min_blur_radius_px = blur.smallest_px;
    plan.max_blur_radius_px = blur.largest_px;
    if (plan.method == RenderMethod::reference)
        return chosen;
    if (plan.method == RenderMethod::exact_lens) {
        sampling.kind = SampleKind::point;
        sampling.k = scaled(lens_samples(blur.smallest_px), options.tolerance_gray);
    } else {
        sampling.kind = SampleKind::box;
        sampling.k = filter.has_point_spread() ? scaled(area_samples, options.tolerance_gray) : 1;
        double sharp_up_to = blur.largest_px;
        if (automatic && blur.largest_px > exact_lens_from_px)
            sharp_up_to = sampling.exact_lens_from_px = exact_lens_from_px;
        choose_lens_points(sharp_up_to, sampling);
        plan.lens_points = std::max(1, sampling.lens_rings * sampling.lens_spokes);
    }
    if (options.samples_per_side > 0)
        sampling.k = options.samples_per_side;
    plan.points_per_pixel_side = sampling.k;
    plan.exact_lens_from_px = sampling.exact_lens_from_px;
    choose_tail(contrast, filter, options.tolerance_gray, plan);
    return chosen;
}

std::string RenderPlan::describe() const {
    if (method == RenderMethod::reference)
        return fmt::format("reference integrator, blur radius {:.3g} to {:.3g} px",
                           min_blur_radius_px, max_blur_radius_px);
    const char* names[] = {"automatic", "exact lens averages", "exact areas"};
    std::string text = fmt::format("{}, {} x {} samples/px", names[static_cast<int>(method)],
                                   points_per_pixel_side, points_per_pixel_side);
    if (method == RenderMethod::exact_area)
        text += fmt::format(", {} lens points", lens_points);
    if (std::isfinite(exact_lens_from_px))
        text += fmt::format(" (exact lens averages from {} px of blur)", exact_lens_from_px);
    text +=
        fmt::format(", blur radius {:.3g} to {:.3g} px", min_blur_radius_px, max_blur_radius_px);
    if (far_tail_reach_px > 0.0)
        text += fmt::format(", diffraction to {:.0f} px (beyond: {:.2g} gray)", far_tail_reach_px,
                            omitted_tail_gray);
    else
        text += near_tail ? ", wide point spread" : ", no diffraction tail";
    return text;
}

}  // namespace etalon
