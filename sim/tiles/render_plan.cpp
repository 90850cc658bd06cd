#include "sim/tiles/render_plan.h"

#include <fmt/format.h>

#include <array>

#include "sim/tiles/tile_map.h"

namespace etalon {
namespace {

// In the order of RenderMethod and of NeglectedEffect.
constexpr std::array method_names{"automatic",
                                  "exact lens averages",
                                  "exact areas",
                                  "a table of edges",
                                  "a table of edges and corners",
                                  "reference integrator",
                                  "wave-optical point spread"};
constexpr std::array effect_names{"lens", "diffraction", "tail", "distortion", "uniform tiles"};

}  // namespace

const char* name_of(NeglectedEffect omission) {
    return effect_names.at(static_cast<std::size_t>(omission));
}

std::string RenderPlan::describe() const {
    std::string text = method_names.at(static_cast<std::size_t>(method));
    if (method == RenderMethod::exact_lens || method == RenderMethod::exact_area)
        text += fmt::format(", {} x {} samples/px (within {:.2g} gray)", points_per_pixel_side,
                            points_per_pixel_side, sampling_gray);
    else if (method == RenderMethod::wedge_table)
        text += fmt::format(" (within {:.2g} gray)", sampling_gray);
    if (border_gray > 0.0)
        text += fmt::format(", {:.2g} gray more at the distortion model's end", border_gray);
    text +=
        fmt::format(", blur radius {:.3g} to {:.3g} px", min_blur_radius_px, max_blur_radius_px);
    if (tail_reach_px > 0.0)
        text += fmt::format(", diffraction to {:.0f} px", tail_reach_px);
    for (const NeglectedBound& left : left_out)
        if (left.what != NeglectedEffect::uniform_tiles && left.what != NeglectedEffect::tail)
            text += fmt::format(", no {}", name_of(left.what));
    return text;
}

Radiance RenderedPart::within(const cv::Rect& other) const {
    Radiance result(other.size(), CV_32FC1);
    const cv::Rect both = region & other;
    set_outside(both, other, static_cast<float>(background), result);
    if (!both.empty())
        radiance(both - region.tl()).copyTo(result(both - other.tl()));
    return result;
}

}  // namespace etalon
