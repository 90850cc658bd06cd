#include "compare/diagnosis/error_signatures.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/intrinsics/calibration_model.h"
#include "core/program/errors.h"

namespace etalon {
double rms_norm(const Eigen::VectorXd& field) {
    return std::sqrt(3.0 * field.squaredNorm() / static_cast<double>(field.size()));
}

double max_norm(const Eigen::VectorXd& field) {
    return std::sqrt(field.reshaped(3, field.size() / 3).colwise().squaredNorm().maxCoeff());
}

namespace {

constexpr double confounded_cosine = 0.95;
constexpr double vanished = 1e-6;          // of the field before registration
constexpr double detection_sigmas = 3.29;  // 1.645 (5 % test) + 1.645 (95 % power)

// --------------------------------------------------------------------- poses and registration

// The chain to first order: from corner displacements to pose errors and to X, Y.
class LinearChain {
public:
    explicit LinearChain(const SignatureChain& chain) : chain_(chain) {
        const auto rows = static_cast<Eigen::Index>(2 * chain.points_mm.size());
        Eigen::MatrixXd training(0, 12);
        for (std::size_t i = 0; i < chain.poses.size(); ++i) {
            pose_solvers_.emplace_back(chain.pose_jacobian(i));
            if (chain.poses[i].hold_out)
                continue;
            training.conservativeResize(training.rows() + rows, 12);
            training.bottomRows(rows) = registration_jacobian(
                chain.projector, chain.points_mm, chain.camera_from_base,
                chain.poses[i].base_from_carriage, chain.carriage_from_marker);
        }
        unscale_ = training.colwise().norm().cwiseInverse();
        // The predicted poses do not depend on the freedoms: the shortest solution will do.
        registration_.setThreshold(1e-9);
        registration_.compute(training * unscale_.asDiagonal());
    }

    // Position errors of the hold-out poses before and after registration.
    void propagate(const std::vector<Eigen::VectorXd>& displacement,
                   ErrorSignature& signature) const {
        std::vector<double> training;
        for (std::size_t i = 0; i < displacement.size(); ++i)
            if (!chain_.poses[i].hold_out)
                training.insert(training.end(), displacement[i].begin(), displacement[i].end());
        const Eigen::VectorXd solution = registration_.solve(stacked(training));
        const Vector12d xy = unscale_.cwiseProduct(solution);
        std::vector<double> before, after, rotation;
        for (std::size_t i = 0; i < displacement.size(); ++i) {
            if (!chain_.poses[i].hold_out)
                continue;
            const Vector6d seen = pose_solvers_[i].solve(displacement[i]);
            const Eigen::Vector3d shift = seen.tail<3>();
            const Eigen::Vector3d left = shift - predicted_shift(i, xy);
            const Eigen::Vector3d turned = seen.head<3>() - predicted_turn(i, xy);
            before.insert(before.end(), shift.begin(), shift.end());
            after.insert(after.end(), left.begin(), left.end());
            rotation.insert(rotation.end(), turned.begin(), turned.end());
        }
        signature.before = stacked(before);
        signature.after = stacked(after);
        signature.rotation_after = stacked(rotation);
    }

private:
    static Eigen::VectorXd stacked(const std::vector<double>& values) {
        return Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
    }

    // What X and Y moved by `xy` do to the marker's origin, camera frame.
    Eigen::Vector3d predicted_shift(std::size_t i, const Vector12d& xy) const {
        const Rigid& base_from_carriage = chain_.poses[i].base_from_carriage;
        const Eigen::Vector3d from_base =
            chain_.camera_from_base.rotation *
            (base_from_carriage * chain_.carriage_from_marker.translation);
        return Eigen::Vector3d(xy.head<3>()).cross(from_base) + xy.segment<3>(3) +
               chain_.camera_from_base.rotation *
                   (base_from_carriage.rotation * Eigen::Vector3d(xy.tail<3>()));
    }

    // And to the marker's rotation.
    Eigen::Vector3d predicted_turn(std::size_t i, const Vector12d& xy) const {
        return xy.head<3>() +
               chain_.camera_from_base.rotation * (chain_.poses[i].base_from_carriage.rotation *
                                                   Eigen::Vector3d(xy.segment<3>(6)));
    }

