#include "sim/tiles/render_plan.h"

#include <fmt/format.h>

namespace etalon {
namespace {

const char* name_of(RenderMethod method) {
    switch (method) {
        case RenderMethod::exact_lens:
            return "exact lens averages";
        case RenderMethod::exact_area:
            return "exact areas";
        case RenderMethod::edge_table:
            return "a table of edges";
        case RenderMethod::wedge_table:
            return "a table of edges and corners";
        case RenderMethod::reference:
            return "reference integrator";
        case RenderMethod::wave:
            return "wave-optical point spread";
        case RenderMethod::automatic:
            break;
    }
    return "automatic";
}

}  // namespace

const char* name_of(NeglectedEffect omission) {
    switch (omission) {
        case NeglectedEffect::lens:
            return "lens";
        case NeglectedEffect::diffraction:
            return "diffraction";
        case NeglectedEffect::tail:
            return "tail";
        case NeglectedEffect::distortion:
            return "distortion";
        case NeglectedEffect::uniform_tiles:
            break;
    }
    return "uniform tiles";
}

std::string RenderPlan::describe() const {
    std::string text = name_of(method);
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
    for (const LeftOut& left : left_out)
        if (left.what != NeglectedEffect::uniform_tiles && left.what != NeglectedEffect::tail)
            text += fmt::format(", no {}", name_of(left.what));
    return text;
}

}  // namespace etalon
