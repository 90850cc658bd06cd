#include "compare/verdict/error_signatures.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>

#include "calib/intrinsics/calibration_model.h"
#include "core/errors.h"

namespace etalon {
double rms_norm(const Eigen::VectorXd& field) {
    return std::sqrt(3.0 * field.squaredNorm() / static_cast<double>(field.size()));
}

double max_norm(const Eigen::VectorXd& field) {
    return std::sqrt(field.reshaped(3, field.size() / 3).colwise().squaredNorm().maxCoeff());
}

namespace {

using Points = std::vector<Eigen::Vector3d>;

constexpr double confounded_cosine = 0.95;
constexpr double vanished = 1e-6;          // of the field before registration
constexpr double detection_sigmas = 3.29;  // 1.645 (5 % test) + 1.645 (95 % power)

// What a named error does to the corners: the pixels of pose i when the error has `size`.
struct NamedError {
    std::string name, unit;
    double size;
    std::function<Eigen::VectorXd(std::size_t pose, double size)> pixels;
    bool one_sided = false;  // only `size` and 0 can be asked for (stage errors come at one size)
};

Eigen::VectorXd projected(const Projector& projector, const Points& points,
                          const Rigid& camera_from_marker) {
    Eigen::VectorXd pixels(2 * points.size());
    for (std::size_t k = 0; k < points.size(); ++k) {
        const auto pixel = projector.project(camera_from_marker * points[k]);
        if (!pixel)
            throw NumericalError("error signatures: a marker point has no projection");
        pixels.segment<2>(static_cast<Eigen::Index>(2 * k)) = *pixel;
    }
    return pixels;
}

Eigen::VectorXd moved_inwards(const Eigen::VectorXd& square, double by_px) {
    std::vector<Eigen::Vector2d> corners;
    for (int k = 0; k < 4; ++k)
        corners.push_back(square.segment<2>(2 * k));
    Eigen::VectorXd moved(8);
    Eigen::Index k = 0;
    for (const Eigen::Vector2d& corner : edges_moved_inwards(corners, by_px))
        moved.segment<2>(2 * k++) = corner;
    return moved;
}

// ------------------------------------------------------------------------------- the named errors

class NamedErrors {
public:
    explicit NamedErrors(const SignatureChain& chain) : chain_(chain) {
        for (const Pose& pose : chain.poses)
            truth_.push_back(chain.camera_from_base * pose.base_from_carriage *
                             chain.carriage_from_marker);
    }

    std::vector<NamedError> all(std::span<const StageError> stage_errors) const {
        std::vector<NamedError> errors = camera_errors();
        for (NamedError& error : marker_errors())
            errors.push_back(std::move(error));
        for (const StageError& error : stage_errors)
            errors.push_back(stage_error(error));
        return errors;
    }

    NamedError camera_error(const CameraError& error) const {
        const auto changed = [&](double by) {
            CameraModel camera = chain_.projector.camera();
            error.change(camera, by);
            return std::make_shared<const Projector>(camera);
        };
        const auto plus = changed(error.size), minus = changed(-error.size);
        return {error.name, error.unit, error.size,
                [this, plus, minus](std::size_t pose, double by) {
                    return projected(by > 0.0 ? *plus : *minus, chain_.points_mm, truth_[pose]);
                }};
    }

private:
    std::vector<NamedError> camera_errors() const {
        std::vector<NamedError> errors;
        for (const CameraError& error : named_camera_errors())
            errors.push_back(camera_error(error));
        return errors;
    }

    std::vector<NamedError> marker_errors() const {
        std::vector<NamedError> errors;
        errors.push_back({"marker print size", "1", 1e-3, [this](std::size_t pose, double by) {
                              Points points = chain_.points_mm;
                              for (Eigen::Vector3d& point : points)
                                  point *= 1.0 + by;
                              return projected(chain_.projector, points, truth_[pose]);
                          }});
        errors.push_back({"half pixel", "px", 0.5, [this](std::size_t pose, double by) {
                              return Eigen::VectorXd(nominal(pose).array() + by);
                          }});
        if (chain_.points_mm.size() == 4)  // the corners of a square; a chessboard's do not move
            errors.push_back({"edge shrink", "px", 0.1, [this](std::size_t pose, double by) {
                                  return moved_inwards(nominal(pose), by);
                              }});
        errors.push_back(
            out_of_plane("marker twist", [](const Eigen::Vector3d& p) { return p.x() * p.y(); }));
        if (chain_.points_mm.size() != 4)  // a bow lifts the corners of a square all alike
            errors.push_back(out_of_plane(
                "marker bow", [](const Eigen::Vector3d& p) { return p.head<2>().squaredNorm(); }));
        errors.push_back({"constant pose offset", "mm", 0.1, [this](std::size_t pose, double by) {
                              Rigid moved = truth_[pose];
                              moved.translation += by * pose_offset_direction();
                              return projected(chain_.projector, chain_.points_mm, moved);
                          }});
        return errors;
    }

