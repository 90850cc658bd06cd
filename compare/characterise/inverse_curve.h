// A sensor's inverse transfer curve, radiance from code, fitted to patches that were exposed for
// known times: g(T) = E t with the patches' irradiances E unknown. The work horse of
// compare/characterise/transfer_estimate.h.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace etalon {

struct ExposedPatch {
    int patch = 0;  // 0, 1, ...
    double exposure = 0.0;
    double code = 0.0;  // T, 0 without light, 1 at full scale
    double standard_uncertainty = 0.0;
};

int patch_count(const std::vector<ExposedPatch>& observed);

// Cubic B-spline g with g(0) = 0 and g = 1 at the highest code observed. It goes on straight below
// 0, and beyond the highest code with the bend that it has there.
class InverseCurve {
public:
    double radiance(double code) const;
    double slope(double code) const;  // d radiance / d code
    // Standard uncertainty of radiance(code) / radiance(top). Beyond the highest code that was seen
    // the whole effect of the bend is added.
    double relative_uncertainty(double code, double top) const;
    int parameters() const { return static_cast<int>(weights_.size()) - 2; }

    std::vector<double> irradiance;  // of each patch
    double chi_square = 0.0;

private:
    friend InverseCurve fit_inverse_curve(const std::vector<ExposedPatch>& observed);
    InverseCurve(int pieces, double end);
    Eigen::VectorXd basis(double code) const;  // values at `code`, continued outside 0..end
    Eigen::VectorXd bend_at_end() const;       // second derivative at the end
    void fit(const std::vector<ExposedPatch>& observed);
    bool rises() const;

    int pieces_;
    double end_;
    Eigen::VectorXd weights_;     // of the basis functions; the first is 0, the last 1
    Eigen::MatrixXd covariance_;  // of all of them
};

// Weighted least squares in code, for 1, 2, 3 ... 12 pieces; the number that Schwarz's criterion
// prefers among those where the curve rises. Throws NumericalError when there is none.
InverseCurve fit_inverse_curve(const std::vector<ExposedPatch>& observed);

// Chi-square of a given inverse curve, with the irradiances that fit best.
double irradiance_chi_square(const std::vector<ExposedPatch>& observed,
                             const std::function<double(double)>& inverse,
                             const std::function<double(double)>& slope);

}  // namespace etalon
