// What a run observed, as rows in units of their standard deviations, freed of what X and Y can
// absorb (method: compare/diagnosis/causes.h).
#pragma once

#include <Eigen/Cholesky>

#include "compare/diagnosis/causes.h"

namespace etalon {

// The corners of all poses, stacked, and beneath them what the pixels tell.
Eigen::VectorXd observed(const DiagnosisInput& evidence);

// What X and Y do to these rows, 12 columns; nothing to pixels.
Eigen::MatrixXd registration_columns(const DiagnosisInput& evidence);

// Whitens rows and frees them. Immutable.
class NuisanceProjection {
public:
    // Throws NumericalError for a covariance that is not positive definite.
    explicit NuisanceProjection(const DiagnosisInput& evidence)
        : NuisanceProjection(evidence, registration_columns(evidence)) {}
    NuisanceProjection(const DiagnosisInput& evidence, const Eigen::MatrixXd& by_registration);

    Eigen::MatrixXd whitened(Eigen::MatrixXd columns) const;
    Eigen::VectorXd whitened_corners(const Eigen::VectorXd& column) const;

    Eigen::MatrixXd freed(const Eigen::MatrixXd& columns) const;
    Eigen::MatrixXd freed(const ErrorCandidate& candidate) const {
        return freed(columns_of(candidate));
    }

    bool leaves_a_trace(const ErrorCandidate& candidate, const Eigen::MatrixXd& freed) const;

    // An orthonormal basis of what X and Y absorb.
    const Eigen::MatrixXd& absorbed() const { return absorbed_; }
    Eigen::Index degrees_of_freedom() const { return absorbed_.rows() - absorbed_.cols(); }
    // Of the covariance of all poses.
    double log_determinant() const;

private:
    Eigen::MatrixXd columns_of(const ErrorCandidate& candidate) const;

    std::vector<Eigen::LLT<Eigen::MatrixXd>> factors_;
    Eigen::LLT<Eigen::MatrixXd> pixel_factor_;
    Eigen::Index pixel_rows_ = 0;
    Eigen::MatrixXd absorbed_;
};

// What the declared errors make of products of columns: with the whitened covariance I + U U^T (U:
// each declared error at its standard uncertainty)
// a^T (I + U U^T)^-1 b = a^T b - (U^T a)^T (I + U^T U)^-1 (U^T b).
class Metric {
public:
    explicit Metric(Eigen::MatrixXd declared);

    Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) const;
    Eigen::VectorXd weighted(const Eigen::VectorXd& a) const;

private:
    Eigen::MatrixXd declared_;
    Eigen::LDLT<Eigen::MatrixXd> inverse_;
};

// Of the candidates that are declared as uncertain, freed; a column each.
Eigen::MatrixXd declared_columns(const DiagnosisInput& evidence, const NuisanceProjection& rows,
                                 const std::vector<ErrorCandidate>& error_candidates);

// What was observed, freed of X and Y. `metric` must outlive it.
struct Observation {
    // `known`: how many candidates each is one of.
    Observation(const DiagnosisInput& evidence, const NuisanceProjection& rows,
                const Metric& measure, std::size_t known)
        : metric(&measure),
          values(rows.freed(observed(evidence))),
          square(measure.product(values, values)(0, 0)),
          freedom(static_cast<double>(rows.degrees_of_freedom())),
          log_determinant(rows.log_determinant()),
          known(static_cast<double>(known)) {}

    const Metric* metric;
    Eigen::VectorXd values;
    double square, freedom, log_determinant, known;
};

}  // namespace etalon
