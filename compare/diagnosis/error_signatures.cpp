#include "compare/diagnosis/error_signatures.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <limits>

#include "calib/intrinsics/calibration_model.h"

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

// The chain to first order: from corner displacements to pose errors and to X, Y.
class LinearChain {
public:
    explicit LinearChain(const SignatureChain& chain) : chain_(chain) {
        const auto rows = static_cast<Eigen::Index>(2 * chain.points_mm.size());
        Eigen::MatrixXd training(
            rows * std::ranges::count(chain.poses, false, &AnalysedPose::hold_out), 12);
        for (std::size_t i = 0; i < chain.poses.size(); ++i) {
            if (chain.poses[i].hold_out) {
                hold_out_.emplace_back(i, PoseSolver(chain.pose_jacobian(i)));
                continue;
            }
            training.middleRows(std::ssize(training_rows_), rows) = registration_jacobian(
                chain.projector, chain.points_mm, chain.camera_from_base,
                chain.poses[i].base_from_carriage, chain.carriage_from_marker);
            for (Eigen::Index row = 0; row < rows; ++row)
                training_rows_.push_back(static_cast<Eigen::Index>(i) * rows + row);
        }
        unscale_ = training.colwise().norm().cwiseInverse();
        // The predicted poses do not depend on the freedoms: the shortest solution will do.
        registration_.setThreshold(1e-9);
        registration_.compute(training * unscale_.asDiagonal());
    }

    // Position errors of the hold-out poses before and after registration, from the motion of all
    // corners.
    void propagate(const Eigen::VectorXd& motion, ErrorSignature& signature) const {
        const Eigen::VectorXd solution =
            registration_.solve(Eigen::VectorXd(motion(training_rows_)));
        const Vector12d xy = unscale_.cwiseProduct(solution);
        const auto rows = static_cast<Eigen::Index>(2 * chain_.points_mm.size());
        signature.before.resize(3 * std::ssize(hold_out_));
        signature.after = signature.rotation_after = signature.before;
        for (Eigen::Index k = 0; k < std::ssize(hold_out_); ++k) {
            const auto& [pose, solver] = hold_out_[static_cast<std::size_t>(k)];
            const Vector6d seen = solver.solve(
                Eigen::VectorXd(motion.segment(static_cast<Eigen::Index>(pose) * rows, rows)));
            // What X and Y moved by `xy` do to the marker, camera frame.
            const Rigid& base_from_carriage = chain_.poses[pose].base_from_carriage;
            const Eigen::Quaterniond& turn = chain_.camera_from_base.rotation;
            const Eigen::Vector3d from_base =
                turn * (base_from_carriage * chain_.carriage_from_marker.translation);
            const Eigen::Vector3d shift =
                Eigen::Vector3d(xy.head<3>()).cross(from_base) + xy.segment<3>(3) +
                turn * (base_from_carriage.rotation * Eigen::Vector3d(xy.tail<3>()));
            const Eigen::Vector3d turned =
                xy.head<3>() +
                turn * (base_from_carriage.rotation * Eigen::Vector3d(xy.segment<3>(6)));
            signature.before.segment<3>(3 * k) = seen.tail<3>();
            signature.after.segment<3>(3 * k) = seen.tail<3>() - shift;
            signature.rotation_after.segment<3>(3 * k) = seen.head<3>() - turned;
        }
    }

private:
    using PoseSolver = Eigen::ColPivHouseholderQR<Eigen::MatrixXd>;

    const SignatureChain& chain_;
    std::vector<std::pair<std::size_t, PoseSolver>> hold_out_;
    std::vector<Eigen::Index> training_rows_;
    Vector12d unscale_;
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> registration_;
};

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

// Nothing of less than two linear axes.
std::optional<ErrorSignature> isotropic_scale(std::span<const ErrorSignature> stage,
                                              std::span<const StageError> stage_errors) {
    ErrorSignature sum{"stage scale, all linear axes", "1", 1e-3};
    int axes = 0;
    for (std::size_t i = 0; i < stage.size(); ++i) {
        if (!stage_errors[i].is_linear_scale)
            continue;
        const ErrorSignature& one = stage[i];
        const double ratio = sum.size / one.size;
        if (axes++ == 0)
            sum.before = sum.after = sum.rotation_after = Eigen::VectorXd::Zero(one.after.size());
        sum.before += ratio * one.before;
        sum.after += ratio * one.after;
        sum.rotation_after += ratio * one.rotation_after;
    }
    return axes < 2 ? std::nullopt : std::optional(sum);
}

void require_usable(const SignatureChain& chain, const HoldOutNoise& noise) {
    const auto hold_out =
        static_cast<std::size_t>(std::ranges::count(chain.poses, true, &AnalysedPose::hold_out));
    bool usable = hold_out > 0 && hold_out < chain.poses.size() &&
                  noise.along_mm.size() == hold_out && noise.across_mm.size() == hold_out &&
                  chain.points_mm.size() >= 3;
    for (const auto* levels : {&noise.along_mm, &noise.across_mm})
        for (const double level : *levels)
            usable = usable && std::isfinite(level) && level > 0.0;
    if (!usable)
        throw NumericalError("error signatures: poses, split and noise levels do not agree");
}

ErrorSignature signature_of(const NamedError& error, const LinearChain& linear, std::size_t poses) {
    ErrorSignature signature{error.name, error.unit, error.size};
    linear.propagate(error.motion(poses), signature);
    return signature;
}

}  // namespace

std::vector<ErrorSignature> error_signatures(const SignatureChain& chain,
                                             std::span<const StageError> stage_errors,
                                             const HoldOutNoise& noise, double limit_rms_mm) {
    require_usable(chain, noise);
    const LinearChain linear(chain);
    std::vector<ErrorSignature> signatures;
    for (const NamedError& error : named_errors(chain, stage_errors))
        signatures.push_back(signature_of(error, linear, chain.poses.size()));
    const auto stage = std::span(signatures).last(stage_errors.size());
    if (auto all_axes = isotropic_scale(stage, stage_errors))
        signatures.push_back(*std::move(all_axes));
    for (ErrorSignature& signature : signatures)
        judge_observability(chain, noise, limit_rms_mm, signature);
    find_confounded(signatures);
    return signatures;
}

Eigen::MatrixXd fields_after_registration(const SignatureChain& chain,
                                          const Eigen::MatrixXd& corners_px) {
    const LinearChain linear(chain);
    Eigen::MatrixXd fields;
    for (const auto& column : corners_px.colwise()) {
        ErrorSignature signature;
        linear.propagate(column, signature);
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
    std::vector<ErrorSignature> signatures;
    for (Eigen::Index i = deviation.size() - 1; i >= 0; --i) {
        const Eigen::VectorXd step = std::sqrt(std::max(0.0, eigen.eigenvalues()[i])) *
                                     deviation.cwiseProduct(eigen.eigenvectors().col(i));
        if (step.isZero(0.0))
            continue;
        ErrorSignature signature = signature_of(
            named_error(chain,
                        CameraError{fmt::format("calibration, direction {}", deviation.size() - i),
                                    "1", small,
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
