// From a measured value with its uncertainty to an outcome, and from outcomes to the verdict.
//
// Decision rule: ISO 14253-1 with guard bands of the expanded uncertainty (JCGM 106:2012, 8.3.2):
// what lies within U of the limit is proven neither good nor bad.
#pragma once

#include <span>
#include <string>

namespace etalon {

enum class Outcome {
    pass,            // value + U <= limit
    fail,            // value - U > limit
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
    double value = 0.0;
    double expanded_uncertainty = 0.0;  // U, one-sided 97.7 % (k = 2); meaningless when skipped
    double limit = 0.0;
    Outcome outcome = Outcome::skipped;
    std::string reason;  // empty for a plain PASS or FAIL
};

// The decision rule. Throws NumericalError unless all three are finite, U >= 0 and limit > 0.
Outcome decide(double value, double expanded_uncertainty, double limit);

// FAIL when any is FAIL; PASS when there is at least one and all are PASS; INCONCLUSIVE otherwise.
Outcome combine(std::span<const JudgedQuantity> quantities);

// Process exit code of a verdict: 0, 1, and 2 for everything that is neither PASS nor FAIL.
int exit_code(Outcome verdict);

}  // namespace etalon
