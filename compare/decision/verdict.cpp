#include "compare/decision/verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compare/uncertainty/uncertainty_budget.h"
#include "core/program/errors.h"

namespace etalon {

const char* name(Outcome outcome) {
    constexpr const char* names[] = {"PASS", "FAIL", "INCONCLUSIVE", "NOT_OBSERVABLE", "SKIPPED"};
    return names[static_cast<std::size_t>(outcome)];
}

Outcome decide(double value, double expanded_uncertainty, double limit, const DecisionRule& rule) {
    if (!std::isfinite(value) || !std::isfinite(expanded_uncertainty) || !std::isfinite(limit) ||
        expanded_uncertainty < 0.0 || limit <= 0.0)
        throw NumericalError(fmt::format("verdict: value {}, U {}, limit {} cannot be judged",
                                         value, expanded_uncertainty, limit));
    const double guard = rule.guard_factor * expanded_uncertainty;
    if (value + guard <= limit)
        return Outcome::pass;
    if (value - guard > limit)
        return Outcome::fail;
    return Outcome::inconclusive;
}

Outcome combine(std::span<const JudgedQuantity> quantities) {
    const auto is = [](Outcome outcome) {
        return [outcome](const JudgedQuantity& quantity) { return quantity.outcome == outcome; };
    };
    if (std::any_of(quantities.begin(), quantities.end(), is(Outcome::fail)))
        return Outcome::fail;
    if (!quantities.empty() && std::all_of(quantities.begin(), quantities.end(), is(Outcome::pass)))
        return Outcome::pass;
    return Outcome::inconclusive;
}

FamilyRisk family_risk(std::span<const JudgedQuantity> quantities, const DecisionRule& rule) {
    FamilyRisk risk;
    risk.judged = static_cast<int>(quantities.size());
    if (rule.guard_factor == 1.0) {
        risk.each = 1.0 - coverage_probability;  // whatever the degrees of freedom; less for pixels
    } else {
        for (const JudgedQuantity& each : quantities)
            risk.each = std::max(
                risk.each, risk_at_limit(rule, each.coverage_factor, each.degrees_of_freedom));
    }
    risk.false_acceptance = risk.each;
    risk.false_rejection = std::min(1.0, risk.judged * risk.each);
    return risk;
}

}  // namespace etalon
