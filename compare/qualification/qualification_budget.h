// The uncertainty budget of a qualification: every input that moves the judged fields, with its
// sensitivity from this run's geometry and residuals. The inputs: docs/metrology.md.
#pragma once

#include "compare/qualification/qualification.h"
#include "compare/uncertainty/budget_monte_carlo.h"

namespace etalon {

struct QualificationBudget {
    std::vector<BudgetRow> rows;
    // The systematic inputs of the position field among them, for the Monte Carlo propagation.
    std::vector<FieldInput> inputs;
};

// `result` holds registration, fields, rest, lengths and signatures. Throws NumericalError for a
// declared uncertainty that is negative or not finite, or one of an error without a signature.
QualificationBudget qualification_budget(const QualificationInput& input,
                                         const Qualification& result,
                                         std::span<const FieldSample> position_samples,
                                         std::span<const ErrorSignature> calibration);

}  // namespace etalon
