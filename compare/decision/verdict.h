// From a measured value with its uncertainty to an outcome, and from outcomes to the verdict.
//
// Decision rule, unless the limits say otherwise (compare/decision/decision_rule.h): ISO 14253-1
// with guard bands of the expanded uncertainty (JCGM 106:2012, 8.3.2): what lies within U of the
// limit is proven neither good nor bad.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>

#include "compare/decision/decision_rule.h"

namespace etalon {

enum class Outcome {
    pass,            // value + w <= limit; w is U, or what the decision rule makes of it
    fail,            // value - w > limit
    inconclusive,    // neither can be said at this uncertainty
    not_observable,  // this run cannot see it, whatever its size
    skipped,         // not measured; the reason says why
};

// "PASS", "FAIL", "INCONCLUSIVE", "NOT_OBSERVABLE", "SKIPPED".
const char* name(Outcome outcome);

// One measured quantity against its limit.
struct JudgedQuantity {
    std::string name;  // as in the limits file: "b3_position_field_rms_mm"
    std::string unit;
    bool measured = false;  // value and U are there
    double value = 0.0;
    // U, one-sided 97.7 %: the coverage factor times the combined standard uncertainty, whose
    // effective degrees of freedom these are. Meaningless when skipped.
    double expanded_uncertainty = 0.0;
    double coverage_factor = 2.0;
    double degrees_of_freedom = std::numeric_limits<double>::infinity();
    // The same by Monte Carlo: what is to be added to the value for 97.7 %. Nothing: not asked for.
    std::optional<double> monte_carlo_uncertainty = {};
    double limit = 0.0;
    Outcome outcome = Outcome::skipped;
    std::string reason;                     // empty for a plain PASS or FAIL
    std::optional<DecisionRisk> risk = {};  // of what is judged; nothing without an uncertainty
};

// The decision rule. Throws NumericalError unless all three are finite, U >= 0 and limit > 0.
Outcome decide(double value, double expanded_uncertainty, double limit,
               const DecisionRule& rule = {});

// FAIL when any is FAIL; PASS when there is at least one and all are PASS; INCONCLUSIVE otherwise.
Outcome combine(std::span<const JudgedQuantity> quantities);

// What the verdict risks over all quantities together, each judged one-sided.
struct FamilyRisk {
    int judged = 0;
    // That a quantity exactly at its limit comes out as PASS, or as FAIL: the largest of all.
    double each = 0.0;
    // That a camera with any quantity at or above its limit gets PASS: all must pass, so it is no
    // more than that of one.
    double false_acceptance = 0.0;
    // That a camera with every quantity at or below its limit gets FAIL: one is enough, so they
    // add up (Bonferroni's bound, however the quantities depend on each other).
    double false_rejection = 0.0;
};
FamilyRisk family_risk(std::span<const JudgedQuantity> quantities, const DecisionRule& rule = {});

}  // namespace etalon
