// What a smooth field leaves unexplained, once the noise and what is declared as uncertain are
// taken out: structure finer than the field's basis. And whether the residuals are as large as both
// say (chi-square, pooled over the samples).
#pragma once

#include "compare/uncertainty/bias_field.h"

namespace etalon {

// The noise of one sample's error, from repeats and not from the residuals.
struct SampleNoise {
    Eigen::Matrix3d covariance;       // in the error's unit, squared
    double degrees_of_freedom = 0.0;  // of its estimate, > 0
};

struct LackOfFit {
    double rms = 0.0;              // of the rest's length per sample; 0 where noise explains it all
    double rms_uncertainty = 0.0;  // U: rms + U covers the true one in 97.7 % of runs
    double noise_rms = 0.0;        // root mean square length of a sample's stated noise

    // Mean square of the residuals over that of stated noise and declared errors, its degrees of
    // freedom, and the 99.9 % quantile for residuals of nothing but these.
    double chi_square_ratio = 0.0, degrees_of_freedom = 0.0, chi_square_limit = 0.0;
};

// `samples` are those that the field was fitted to, `noise` one for each. `declared`: a column for
// each declared error, what it does to the samples' errors (3 rows per sample) at its standard
// uncertainty. Throws NumericalError when the sizes do not agree, a covariance is not finite and
// positive, or a declared error not finite. A millisecond for 60 samples, in proportion to them.
LackOfFit lack_of_fit(const BiasField& field, std::span<const FieldSample> samples,
                      std::span<const SampleNoise> noise, const Eigen::MatrixXd& declared = {});

// The 99.9 % quantile of chi-square over its degrees of freedom.
double chi_square_limit(double degrees_of_freedom);

}  // namespace etalon