    // The marker's points stand out of its plane by `shape`, scaled to the size at the highest one.
    NamedError out_of_plane(std::string name,
                            const std::function<double(const Eigen::Vector3d&)>& shape) const {
        double highest = 0.0;
        for (const Eigen::Vector3d& point : chain_.points_mm)
            highest = std::max(highest, std::abs(shape(point)));
        Points lifted;
        for (const Eigen::Vector3d& point : chain_.points_mm)
            lifted.emplace_back(0.0, 0.0, highest > 0.0 ? shape(point) / highest : 0.0);
        return {std::move(name), "mm", 0.1, [this, lifted](std::size_t pose, double by) {
                    Points points = chain_.points_mm;
                    for (std::size_t k = 0; k < points.size(); ++k)
                        points[k] += by * lifted[k];
                    return projected(chain_.projector, points, truth_[pose]);
                }};
    }

    NamedError stage_error(const StageError& error) const {
        if (error.base_from_carriage.size() != truth_.size() || !std::isfinite(error.size) ||
            error.size == 0.0)
            throw NumericalError(fmt::format(
                "error signatures: '{}' needs a size and one transform per pose", error.name));
        const auto moved = [this, transforms = error.base_from_carriage](std::size_t pose,
                                                                         double by) {
            return by == 0.0 ? nominal(pose)
                             : projected(chain_.projector, chain_.points_mm,
                                         chain_.camera_from_base * transforms[pose] *
                                             chain_.carriage_from_marker);
        };
        return {error.name, error.unit, error.size, moved, true};
    }

    Eigen::VectorXd nominal(std::size_t pose) const {
        return projected(chain_.projector, chain_.points_mm, truth_[pose]);
    }

