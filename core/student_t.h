// Quantiles of Student's t distribution, for intervals from a standard deviation that was itself
// estimated from a few values (GUM, annex G.3).
#pragma once

namespace etalon {

// P(T <= t) with `degrees_of_freedom` >= 1, by the finite series of Abramowitz and Stegun 26.7.3
// and 26.7.4: exact to rounding, terms as many as half the degrees of freedom.
double student_t_probability(double t, int degrees_of_freedom);

// The t with P(T <= t) = 1 - upper_tail, 0 < upper_tail <= 0.5. Taken from the small tail, so that
// quantiles far out keep their digits to about upper_tail = 1e-12. Throws NumericalError for other
// arguments.
double student_t_quantile(double upper_tail, int degrees_of_freedom);

}  // namespace etalon
