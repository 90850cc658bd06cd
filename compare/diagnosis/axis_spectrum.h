// Least-squares spectrum (N. R. Lomb, Astrophys. Space Sci. 39, 1976) of one axis' error over its
// positions, beside what is blamed already: each pose's corners tell of its axis by one number.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "compare/diagnosis/error_candidates.h"

namespace etalon {

class AxisSpectrum {
public:
    // All whitened (compare/diagnosis/cause_rows.h): what a step of the axis does to the corners of
    // every pose, what is left of the observed, and a basis of what X and Y absorb.
    AxisSpectrum(const StageAxisMotion& axis, const Eigen::VectorXd& white_advance,
                 const Eigen::VectorXd& residual, const Eigen::MatrixXd& absorbed);

    // The longest of the periods (mm or rad) that explain next to as much as the best, then the
    // others; nothing where the axis hardly moves. `tried`: how many could be told apart.
    std::vector<double> periods(double shortest, int& tried) const;

private:
    std::vector<double> powers(double first, double last, double step) const;
    double power(const Eigen::ArrayXcd& phase) const;

    Eigen::VectorXd positions_, told_, weight_;
    Eigen::MatrixXd absorbed_;
};

}  // namespace etalon
