// The quantities that a run is judged by: name in files, unit, words, and where an analysis has the
// value. Lists, readers, judgements and reports go by this table.
#pragma once

#include "compare/qualification/limits_file.h"
#include "compare/uncertainty/budget_monte_carlo.h"

namespace etalon {

struct Qualification;

// What an analysis found, with the part of U that comes from the photographs' noise; of pixels that
// is all of U.
struct MeasuredQuantity {
    double value = 0.0, noise_uncertainty = 0.0;
};

struct QuantityKind {
    const char* name;
    const char* unit;
    const char* words;                                                         // for people
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
