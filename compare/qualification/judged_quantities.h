// The quantities that a run is judged by: name in files, unit, words, limit, and where an analysis
// has the value. Lists, readers, judgements and reports go by this table.
#pragma once

#include "compare/qualification/limits_file.h"
#include "compare/uncertainty/budget_monte_carlo.h"

namespace etalon {

struct Qualification;

namespace quantity {
inline constexpr const char* position_rms = "b3_position_field_rms_mm";
inline constexpr const char* position_max = "b3_position_field_max_mm";
inline constexpr const char* rotation_rms = "b3_rotation_field_rms_mrad";
inline constexpr const char* rotation_max = "b3_rotation_field_max_mrad";
inline constexpr const char* lack_of_fit_rms = "b3_position_rest_rms_mm";
inline constexpr const char* length_max = "b3_length_error_max_mm";
inline constexpr const char* photometric_rms = "b4_position_field_rms_mm";
inline constexpr const char* photometric_max = "b4_position_field_max_mm";
inline constexpr const char* pixel_residual = "pixel_residual_gray";
inline constexpr const char* pixel_blur = "pixel_blur_px";
inline constexpr const char* pixel_tone = "pixel_tone_gray";
inline constexpr const char* pixel_shading = "pixel_shading_percent";
inline constexpr const char* pixel_noise = "pixel_noise_ratio";
inline constexpr const char* pixel_edge = "pixel_edge_px";
inline constexpr const char* pixel_background = "pixel_background_gray";
inline constexpr const char* pixel_black = "pixel_black_gray";
}  // namespace quantity

// What an analysis found, with the part of U that comes from the photographs' noise alone; of a
// quantity of pixels that is all of U.
struct MeasuredQuantity {
    double value = 0.0, noise_uncertainty = 0.0;
};

struct QuantityKind {
    const char* name;
    const char* unit;
    const char* words;  // for people
    std::optional<double> Limits::*limit;
    std::optional<MeasuredQuantity> (*measured)(const Qualification& result);  // with its fields
    const char* missing = "";                              // why there may be no value
    double MonteCarloUncertainty::*monte_carlo = nullptr;  // null: not propagated
    bool is_required = false;                              // every limits file has a limit for it
    bool is_of_pixels = false;  // photographs less renders; not in the budget
};

// In the order of reports.
std::span<const QuantityKind> quantity_kinds();

// Of this name, which one must have.
const QuantityKind& quantity_kind(const std::string& name);

}  // namespace etalon