    using PoseSolver = Eigen::ColPivHouseholderQR<Eigen::MatrixXd>;

    const SignatureChain& chain_;
    std::vector<PoseSolver> pose_solvers_;
    Vector12d unscale_;
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> registration_;
};

// ------------------------------------------------------------------------------------- figures

// Information about the error's amplitude (in units of `size`) that the hold-out poses carry.
double information(const SignatureChain& chain, const Eigen::VectorXd& field,
                   const HoldOutNoise& noise) {
    double sum = 0.0;
    Eigen::Index k = 0;
    for (std::size_t i = 0; i < chain.poses.size(); ++i) {
        if (!chain.poses[i].hold_out)
            continue;
        const Eigen::Vector3d sight = chain.camera_from_marker(i).translation.normalized();
        const Eigen::Vector3d error = field.segment<3>(3 * k);
        const double along = sight.dot(error);
        const auto n = static_cast<std::size_t>(k);
        sum += std::pow(along / noise.along_mm[n], 2) +
               (error - along * sight).squaredNorm() / std::pow(noise.across_mm[n], 2);
        ++k;
    }
    return sum;
}

bool has_vanished(const ErrorSignature& signature) {
    return signature.after_rms_mm <= vanished * signature.before_rms_mm;
}

void judge_observability(const SignatureChain& chain, const HoldOutNoise& noise,
                         double limit_rms_mm, ErrorSignature& signature) {
    signature.before_rms_mm = rms_norm(signature.before);
    signature.before_max_mm = max_norm(signature.before);
    signature.after_rms_mm = rms_norm(signature.after);
    signature.after_max_mm = max_norm(signature.after);
    signature.detectable_size = std::numeric_limits<double>::infinity();
    if (has_vanished(signature)) {
        signature.observable = false;
        signature.reason = "registration absorbs it entirely";
        return;
    }
    signature.detectable_size = std::abs(signature.size) * detection_sigmas /
                                std::sqrt(information(chain, signature.after, noise));
    const double field_mm =
        signature.after_rms_mm * signature.detectable_size / std::abs(signature.size);
    if (field_mm > limit_rms_mm) {
        signature.observable = false;
        signature.reason = fmt::format(
            "the smallest size that is detected leaves {:.3g} mm RMS, more than the limit",
            field_mm);
    }
}

double cosine(const Eigen::VectorXd& one, const Eigen::VectorXd& two) {
    const double norms = one.norm() * two.norm();
    return norms > 0.0 ? one.dot(two) / norms : 0.0;
}

void find_confounded(std::vector<ErrorSignature>& signatures) {
    for (ErrorSignature& one : signatures)
        for (const ErrorSignature& two : signatures)
            if (&one != &two && !has_vanished(one) && !has_vanished(two) &&
                std::abs(cosine(one.after, two.after)) > confounded_cosine)
                one.confounded_with.push_back(two.name);
}

ErrorSignature isotropic_scale(std::span<const ErrorSignature> stage,
                               std::span<const std::size_t> linear_scale) {
    ErrorSignature sum;
    sum.name = "stage scale, all linear axes";
    sum.unit = "1";
    sum.size = 1e-3;
    for (const std::size_t index : linear_scale) {
        const ErrorSignature& one = stage[index];
        const double ratio = sum.size / one.size;
        if (sum.after.size() == 0)
            sum.before = sum.after = sum.rotation_after = Eigen::VectorXd::Zero(one.after.size());
        sum.before += ratio * one.before;
        sum.after += ratio * one.after;
        sum.rotation_after += ratio * one.rotation_after;
    }
    return sum;
}

void require_usable(const SignatureChain& chain, std::span<const StageError> stage_errors,
                    std::span<const std::size_t> linear_scale, const HoldOutNoise& noise) {
    const auto hold_out =
        static_cast<std::size_t>(std::ranges::count(chain.poses, true, &AnalysedPose::hold_out));
    bool usable = hold_out > 0 && hold_out < chain.poses.size() &&
                  noise.along_mm.size() == hold_out && noise.across_mm.size() == hold_out &&
                  chain.points_mm.size() >= 3;
    for (const std::size_t index : linear_scale)
        usable = usable && index < stage_errors.size();
    for (const auto* levels : {&noise.along_mm, &noise.across_mm})
        for (const double level : *levels)
            usable = usable && std::isfinite(level) && level > 0.0;
    if (!usable)
        throw NumericalError("error signatures: poses, split and noise levels do not agree");
}

ErrorSignature signature_of(const NamedError& error, const LinearChain& linear, std::size_t poses) {
    ErrorSignature signature;
    signature.name = error.name;
    signature.unit = error.unit;
    signature.size = error.size;
    std::vector<Eigen::VectorXd> displacement;
    for (std::size_t i = 0; i < poses; ++i)
        displacement.push_back(error.displacement(i));
    linear.propagate(displacement, signature);
    return signature;
}

}  // namespace

std::vector<ErrorSignature> error_signatures(const SignatureChain& chain,
                                             std::span<const StageError> stage_errors,
                                             std::span<const std::size_t> linear_scale,
                                             const HoldOutNoise& noise, double limit_rms_mm) {
    require_usable(chain, stage_errors, linear_scale, noise);
    const LinearChain linear(chain);
    const NamedErrors named(chain);
    std::vector<ErrorSignature> signatures;
    for (const NamedError& error : named.with_signatures(stage_errors))
        signatures.push_back(signature_of(error, linear, chain.poses.size()));
    if (linear_scale.size() >= 2) {
        const auto stage = std::span(signatures).last(stage_errors.size());
        signatures.push_back(isotropic_scale(stage, linear_scale));
    }
    for (ErrorSignature& signature : signatures)
        judge_observability(chain, noise, limit_rms_mm, signature);
    find_confounded(signatures);
    return signatures;
}

Eigen::MatrixXd fields_after_registration(const SignatureChain& chain,
                                          const Eigen::MatrixXd& corners_px) {
    const LinearChain linear(chain);
    const auto rows = static_cast<Eigen::Index>(2 * chain.points_mm.size());
    Eigen::MatrixXd fields;
    for (const auto& column : corners_px.colwise()) {
        std::vector<Eigen::VectorXd> displacement;
        for (Eigen::Index row = 0; row < column.size(); row += rows)
            displacement.emplace_back(column.segment(row, rows));
        ErrorSignature signature;
        linear.propagate(displacement, signature);
        fields.conservativeResize(signature.after.size(), fields.cols() + 1);
        fields.rightCols<1>() = signature.after;
    }
    return fields;
}

std::vector<ErrorSignature> calibration_signatures(const SignatureChain& chain) {
    constexpr double small = 1e-2;  // of a standard deviation: the model stays valid
    const CameraModel& camera = chain.projector.camera();
    if (!camera.covariance)
        return {};
    const CalibrationModel stated{"", camera.covariance->order};
    const Eigen::VectorXd values = parameters_of(camera, stated);
    const Eigen::VectorXd deviation =
        camera.covariance->matrix.diagonal().cwiseMax(0.0).cwiseSqrt();
    // Directions of the correlation matrix: parameters have different units.
    const Eigen::VectorXd unscale = (deviation.array() > 0.0).select(deviation.cwiseInverse(), 0.0);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
        Eigen::MatrixXd(unscale.asDiagonal() * camera.covariance->matrix * unscale.asDiagonal()));
    const LinearChain linear(chain);
    const NamedErrors named(chain);
    std::vector<ErrorSignature> signatures;
    for (Eigen::Index i = deviation.size() - 1; i >= 0; --i) {
        const Eigen::VectorXd step = std::sqrt(std::max(0.0, eigen.eigenvalues()[i])) *
                                     deviation.cwiseProduct(eigen.eigenvectors().col(i));
        if (step.isZero(0.0))
            continue;
        ErrorSignature signature = signature_of(
            named.camera_error({fmt::format("calibration, direction {}", deviation.size() - i), "1",
                                small,
                                [&](CameraModel& c, double by) {
                                    set_parameters(c, stated, values + by * step);
                                }}),
            linear, chain.poses.size());
        for (Eigen::VectorXd* field :
             {&signature.before, &signature.after, &signature.rotation_after})
            *field /= small;
        signature.size = 1.0;
        signatures.push_back(std::move(signature));
    }
    return signatures;
}

}  // namespace etalon
