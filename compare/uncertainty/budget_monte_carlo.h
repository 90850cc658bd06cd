// The uncertainty budget by Monte Carlo (JCGM 101:2008), to compare with linear propagation: all
// inputs are drawn from their distributions, and the judged figures of the moved field taken again.
#pragma once

#include <stop_token>

#include "compare/uncertainty/bias_field.h"
#include "compare/uncertainty/uncertainty_budget.h"

namespace etalon {

// What an input makes of the samples' errors when it is off by one standard uncertainty: a column
// for each independent way in which it can be off, 3 rows per sample. The degrees of freedom are
// those of all columns together.
struct FieldInput {
    Eigen::MatrixXd shifts;
    Distribution distribution = Distribution::normal;
    double degrees_of_freedom = std::numeric_limits<double>::infinity();
};

// What is to be added to the field's figure to cover its true value in 97.7 % of runs.
struct MonteCarloUncertainty {
    double rms = 0.0, max = 0.0, length_max = 0.0;
};

// `samples` are those that the field was fitted to, `positions_mm` those of summarize(). Inputs
// with degrees of freedom and the field's noise are drawn from Student's distribution. 2000 draws
// from `seed`; some 0.2 s for 40 samples and 70 positions. Throws what summarize() throws,
// NumericalError for an input of another size, and Interrupted when a stop is requested.
MonteCarloUncertainty monte_carlo_uncertainty(const BiasField& field,
                                              std::span<const FieldSample> samples,
                                              std::span<const Eigen::Vector3d> positions_mm,
                                              std::span<const FieldInput> inputs,
                                              std::uint64_t seed, const std::stop_token& stop = {});

}  // namespace etalon
