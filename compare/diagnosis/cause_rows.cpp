#include "compare/diagnosis/cause_rows.h"

#include <fmt/format.h>

#include <Eigen/Dense>

namespace etalon {
namespace {

constexpr double no_trace = 1e-6;  // of a column before X and Y are solved

}  // namespace

Eigen::VectorXd observed(const DiagnosisInput& evidence) {
    std::vector<Eigen::VectorXd> parts = evidence.difference_px;
    parts.push_back(evidence.pixels);
    Eigen::VectorXd all;
    for (const Eigen::VectorXd& part : parts) {
        all.conservativeResize(all.size() + part.size());
        all.tail(part.size()) = part;
    }
    return all;
}

Eigen::MatrixXd registration_columns(const DiagnosisInput& evidence) {
    const SignatureChain& chain = evidence.request.chain;
    const auto rows = static_cast<Eigen::Index>(2 * chain.points_mm.size());
    Eigen::MatrixXd xy =
        Eigen::MatrixXd::Zero(rows * std::ssize(chain.poses) + evidence.pixels.size(), 12);
    for (std::size_t i = 0; i < chain.poses.size(); ++i)
        xy.middleRows(static_cast<Eigen::Index>(i) * rows, rows) =
            registration_jacobian(chain.projector, chain.points_mm, chain.camera_from_base,
                                  chain.poses[i].base_from_carriage, chain.carriage_from_marker);
    return xy;
}

NuisanceProjection::NuisanceProjection(const DiagnosisInput& evidence,
                                       const Eigen::MatrixXd& by_registration)
    : pixel_rows_(evidence.pixels.size()) {
    if (pixel_rows_ > 0)
        pixel_factor_.compute(evidence.pixel_covariance);
    for (std::size_t i = 0; i < evidence.covariance_px2.size(); ++i) {
        factors_.emplace_back(evidence.covariance_px2[i]);
        if (factors_.back().info() != Eigen::Success)
            throw NumericalError(
                fmt::format("causes: pose {} has no covariance of its corners", i));
    }
    const Eigen::MatrixXd xy = whitened(by_registration);
    const Eigen::VectorXd unscale = xy.colwise().norm().cwiseInverse();
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> solver;
    solver.setThreshold(1e-9);
    solver.compute(xy * unscale.asDiagonal());
    absorbed_ = solver.householderQ() * Eigen::MatrixXd::Identity(xy.rows(), solver.rank());
}

Eigen::MatrixXd NuisanceProjection::whitened(Eigen::MatrixXd columns) const {
    const Eigen::Index rows = (columns.rows() - pixel_rows_) / std::ssize(factors_);
    for (std::size_t i = 0; i < factors_.size(); ++i) {
        auto block = columns.middleRows(static_cast<Eigen::Index>(i) * rows, rows);
        factors_[i].matrixL().solveInPlace(block);
    }
    if (pixel_rows_ > 0) {
        auto block = columns.bottomRows(pixel_rows_);
        pixel_factor_.matrixL().solveInPlace(block);
    }
    return columns;
}

Eigen::MatrixXd NuisanceProjection::columns_of(const ErrorCandidate& candidate) const {
    const Eigen::Index rows = candidate.corners_px.rows();
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(absorbed_.rows(), candidate.corners_px.cols());
    all.middleRows(candidate.only_pose.value_or(0) * rows, rows) = candidate.corners_px;
    if (pixel_rows_ > 0 && candidate.pixels.rows() == pixel_rows_)
        all.bottomRows(pixel_rows_) = candidate.pixels;
    return all;
}

Eigen::VectorXd NuisanceProjection::whitened_corners(const Eigen::VectorXd& column) const {
    Eigen::VectorXd all = Eigen::VectorXd::Zero(column.size() + pixel_rows_);
    all.head(column.size()) = column;
    return whitened(all).col(0).head(column.size());
}

Eigen::MatrixXd NuisanceProjection::freed(const Eigen::MatrixXd& columns) const {
    const Eigen::MatrixXd white = whitened(columns);
    return white - absorbed_ * (absorbed_.transpose() * white);
}

bool NuisanceProjection::leaves_a_trace(const ErrorCandidate& candidate,
                                        const Eigen::MatrixXd& freed) const {
    return freed.norm() > no_trace * whitened(columns_of(candidate)).norm();
}

double NuisanceProjection::log_determinant() const {
    double sum = 0.0;
    for (const Eigen::LLT<Eigen::MatrixXd>& factor : factors_)
        sum += 2.0 * Eigen::MatrixXd(factor.matrixL()).diagonal().array().log().sum();
    return sum;
}

Metric::Metric(Eigen::MatrixXd declared)
    : declared_(std::move(declared)),
      inverse_(Eigen::MatrixXd(Eigen::MatrixXd::Identity(declared_.cols(), declared_.cols()) +
                               declared_.transpose() * declared_)) {}

Eigen::MatrixXd Metric::product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) const {
    const Eigen::MatrixXd plain = a.transpose() * b;
    if (declared_.cols() == 0)
        return plain;
    const Eigen::MatrixXd of_a = declared_.transpose() * a, of_b = declared_.transpose() * b;
    return plain - of_a.transpose() * inverse_.solve(of_b);
}

Eigen::VectorXd Metric::weighted(const Eigen::VectorXd& a) const {
    return declared_.cols() == 0
               ? a
               : Eigen::VectorXd(
                     a - declared_ * inverse_.solve(Eigen::VectorXd(declared_.transpose() * a)));
}

Eigen::MatrixXd declared_columns(const DiagnosisInput& evidence, const NuisanceProjection& rows,
                                 const std::vector<ErrorCandidate>& error_candidates) {
    Eigen::MatrixXd columns(observed(evidence).size(), 0);
    for (const ErrorCandidate& candidate : error_candidates) {
        const auto declared = evidence.declared.find(candidate.name);
        if (declared == evidence.declared.end() || candidate.corners_px.cols() != 1)
            continue;
        columns.conservativeResize(Eigen::NoChange, columns.cols() + 1);
        columns.rightCols<1>() = rows.freed(candidate) * (declared->second / candidate.size);
    }
    return columns;
}

}  // namespace etalon
