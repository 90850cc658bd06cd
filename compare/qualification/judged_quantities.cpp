#include "compare/qualification/judged_quantities.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compare/qualification/qualification.h"

namespace etalon {
namespace {

using Found = std::optional<MeasuredQuantity>;
using Analysis = Qualification;
using Monte = MonteCarloUncertainty;

constexpr const char* no_noise =
    "the noise is not known: it takes two frames per pose that differ, or a calibration that "
    "states it";
constexpr const char* no_photometric = "too few hold-out poses have a photometric pose";
constexpr const char* no_pixels =
    "too few photographs could be compared, or the camera's file does not say what it should be";

// The size of a difference of photographs and renders.
template <std::optional<PixelFigure> ImageAgreement::*figure>
Found pixels_of(const Analysis& a) {
    if (!a.pixels || !((*a.pixels).*figure))
        return std::nullopt;
    const PixelFigure& found = *((*a.pixels).*figure);
    return MeasuredQuantity{std::abs(found.value), found.expanded_uncertainty};
}

template <std::optional<PixelFigure> ImageAgreement::*figure>
constexpr QuantityKind of_pixels(const char* name, const char* unit, const char* words) {
    return {name, unit, words, pixels_of<figure>, no_pixels, nullptr, false, true};
}

Found rms_of(const FieldSummary& field, double unit = 1.0) {
    return MeasuredQuantity{field.rms / unit, field.rms_uncertainty / unit};
}

Found max_of(const FieldSummary& field, double unit = 1.0) {
    return MeasuredQuantity{field.max / unit, field.max_uncertainty / unit};
}

Found rest_of(const Analysis& a) {
    if (!a.position_lack_of_fit)
        return std::nullopt;
    return MeasuredQuantity{a.position_lack_of_fit->rms, a.position_lack_of_fit->rms_uncertainty};
}

Found length_of(const Analysis& a) {
    if (!a.lengths)
        return std::nullopt;
    return MeasuredQuantity{a.lengths->field_max_mm, a.lengths->field_max_uncertainty_mm};
}

constexpr double milli = 1e-3;

constexpr QuantityKind kinds[] = {
    {quantity::position_rms, "mm", "Position bias, RMS of the field over the volume",
     [](const Analysis& a) { return rms_of(a.position_summary); }, "", &Monte::rms, true},
    {quantity::position_max, "mm", "Position bias, largest value of the field in the volume",
     [](const Analysis& a) { return max_of(a.position_summary); }, "", &Monte::max, true},
    {quantity::rotation_rms, "mrad", "Rotation bias, RMS of the field over the volume",
     [](const Analysis& a) {
         return a.rotation_field ? rms_of(a.rotation_summary, milli) : Found();
     }},
    {quantity::rotation_max, "mrad", "Rotation bias, largest value of the field in the volume",
     [](const Analysis& a) {
         return a.rotation_field ? max_of(a.rotation_summary, milli) : Found();
     }},
    {quantity::lack_of_fit_rms, "mm", "Position bias, RMS of what the field leaves, without noise",
     rest_of, no_noise},
    {quantity::length_max, "mm", "Length error, largest that the field makes between two poses",
     length_of, "", &Monte::length_max},
    {quantity::photometric_rms, "mm", "Position bias of photometric poses (B4), RMS of the field",
     [](const Analysis& a) {
         return a.photometric ? rms_of(a.photometric->position_summary) : Found();
     },
     no_photometric},
    {quantity::photometric_max, "mm",
     "Position bias of photometric poses (B4), largest value of the field",
     [](const Analysis& a) {
         return a.photometric ? max_of(a.photometric->position_summary) : Found();
     },
     no_photometric},
    of_pixels<&ImageAgreement::residual_gray>("pixel_residual_gray", "gray",
                                              "Pixels: residual beyond the stated noise, RMS"),
    of_pixels<&ImageAgreement::blur_px>("pixel_blur_px", "px", "Pixels: difference of blur, RMS"),
    of_pixels<&ImageAgreement::tone_gray>(
        "pixel_tone_gray", "gray", "Pixels: difference of tone, half way from black to white"),
    of_pixels<&ImageAgreement::shading_percent>("pixel_shading_percent", "%",
                                                "Pixels: change of white over the image"),
    of_pixels<&ImageAgreement::noise_ratio>("pixel_noise_ratio", "1",
                                            "Pixels: noise over the stated noise, less 1"),
    of_pixels<&ImageAgreement::edge_px>("pixel_edge_px", "px", "Pixels: position of edges"),
    of_pixels<&ImageAgreement::background_gray>("pixel_background_gray", "gray",
                                                "Pixels: difference of what is beside the marker"),
    of_pixels<&ImageAgreement::black_gray>("pixel_black_gray", "gray",
                                           "Pixels: difference of black")};

}  // namespace

std::span<const QuantityKind> quantity_kinds() {
    return kinds;
}

const QuantityKind& quantity_kind(const std::string& name) {
    const auto found = std::ranges::find(kinds, name, &QuantityKind::name);
    if (found == std::end(kinds))
        throw NumericalError(fmt::format("there is no judged quantity '{}'", name));
    return *found;
}

}  // namespace etalon
