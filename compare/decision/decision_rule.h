// How uncertainty is taken into account where a value is judged against its limit, and what that
// risks: ILAC-G8:09/2019 for the rules, JCGM 106:2012 for the risks.
//
//     guarded       w = U      value + w <= limit is PASS, value - w > limit is FAIL, anything
//     simple        w = 0      between is INCONCLUSIVE (with w = 0 nothing is)
//     guard_band: r w = r U
//
// Consumer's risk: the value is truly above its limit and gets PASS. Producer's: it is truly at or
// below the limit and gets FAIL. The measured value scatters about the true one as Student's t with
// u = U / k and the budget's degrees of freedom.
#pragma once

#include <limits>
#include <optional>
#include <string>

namespace etalon {

struct DecisionRule {
    double guard_factor = 1.0;  // r, 0 to 3

    std::string name() const;      // "guarded", "simple", "guard band 0.5 U"
    std::string sentence() const;  // what is PASS, FAIL and INCONCLUSIVE
};

// How the values of the cameras that are judged scatter, known from elsewhere: normal, cut off at
// 0.
struct ValuePrior {
    double mean = 0.0, deviation = 0.0;  // deviation > 0
};

// What a value and its judgement rest on.
struct MeasuredAgainstLimit {
    double value = 0.0;
    double standard_uncertainty = 0.0;
    double coverage_factor = 2.0;  // U over the standard uncertainty
    double degrees_of_freedom = std::numeric_limits<double>::infinity();
    double limit = 0.0;
};

struct DecisionRisk {
    // That this value is truly at or below its limit, nothing else being known (JCGM 106, 7.2).
    // Specific risks (8.1.1): of a PASS the consumer's is 1 less it, of a FAIL the producer's is
    // it.
    double conformance = 0.0;
    // Global risks (9.5): with a prior the joint probabilities; without one the largest that they
    // can be, whatever the prior.
    double consumer = 0.0, producer = 0.0;
    bool has_prior = false;
    // Operating characteristic: true values that get PASS in 95, 50 and 5 % of runs. Nothing: none.
    std::optional<double> passes_95, passes_50, passes_5;
};

// Throws NumericalError for a standard uncertainty or a limit that is not positive and finite.
DecisionRisk decision_risk(const MeasuredAgainstLimit& measured, const DecisionRule& rule,
                           const std::optional<ValuePrior>& prior = std::nullopt);

// That a value whose true size is exactly its limit gets PASS, which is as probable as that it gets
// FAIL.
double risk_at_limit(const DecisionRule& rule, double coverage_factor, double degrees_of_freedom);

}  // namespace etalon
