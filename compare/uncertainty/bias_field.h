// A smooth vector field over the working volume, fitted to pose errors at scattered positions.
//
// The verdict is about this field and not the errors' mean, which registration makes about zero.
// The power that noise alone gives it is taken out of the RMS.
#pragma once

#include <functional>

#include "calib/camera/lens_projection.h"

namespace etalon {

struct FieldSample {
    Eigen::Vector3d position_mm;  // of the marker, camera frame
    Eigen::Vector3d error;        // mm or rad, camera frame
    // Standard deviations along `axis` (unit; the line of sight for positions, the marker's normal
    // for rotations) and across it, both > 0. Only their course from sample to sample matters: the
    // two levels are estimated from the residuals.
    Eigen::Vector3d axis{0, 0, 1};
    double sigma_along = 1.0, sigma_across = 1.0;
};

enum class FieldBasis {
    // Constant, linear in position, and what a wrong distortion or edge position adds: lateral
    // (x, y) rho^2 and depth z rho^2, z^2, with rho the tangent of the angle to the optical axis.
    // 15 coefficients: 9 for (x, y), 6 for z. Positions with z > 0 only.
    position,
    // The same by the angle theta to the axis, for wide lenses: d theta^3 across the line of sight
    // and outwards; d theta^2 and (d - d_0)^2 along it, with d the distance and d_0 that of the
    // centre. Near the axis it is the one above.
    position_by_angle,
    // Constant and linear: 12 coefficients.
    linear,
};

struct BiasField {
    FieldBasis basis = FieldBasis::position;
    Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();  // mean position of the samples
    // Where the samples do not determine the whole basis, as all lie in a plane: sums of its columns
    // that they do; the field is what it is there. Empty: each column.
    Eigen::MatrixXd combinations;
    Eigen::VectorXd coefficients;
    Eigen::MatrixXd covariance;  // of the coefficients, from the residuals
    // Residual standard deviations in multiples of the samples' sigmas, and the plain ones in the
    // error's unit (across: per component); all corrected for the degrees of freedom.
    double scale_along = 0.0, scale_across = 0.0;
    double residual_along = 0.0, residual_across = 0.0;
    int samples = 0, degrees_of_freedom = 0;
    int down_weighted = 0;  // samples that Huber's loss (3 standard deviations) held back

    Eigen::Vector3d at(const Eigen::Vector3d& position_mm) const;
    bool is_full() const { return combinations.size() == 0; }
    // 3 x coefficients: the field is linear in its coefficients.
    Eigen::MatrixXd design(const Eigen::Vector3d& position_mm) const;
};

// That of positions that a camera is judged by.
FieldBasis position_basis(const LensProjection& projection);

// Least squares with Huber's weights and both noise levels re-estimated. Throws NumericalError for
// fewer than 10 samples, all at one place, and what is not finite.
BiasField fit_smooth_field(std::span<const FieldSample> samples, FieldBasis basis);

// The samples' design matrices below one another, 3 rows per sample.
Eigen::MatrixXd stacked_design(const BiasField& field, std::span<const FieldSample> samples);

// One over the noise's variance along each sample's axis and across it, at the field's levels.
std::vector<Eigen::Matrix3d> sample_weights(const BiasField& field,
                                            std::span<const FieldSample> samples);

// `left` times the block-diagonal matrix of these blocks; `left` has 3 columns for each.
Eigen::MatrixXd times_blocks(const Eigen::MatrixXd& left, std::span<const Eigen::Matrix3d> blocks);

// Coefficients x (3 per sample): what the fit makes of the samples' errors, Huber's weights aside.
Eigen::MatrixXd estimator(const BiasField& field, std::span<const FieldSample> samples);

// Normal deviates for 2000 draws of a field's noise, each a column; a field of fewer coefficients
// takes the first rows.
struct NoiseDraws {
    explicit NoiseDraws(std::uint64_t seed);
    Eigen::MatrixXd deviates;  // 15 x 2000
};

// Vectors that are linear in a field's coefficients, too many for memory: rows(first, count) times
// the coefficients are `count` of them below one another, each of `components`.
struct LinearVectors {
    Eigen::Index size = 0;
    int components = 1;
    std::function<Eigen::MatrixXd(Eigen::Index first, Eigen::Index count)> rows;
};

// The 97.7 % quantile, over the draws of the coefficients' noise, of the largest length among the
// vectors. Exact: only vectors are left out that cannot matter (Cauchy-Schwarz).
double noise_quantile(const BiasField& field, const NoiseDraws& draws,
                      const LinearVectors& vectors);

// A matrix F with F F^T the coefficients' covariance.
Eigen::MatrixXd covariance_factor(const BiasField& field);

// M of the field's mean power c^T M c over these positions.
Eigen::MatrixXd mean_power(const BiasField& field, std::span<const Eigen::Vector3d> positions_mm);

// A field over given positions, as vector norms, with expanded uncertainties (k = 2) from noise.
// The RMS is over the positions, the maximum over hull_positions().
struct FieldSummary {
    // sqrt(max(0, mean |f|^2 - power that noise alone puts into the coefficients)).
    double rms = 0.0;
    double rms_uncertainty = 0.0;  // U: rms + U covers the true RMS in 97.7 % of runs
    double noise_rms = 0.0;        // square root of the power that was taken out
    // Largest |f|, and the 97.7 % quantile of the largest |noise field|: a simultaneous band.
    double max = 0.0;
    double max_uncertainty = 0.0;
    Eigen::Vector3d max_position_mm = Eigen::Vector3d::Zero();
};

// `draws` are behind max_uncertainty. Some milliseconds for 100 positions. Throws NumericalError
// for no positions, or one that is not finite or not in front of the camera.
FieldSummary summarize(const BiasField& field, std::span<const Eigen::Vector3d> positions_mm,
                       const NoiseDraws& draws);

// The given positions and the midpoints of all pairs: they fill the convex hull.
std::vector<Eigen::Vector3d> hull_positions(std::span<const Eigen::Vector3d> positions_mm);

}  // namespace etalon
