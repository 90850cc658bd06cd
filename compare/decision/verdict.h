// From a measured value with its uncertainty to an outcome and its risks, and from outcomes to the
// verdict: ILAC-G8:09/2019 for the rules, JCGM 106:2012 for the risks. The default is ISO 14253-1's
// guard band of U (JCGM 106, 8.3.2).
//
//     guarded       w = U      value + w <= limit is PASS, value - w > limit is FAIL, anything
//     simple        w = 0      between is INCONCLUSIVE (with w = 0 nothing is)
//     guard_band: r w = r U
//
// Consumer's risk: the true value is above its limit and gets PASS. Producer's: it is not, and gets
// FAIL. The measured value scatters about the true one as Student's t with u = U / k and the
// budget's degrees of freedom.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>

namespace etalon {

struct DecisionRule {
    double guard_factor = 1.0;  // r, 0 to 3

    std::string name() const;      // "guarded", "simple", "guard band 0.5 U"
    std::string sentence() const;  // what is PASS, FAIL and INCONCLUSIVE
};

// Of the values of the cameras that are judged: normal, cut off at 0.
struct ValuePrior {
    double mean = 0.0, deviation = 0.0;  // deviation > 0
};

struct DecisionRisk {
    // That the true value is at or below its limit (JCGM 106, 7.2). Specific risks (8.1.1): the
    // consumer's of a PASS is 1 less it, the producer's of a FAIL is it.
    double conformance = 0.0;
    // Global risks (9.5): with a prior the joint probabilities, without one the largest possible.
    double consumer = 0.0, producer = 0.0;
    bool has_prior = false;
    // Operating characteristic: true values that get PASS in 95, 50 and 5 % of runs. Nothing: none.
    std::optional<double> passes_95, passes_50, passes_5;
};

enum class Outcome {
    pass,            // value + w <= limit; w is U, or what the decision rule makes of it
    fail,            // value - w > limit
    inconclusive,    // neither can be said at this uncertainty
    not_observable,  // this run cannot see it, whatever its size
    skipped,         // not measured; the reason says why
};

// "PASS", "FAIL", "INCONCLUSIVE", "NOT_OBSERVABLE", "SKIPPED".
const char* name(Outcome outcome);

struct JudgedQuantity {
    std::string name;  // as in the limits file: "b3_position_field_rms_mm"
    std::string unit;
    bool measured = false;  // value and U are there
    double value = 0.0;
    // U, one-sided 97.7 %, with the effective degrees of freedom. Meaningless when skipped.
    double expanded_uncertainty = 0.0;
    double coverage_factor = 2.0;
    double degrees_of_freedom = std::numeric_limits<double>::infinity();
    std::optional<double> monte_carlo_uncertainty = {};  // U by it; nothing: not asked for
    double limit = 0.0;
    Outcome outcome = Outcome::skipped;
    std::string reason;                     // empty for a plain PASS or FAIL
    std::optional<DecisionRisk> risk = {};  // of what is judged; nothing without an uncertainty
};

// Throws NumericalError unless all three are finite, U >= 0 and limit > 0.
Outcome decide(double value, double expanded_uncertainty, double limit,
               const DecisionRule& rule = {});

// Throws NumericalError for an uncertainty or a limit that is not positive and finite.
DecisionRisk decision_risk(const JudgedQuantity& measured, const DecisionRule& rule,
                           const std::optional<ValuePrior>& prior = std::nullopt);

// That a value whose true size is exactly its limit gets PASS, which is as probable as FAIL.
double risk_at_limit(const DecisionRule& rule, double coverage_factor, double degrees_of_freedom);

// FAIL when any is FAIL; PASS when there is at least one and all are PASS; INCONCLUSIVE otherwise.
Outcome combine(std::span<const JudgedQuantity> quantities);

// What the verdict risks over all quantities together, each judged one-sided.
struct FamilyWiseRisk {
    int judged = 0;
    double each = 0.0;  // that one exactly at its limit gets PASS, or FAIL: the largest of all
    // With any quantity at or above its limit: no more than that of one, as all must pass.
    double false_acceptance = 0.0;
    // With every quantity at or below its limit: Bonferroni's bound, the sum.
    double false_rejection = 0.0;
};
FamilyWiseRisk family_wise_risk(std::span<const JudgedQuantity> quantities,
                                const DecisionRule& rule = {});

}  // namespace etalon
