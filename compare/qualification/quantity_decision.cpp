#include "compare/qualification/quantity_decision.h"

namespace etalon {
namespace {

std::optional<DecisionRisk> risk_of(const JudgedQuantity& quantity, const Limits& limits) {
    if (!(quantity.expanded_uncertainty > 0.0))
        return std::nullopt;
    const MeasuredAgainstLimit measured{
        quantity.value, quantity.expanded_uncertainty / quantity.coverage_factor,
        quantity.coverage_factor, quantity.degrees_of_freedom, quantity.limit};
    const auto prior = limits.priors.find(quantity.name);
    return decision_risk(
        measured, limits.rule,
        prior == limits.priors.end() ? std::nullopt : std::optional(prior->second));
}

}  // namespace

void decide(JudgedQuantity& quantity, const Limits& limits) {
    quantity.outcome =
        decide(quantity.value, quantity.expanded_uncertainty, quantity.limit, limits.rule);
    quantity.risk = risk_of(quantity, limits);
    if (quantity.outcome == Outcome::inconclusive)
        quantity.reason = limits.rule.guard_factor == 1.0
                              ? "the limit lies within the uncertainty of the value"
                              : "the limit lies within the guard band of the value";
}

}  // namespace etalon
