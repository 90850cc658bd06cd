// An uncertainty budget as data: inputs with their standard uncertainties and sensitivities. GUM
// (JCGM 100:2008): contributions in quadrature (5.1), effective degrees of freedom by Welch and
// Satterthwaite, coverage factor from Student's distribution (annex G). Which inputs there are:
// compare/qualification/qualification_budget.h.
#pragma once

#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace etalon {

enum class Distribution { normal, uniform };
const char* name(Distribution distribution);  // "normal", "uniform"

struct BudgetRow {
    std::string source;  // "stage scale z", "image noise", "marker print size"
    std::optional<double> standard_uncertainty;  // of the input, in `unit`; nothing: unknown
    std::string unit;
    Distribution distribution = Distribution::normal;
    // Infinite where the standard uncertainty is declared: it is taken as it stands.
    double degrees_of_freedom = std::numeric_limits<double>::infinity();
    std::string basis;  // where it comes from: "declared by the station"

    // |d quantity / d input| by the quantity's name, in the quantity's unit per `unit`. A quantity
    // that is not here does not depend on the input.
    std::map<std::string, double> sensitivity;

    // Of an unknown input: the largest plausible standard uncertainty. Nothing: there is no
    // telling.
    std::optional<double> widest;

    bool counted = true;  // false: shown only, as its effect is in the measured value

    // Sensitivity times standard uncertainty; 0 for an unknown input and an independent quantity.
    double contribution(const std::string& quantity) const;
};

struct CombinedUncertainty {
    double standard = 0.0;
    double degrees_of_freedom = std::numeric_limits<double>::infinity();  // effective
    double coverage_factor = 2.0;
    double expanded = 0.0;  // U = coverage_factor * standard
};

// One-sided probability of a coverage factor of 2 for a normal distribution.
inline constexpr double coverage_probability = 0.97724986805182079;

// The t with P(T <= t) = coverage_probability; 2 for infinitely many degrees of freedom (>= 1).
double coverage_factor(double degrees_of_freedom);

// Of a fitted field's noise, which has hundreds of degrees of freedom.
inline constexpr double field_coverage_factor = 2.0;

// Of the known, counted rows; `at_widest`: with every unknown input at its widest. Throws
// NumericalError for a row whose figures are negative or not finite.
CombinedUncertainty combined(std::span<const BudgetRow> budget, const std::string& quantity,
                             bool at_widest = false);

// Sources of counted unknown inputs that the quantity depends on: `without_bound` those of which
// there is no telling, otherwise those with a widest value.
std::vector<std::string> unknown_sources(std::span<const BudgetRow> budget,
                                         const std::string& quantity, bool without_bound);

}  // namespace etalon
