#include "compare/uncertainty/uncertainty_budget.h"

#include <fmt/format.h>

#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

double sensitivity_of(const BudgetRow& row, const std::string& quantity) {
    const auto found = row.sensitivity.find(quantity);
    return found == row.sensitivity.end() ? 0.0 : found->second;
}

}  // namespace

const char* name(Distribution distribution) {
    return distribution == Distribution::uniform ? "uniform" : "normal";
}

double BudgetRow::contribution(const std::string& quantity) const {
    return sensitivity_of(*this, quantity) * standard_uncertainty.value_or(0.0);
}

double coverage_factor(double degrees_of_freedom) {
    constexpr double normal_enough = 5000.0;  // the factor is 2.0004 there
    if (degrees_of_freedom > normal_enough)
        return 2.0;
    return student_t_quantile(1.0 - coverage_probability,
                              static_cast<int>(std::floor(degrees_of_freedom)));
}

CombinedUncertainty combined(std::span<const BudgetRow> budget, const std::string& quantity,
                             bool at_widest) {
    double variance = 0.0, fourth = 0.0;
    for (const BudgetRow& row : budget) {
        if (!row.counted)
            continue;
        const auto size =
            at_widest && !row.standard_uncertainty ? row.widest : row.standard_uncertainty;
        const double contribution = sensitivity_of(row, quantity) * size.value_or(0.0);
        if (!std::isfinite(contribution) || contribution < 0.0 || !(row.degrees_of_freedom >= 1.0))
            throw NumericalError(
                fmt::format("uncertainty budget: '{}' contributes {} with {} degrees of freedom",
                            row.source, contribution, row.degrees_of_freedom));
        variance += contribution * contribution;
        fourth += std::pow(contribution, 4) / row.degrees_of_freedom;
    }
    CombinedUncertainty result;
    result.standard = std::sqrt(variance);
    if (fourth > 0.0)
        result.degrees_of_freedom = variance * variance / fourth;
    result.coverage_factor = coverage_factor(result.degrees_of_freedom);
    result.expanded = result.coverage_factor * result.standard;
    return result;
}

std::vector<std::string> unknown_sources(std::span<const BudgetRow> budget,
                                         const std::string& quantity, bool without_bound) {
    std::vector<std::string> sources;
    for (const BudgetRow& row : budget)
        if (row.counted && !row.standard_uncertainty && sensitivity_of(row, quantity) > 0.0 &&
            row.widest.has_value() != without_bound)
            sources.push_back(row.source);
    return sources;
}

}  // namespace etalon
