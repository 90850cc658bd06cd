// The limits that a camera is judged by: a versioned file with an id.
//
//     etalon: limits/1
//     id: demo-1
//     b3_position_field_rms_mm: {limit: 0.06, unit: mm}
//     b3_position_field_max_mm: {limit: 0.20, unit: mm}
//
// and, optional, all other quantities of judged_quantities.h, judged where they are there and
// otherwise only reported, and:
//
//     pixels: must_match     # any difference of photographs and renders that is shown is a FAIL
//     decision_rule: guarded         # or simple, or {guard_band: 0.5}, a factor of U
//     may_be_unchecked: [repeatability]   # conditions of a PASS that a run may leave unchecked
//     due_after_days: 365            # when a camera that has passed is to be qualified again
//
// Of each quantity, optional, how its values scatter among the cameras that are judged:
//
//     b3_position_field_rms_mm: {limit: 0.06, unit: mm, prior: {mean: 0.03, deviation: 0.01}}
#pragma once

#include <algorithm>
#include <filesystem>
#include <map>
#include <vector>

#include "compare/decision/verdict.h"

namespace etalon {

// Names of judged quantities (judged_quantities.h) that are asked for one by one.
namespace quantity {
inline constexpr const char* position_rms = "b3_position_field_rms_mm";
inline constexpr const char* position_max = "b3_position_field_max_mm";
inline constexpr const char* rotation_rms = "b3_rotation_field_rms_mrad";
inline constexpr const char* rotation_max = "b3_rotation_field_max_mrad";
inline constexpr const char* lack_of_fit_rms = "b3_position_rest_rms_mm";
inline constexpr const char* length_max = "b3_length_error_max_mm";
inline constexpr const char* photometric_rms = "b4_position_field_rms_mm";
inline constexpr const char* photometric_max = "b4_position_field_max_mm";
}  // namespace quantity

struct Limits {
    std::string id;
    // > 0, by the quantity's name. position_rms and position_max are always there.
    std::map<std::string, double> by_quantity;
    bool pixels_must_match = false;
    DecisionRule rule = {};
    std::map<std::string, ValuePrior> priors = {};   // by the quantity's name
    std::vector<std::string> may_be_unchecked = {};  // names of conditions (acceptance.h)
    std::optional<int> due_after_days = {};

    bool lets_pass_unchecked(const std::string& condition) const {
        return std::ranges::count(may_be_unchecked, condition) > 0;
    }
};

// Throws ConfigError with file, line and key: unknown, missing or doubled keys, a limit that is not
// a positive number, a unit other than the one in the quantity's name, a maximum's limit below that
// of its RMS.
Limits read_limits(const std::filesystem::path& path);

// Sets outcome, risk and, where it is INCONCLUSIVE, the reason. Without an uncertainty, as in a
// simulation without noise, there is no risk. Throws NumericalError as decide() does.
void decide(JudgedQuantity& quantity, const Limits& limits);

}  // namespace etalon