    const SignatureChain& chain_;
    std::vector<Rigid> truth_;  // camera_from_marker per pose, without any error
};

// --------------------------------------------------------------------- poses and registration

// The chain to first order: from corner displacements to pose errors and to X, Y.
class LinearChain {
public:
    explicit LinearChain(const SignatureChain& chain) : chain_(chain) {
        const auto rows = static_cast<Eigen::Index>(2 * chain.points_mm.size());
        Eigen::MatrixXd training(0, 12);
        for (std::size_t i = 0; i < chain.poses.size(); ++i) {
            pose_solvers_.emplace_back(pose_jacobian(i));
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
        const Eigen::VectorXd solution =
            registration_.solve(Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(
                training.data(), static_cast<Eigen::Index>(training.size()))));
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
        signature.before = Eigen::Map<Eigen::VectorXd>(before.data(), std::ssize(before));
        signature.after = Eigen::Map<Eigen::VectorXd>(after.data(), std::ssize(after));
        signature.rotation_after =
            Eigen::Map<Eigen::VectorXd>(rotation.data(), std::ssize(rotation));
    }

private:
    // d pixels / d left perturbation of camera_from_marker.
    Eigen::MatrixXd pose_jacobian(std::size_t i) const {
        const Rigid camera_from_carriage =
            chain_.camera_from_base * chain_.poses[i].base_from_carriage;
        return registration_jacobian(chain_.projector, chain_.points_mm,
                                     camera_from_carriage * chain_.carriage_from_marker, Rigid{},
                                     Rigid{})
            .leftCols<6>();
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
        const Eigen::Vector3d sight = (chain.camera_from_base * chain.poses[i].base_from_carriage *
                                       chain.carriage_from_marker)
                                          .translation.normalized();
        const Eigen::Vector3d error = field.segment<3>(3 * k);
        const double along = sight.dot(error);
        const auto n = static_cast<std::size_t>(k);
        sum += std::pow(along / noise.along_mm[n], 2) +
               (error - along * sight).squaredNorm() / std::pow(noise.across_mm[n], 2);
        ++k;
    }
    return sum;
}

void judge_observability(const SignatureChain& chain, const HoldOutNoise& noise,
                         double limit_rms_mm, ErrorSignature& signature) {
    signature.before_rms_mm = rms_norm(signature.before);
    signature.before_max_mm = max_norm(signature.before);
    signature.after_rms_mm = rms_norm(signature.after);
    signature.after_max_mm = max_norm(signature.after);
    signature.detectable_size = std::numeric_limits<double>::infinity();
    if (signature.after_rms_mm <= vanished * signature.before_rms_mm) {
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

bool has_vanished(const ErrorSignature& signature) {
    return signature.after_rms_mm <= vanished * signature.before_rms_mm;
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
        static_cast<std::size_t>(std::ranges::count(chain.poses, true, &Pose::hold_out));
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
    for (std::size_t i = 0; i < poses; ++i) {
        const Eigen::VectorXd plus = error.pixels(i, error.size);
        displacement.push_back(error.one_sided
                                   ? Eigen::VectorXd(plus - error.pixels(i, 0.0))
                                   : Eigen::VectorXd(0.5 * (plus - error.pixels(i, -error.size))));
    }
    linear.propagate(displacement, signature);
    return signature;
}

}  // namespace

std::vector<CameraError> named_camera_errors() {
    using Camera = CameraModel;
    return {
        {"focal length", "1", 1e-3,
         [](Camera& c, double by) {
             c.intrinsics.fx *= 1.0 + by;
             c.intrinsics.fy *= 1.0 + by;
         }},
        {"c_x", "px", 0.1, [](Camera& c, double by) { c.intrinsics.cx += by; }},
        {"c_y", "px", 0.1, [](Camera& c, double by) { c.intrinsics.cy += by; }},
        {"k1", "", 1e-3, [](Camera& c, double by) { c.distortion.k1 += by; }},
        {"k2", "", 1e-3, [](Camera& c, double by) { c.distortion.k2 += by; }},
        {"k3", "", 1e-3, [](Camera& c, double by) { c.distortion.k3 += by; }},
        {"p1", "", 1e-4, [](Camera& c, double by) { c.distortion.p1 += by; }},
        {"p2", "", 1e-4, [](Camera& c, double by) { c.distortion.p2 += by; }},
    };
}

std::vector<Eigen::Vector2d> edges_moved_inwards(const std::vector<Eigen::Vector2d>& corners,
                                                 double by_px) {
    if (corners.size() != 4)
        throw NumericalError(fmt::format("edges of a square: {} corners", corners.size()));
    const auto corner = [&](std::size_t k) { return corners[k % 4]; };
    const Eigen::Vector2d centre = (corner(0) + corner(1) + corner(2) + corner(3)) / 4.0;
    const auto inward_normal = [&](std::size_t k) {
        const Eigen::Vector2d edge = (corner(k + 1) - corner(k)).normalized();
        const Eigen::Vector2d normal(-edge.y(), edge.x());
        return Eigen::Vector2d(normal.dot(centre - corner(k)) < 0.0 ? -normal : normal);
    };
    std::vector<Eigen::Vector2d> moved;
    for (std::size_t k = 0; k < 4; ++k) {
        Eigen::Matrix2d normals;
        normals << inward_normal(k + 3).transpose(), inward_normal(k).transpose();
        moved.push_back(corner(k) + normals.inverse() * Eigen::Vector2d(by_px, by_px));
    }
    return moved;
}

Eigen::Vector3d pose_offset_direction() {
    return Eigen::Vector3d(2, -3, 6) / 7.0;
}

std::vector<ErrorSignature> error_signatures(const SignatureChain& chain,
                                             std::span<const StageError> stage_errors,
                                             std::span<const std::size_t> linear_scale,
                                             const HoldOutNoise& noise, double limit_rms_mm) {
    require_usable(chain, stage_errors, linear_scale, noise);
    const LinearChain linear(chain);
    const NamedErrors named(chain);
    std::vector<ErrorSignature> signatures;
    for (const NamedError& error : named.all(stage_errors))
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

std::optional<Explanation> explain(const Eigen::VectorXd& observed,
                                   std::span<const ErrorSignature> signatures) {
    const ErrorSignature* best = nullptr;
    double best_cosine = 0.0;
    for (const ErrorSignature& signature : signatures) {
        if (has_vanished(signature) || signature.after.size() != observed.size())
            continue;
        const double c = cosine(observed, signature.after);
        if (std::abs(c) > std::abs(best_cosine)) {
            best = &signature;
            best_cosine = c;
        }
    }
    if (!best || best_cosine * best_cosine < 0.5)
        return std::nullopt;
    Explanation explanation;
    explanation.group = {best->name};
    // Suspects are those that look like the best one, and those that fit nearly as well as it.
    for (const ErrorSignature& signature : signatures) {
        const auto& like_best = best->confounded_with;
        const bool confounded =
            std::find(like_best.begin(), like_best.end(), signature.name) != like_best.end();
        const bool fits = !has_vanished(signature) && std::abs(cosine(observed, signature.after)) >
                                                          confounded_cosine * std::abs(best_cosine);
        if (&signature != best && (confounded || fits))
            explanation.group.push_back(signature.name);
    }
    explanation.cosine = std::abs(best_cosine);
    explanation.size = best->size * observed.dot(best->after) / best->after.squaredNorm();
    explanation.unit = best->unit;
    explanation.text = fmt::format("{}", fmt::join(explanation.group, " ~ "));
    return explanation;
}

}  // namespace etalon
