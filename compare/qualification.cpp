#include "compare/qualification.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/errors.h"

namespace etalon {
namespace {

constexpr double coverage_factor = 2.0;
constexpr const char* rms_name = "b3_position_field_rms_mm";
constexpr const char* max_name = "b3_position_field_max_mm";
constexpr const char* rotation_rms_name = "b3_rotation_field_rms_mrad";
constexpr const char* rotation_max_name = "b3_rotation_field_max_mrad";

void require_usable(const QualificationInput& input) {
    if (!input.camera || !input.render_and_detect)
        throw NumericalError("qualification: a camera and a way to render are needed");
    for (const QualificationPose& pose : input.poses) {
        if (!vector_from_rigid(pose.base_from_carriage).allFinite())
            throw NumericalError("qualification: a stage position is not finite");
        if (!pose.corners)
            continue;
        if (pose.corners->size() != input.points_mm.size())
            throw NumericalError(fmt::format("qualification: {} corners for a marker of {} points",
                                             pose.corners->size(), input.points_mm.size()));
        for (const Eigen::Vector2d& corner : *pose.corners)
            if (!corner.allFinite())
                throw NumericalError("qualification: a corner is not finite");
    }
}

void count_detections(const QualificationInput& input, Qualification& result) {
    for (const QualificationPose& pose : input.poses) {
        QualifiedPose qualified;
        qualified.hold_out = pose.hold_out;
        qualified.detected = pose.corners.has_value();
        DetectionCounts& counts = result.detection;
        (pose.hold_out ? counts.hold_out : counts.training) += 1;
        if (qualified.detected)
            (pose.hold_out ? counts.hold_out_detected : counts.training_detected) += 1;
        result.poses.push_back(std::move(qualified));
    }
    if (result.detection.rate() < 1.0)
        result.reasons.push_back(fmt::format("the marker was detected in {:.1f} % of the poses",
                                             100.0 * result.detection.rate()));
}

// Limits in the documented order; the rotation's only where the limits file has them.
std::vector<JudgedQuantity> unjudged(const Limits& limits) {
    std::vector<JudgedQuantity> quantities;
    const auto add = [&](const char* name, const char* unit, double limit) {
        JudgedQuantity quantity;
        quantity.name = name;
        quantity.unit = unit;
        quantity.limit = limit;
        quantities.push_back(quantity);
    };
    add(rms_name, "mm", limits.b3_position_field_rms_mm);
    add(max_name, "mm", limits.b3_position_field_max_mm);
    if (limits.b3_rotation_field_rms_mrad)
        add(rotation_rms_name, "mrad", *limits.b3_rotation_field_rms_mrad);
    if (limits.b3_rotation_field_max_mrad)
        add(rotation_max_name, "mrad", *limits.b3_rotation_field_max_mrad);
    return quantities;
}

Qualification skipped(Qualification result, const std::string& reason) {
    for (JudgedQuantity& quantity : result.quantities) {
        quantity.outcome = Outcome::skipped;
        quantity.reason = reason;
    }
    result.reasons.push_back(reason);
    result.verdict = combine(result.quantities);
    return result;
}

// --------------------------------------------------------------------------- poses and biases

// Registers on the training poses with a pose estimate; false when there are too few of them.
bool registered(const QualificationInput& input, const Projector& projector,
                Qualification& result) {
    std::vector<RegistrationPose> training;
    std::vector<std::size_t> indices;
    for (std::size_t i = 0; i < input.poses.size(); ++i) {
        const QualificationPose& pose = input.poses[i];
        if (pose.hold_out || !pose.corners)
            continue;
        const auto estimate = estimate_pose(projector, input.points_mm, *pose.corners);
        if (!estimate)
            continue;
        training.push_back({pose.base_from_carriage, estimate->camera_from_marker, *pose.corners});
        indices.push_back(i);
    }
    if (std::ssize(training) < min_training_poses)
        return false;
    result.registration =
        register_bias_corrected(projector, input.points_mm, training,
                                input.nominal_carriage_from_marker, input.render_and_detect);
    for (std::size_t& used : result.registration->used) {
        used = indices[used];
        result.poses[used].used = true;
    }
    return std::ssize(result.registration->used) >= min_training_poses;
}

// Biases of all poses; only hold-out poses are rendered. Returns how many hold-out poses have B3.
int find_biases(const QualificationInput& input, const Projector& projector,
                Qualification& result) {
    int usable = 0;
    for (std::size_t i = 0; i < input.poses.size(); ++i) {
        const QualificationPose& pose = input.poses[i];
        const Rigid predicted =
            result.registration->registration.camera_from_marker(pose.base_from_carriage);
        std::optional<std::vector<Eigen::Vector2d>> rendered;
        if (pose.hold_out)
            rendered = input.render_and_detect(predicted);
        QualifiedPose& qualified = result.poses[i];
        qualified.bias = pose_bias(projector, input.points_mm, predicted, pose.corners, rendered);
        if (pose.hold_out) {
            qualified.used = qualified.bias.b3.has_value();
            usable += qualified.used ? 1 : 0;
        }
    }
    return usable;
}

// ------------------------------------------------------------------------------------ fields

double deviation_along(const Eigen::Matrix3d& covariance, const Eigen::Vector3d& axis) {
    return std::sqrt(axis.dot(covariance * axis));
}

double deviation_across(const Eigen::Matrix3d& covariance, const Eigen::Vector3d& axis) {
    return std::sqrt(0.5 * std::max(0.0, covariance.trace() - axis.dot(covariance * axis)));
}

FieldSample sample_of(const PoseBias& bias, bool rotation) {
    FieldSample sample;
    sample.position_mm = bias.predicted.translation;
    const Matrix6d& covariance = bias.photo->covariance_per_px2;
    Eigen::Matrix3d block;
    if (rotation) {
        sample.error = bias.predicted.rotation * bias.b3->rotation_rad;
        sample.axis = bias.predicted.rotation * Eigen::Vector3d::UnitZ();
        block = covariance.topLeftCorner<3, 3>();
    } else {
        sample.error = bias.b3->translation_mm;
        sample.axis = bias.predicted.translation.normalized();
        block = covariance.bottomRightCorner<3, 3>();
    }
    sample.sigma_along = deviation_along(block, sample.axis);
    sample.sigma_across = deviation_across(block, sample.axis);
    return sample;
}

std::vector<FieldSample> samples_of(const Qualification& result, bool rotation) {
    std::vector<FieldSample> samples;
    for (const QualifiedPose& pose : result.poses)
        if (pose.hold_out && pose.used)
            samples.push_back(sample_of(pose.bias, rotation));
    return samples;
}

void fit_fields(const QualificationInput& input, Qualification& result) {
    std::vector<Eigen::Vector3d> volume;
    for (const QualifiedPose& pose : result.poses)
        volume.push_back(pose.bias.predicted.translation);
    result.position_field = fit_smooth_field(samples_of(result, false), FieldBasis::position);
    result.position_summary = summarize(*result.position_field, volume, input.seed);
    result.rotation_field = fit_smooth_field(samples_of(result, true), FieldBasis::linear);
    result.rotation_summary = summarize(*result.rotation_field, volume, input.seed);
}

// -------------------------------------------------------------------------------- signatures

// Those that are known already, where they are of as many hold-out poses.
bool take_known_signatures(const QualificationInput& input, Qualification& result) {
    if (!input.known_signatures || input.known_signatures->empty())
        return false;
    const auto used = std::count_if(result.poses.begin(), result.poses.end(),
                                    [](const QualifiedPose& p) { return p.hold_out && p.used; });
    if (input.known_signatures->front().after.size() != 3 * used)
        return false;
    result.signatures = *input.known_signatures;
    return true;
}

void find_signatures(const QualificationInput& input, const Projector& projector,
                     Qualification& result) {
    if (take_known_signatures(input, result))
        return;
    const Registration& registration = result.registration->registration;
    SignatureChain chain{projector,
                         input.points_mm,
                         registration.camera_from_base,
                         registration.carriage_from_marker,
                         {},
                         {}};
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < result.poses.size(); ++i) {
        if (!result.poses[i].used)
            continue;
        kept.push_back(i);
        chain.base_from_carriage.push_back(input.poses[i].base_from_carriage);
        chain.hold_out.push_back(input.poses[i].hold_out);
    }
    std::vector<StageError> errors;
    std::vector<std::size_t> linear_scale;
    for (const DeclaredStageTerm& term : input.stage_terms) {
        if (term.error.base_from_carriage.size() != input.poses.size())
            throw NumericalError(fmt::format("qualification: '{}' has {} transforms for {} poses",
                                             term.error.name, term.error.base_from_carriage.size(),
                                             input.poses.size()));
        if (term.is_linear_scale)
            linear_scale.push_back(errors.size());
        errors.push_back({term.error.name, term.error.unit, term.error.size, {}});
        for (const std::size_t i : kept)
            errors.back().base_from_carriage.push_back(term.error.base_from_carriage[i]);
    }
    HoldOutNoise noise;
    for (const FieldSample& sample : samples_of(result, false)) {
        noise.along_mm.push_back(result.position_field->scale_along * sample.sigma_along);
        noise.across_mm.push_back(result.position_field->scale_across * sample.sigma_across);
    }
    result.signatures =
        error_signatures(chain, errors, linear_scale, noise, input.limits.b3_position_field_rms_mm);
}

// ------------------------------------------------------------------------------------ budget

BudgetRow noise_row(const Qualification& result) {
    const SmoothField& field = *result.position_field;
    const FieldSummary& summary = result.position_summary;
    return {"image noise",
            field.residual_along,
            "mm",
            summary.rms_uncertainty / coverage_factor,
            summary.max_uncertainty / coverage_factor,
            fmt::format("residuals of {} hold-out poses along the line of sight, {} degrees of "
                        "freedom",
                        field.samples, field.degrees_of_freedom)};
}

// What the registration's own covariance does to the predicted positions of all poses.
BudgetRow registration_row(const QualificationInput& input, const Qualification& result) {
    const Registration& registration = result.registration->registration;
    double sum = 0.0, largest = 0.0;
    for (const QualificationPose& pose : input.poses) {
        const Eigen::Matrix3d turn =
            (registration.camera_from_base.rotation * pose.base_from_carriage.rotation)
                .toRotationMatrix();
        const Eigen::Vector3d arm =
            registration.camera_from_base.rotation *
            (pose.base_from_carriage * registration.carriage_from_marker.translation);
        Eigen::Matrix<double, 3, 12> shift = Eigen::Matrix<double, 3, 12>::Zero();
        for (int k = 0; k < 3; ++k)
            shift.col(k) = Eigen::Vector3d::Unit(k).cross(arm);
        shift.middleCols<3>(3).setIdentity();
        shift.rightCols<3>() = turn;
        const double variance = (shift * registration.covariance * shift.transpose()).trace() *
                                std::pow(registration.residual_rms_px, 2);
        sum += variance / static_cast<double>(input.poses.size());
        largest = std::max(largest, variance);
    }
    return {"registration",
            registration.residual_rms_px,
            "px",
            std::sqrt(sum),
            std::sqrt(largest),
            fmt::format("corner residuals of {} training poses", result.registration->used.size())};
}

// A declared uncertainty through the signature of its error.
BudgetRow declared_row(const std::string& source, const std::string& unit,
                       const std::optional<double>& uncertainty,
                       std::span<const ErrorSignature> signatures) {
    BudgetRow row;
    row.source = source;
    row.unit = unit;
    row.standard_uncertainty = uncertainty;
    row.basis =
        uncertainty ? "declared by the station" : "unknown: the station does not declare it";
    if (!uncertainty)
        return row;
    if (!std::isfinite(*uncertainty) || *uncertainty < 0.0)
        throw NumericalError(
            fmt::format("qualification: the uncertainty of '{}' is {}", source, *uncertainty));
    const auto signature = std::find_if(signatures.begin(), signatures.end(),
                                        [&](const ErrorSignature& s) { return s.name == source; });
    if (signature == signatures.end())
        throw NumericalError(fmt::format("qualification: '{}' has no signature", source));
    const double share = *uncertainty / std::abs(signature->size);
    row.rms_contribution_mm = share * signature->after_rms_mm;
    row.max_contribution_mm = share * signature->after_max_mm;
    return row;
}

// Random stage errors: as independent noise on every hold-out pose. Part of the residuals too; kept
// because a few poses may show less than was declared.
BudgetRow repeatability_row(const DeclaredRepeatability& declared, const SmoothField& field) {
    BudgetRow row;
    row.source = "stage repeatability " + declared.axis;
    row.unit = "mm";
    row.standard_uncertainty = declared.marker_mm;
    row.basis =
        declared.marker_mm ? "declared by the station" : "unknown: the station does not declare it";
    if (!declared.marker_mm)
        return row;
    if (!std::isfinite(*declared.marker_mm) || *declared.marker_mm < 0.0)
        throw NumericalError(fmt::format("qualification: the repeatability of '{}' is {}",
                                         declared.axis, *declared.marker_mm));
    const double samples = field.samples;
    const double coefficients = static_cast<double>(field.coefficients.size()) / 3.0;
    row.rms_contribution_mm = *declared.marker_mm / std::sqrt(samples);
    row.max_contribution_mm = *declared.marker_mm * std::sqrt(coefficients / samples);
    return row;
}

BudgetRow error_map_row(const DeclaredErrorMap& map) {
    BudgetRow row;
    row.source = "stage error map " + map.axis;
    row.unit = "mm";
    row.standard_uncertainty = row.rms_contribution_mm = map.marker_rms_mm;
    row.max_contribution_mm = map.marker_max_mm;
    row.basis = "the map's own uncertainties";
    return row;
}

void fill_budget(const QualificationInput& input, Qualification& result) {
    result.budget = {noise_row(result), registration_row(input, result)};
    for (const DeclaredStageTerm& term : input.stage_terms)
        if (term.in_budget)
            result.budget.push_back(declared_row(term.error.name, term.error.unit,
                                                 term.standard_uncertainty, result.signatures));
    for (const DeclaredRepeatability& declared : input.repeatability)
        result.budget.push_back(repeatability_row(declared, *result.position_field));
    for (const DeclaredErrorMap& map : input.error_maps)
        result.budget.push_back(error_map_row(map));
    result.budget.push_back(
        declared_row("marker print size", "1", input.marker_size_uncertainty, result.signatures));
    result.budget_complete = true;
    for (const BudgetRow& row : result.budget)
        if (!row.standard_uncertainty) {
            result.budget_complete = false;
            result.reasons.push_back("the uncertainty of '" + row.source + "' is unknown");
        }
}

double expanded(const Qualification& result, std::optional<double> BudgetRow::*contribution) {
    double sum = 0.0;
    for (const BudgetRow& row : result.budget)
        sum += std::pow((row.*contribution).value_or(0.0), 2);
    return coverage_factor * std::sqrt(sum);
}

// ----------------------------------------------------------------------------------- verdict

void judge(JudgedQuantity& quantity, double value, double expanded_uncertainty, bool complete) {
    quantity.value = value;
    quantity.expanded_uncertainty = expanded_uncertainty;
    quantity.outcome = decide(value, expanded_uncertainty, quantity.limit);
    if (quantity.outcome == Outcome::inconclusive)
        quantity.reason = "the limit lies within the uncertainty of the value";
    if (quantity.outcome == Outcome::pass && !complete) {
        quantity.outcome = Outcome::inconclusive;
        quantity.reason = "a term of the uncertainty budget is unknown";
    }
}

void judge_all(Qualification& result) {
    constexpr double mrad = 1000.0;
    for (JudgedQuantity& quantity : result.quantities) {
        const FieldSummary& position = result.position_summary;
        const FieldSummary& rotation = result.rotation_summary;
        if (quantity.name == rms_name)
            judge(quantity, position.rms, expanded(result, &BudgetRow::rms_contribution_mm),
                  result.budget_complete);
        else if (quantity.name == max_name)
            judge(quantity, position.max, expanded(result, &BudgetRow::max_contribution_mm),
                  result.budget_complete);
        else if (quantity.name == rotation_rms_name)
            judge(quantity, mrad * rotation.rms, mrad * rotation.rms_uncertainty,
                  result.budget_complete);
        else
            judge(quantity, mrad * rotation.max, mrad * rotation.max_uncertainty,
                  result.budget_complete);
    }
    result.verdict = combine(result.quantities);
}

void explain_verdict(Qualification& result) {
    if (result.verdict == Outcome::pass)
        return;
    for (const JudgedQuantity& quantity : result.quantities)
        if (quantity.outcome != Outcome::pass)
            result.reasons.push_back(fmt::format(
                "{} is {:.4f} {} with U = {:.4f} {}, limit {:.4f} {}: {}", quantity.name,
                quantity.value, quantity.unit, quantity.expanded_uncertainty, quantity.unit,
                quantity.limit, quantity.unit, name(quantity.outcome)));
    std::vector<double> observed;
    for (const QualifiedPose& pose : result.poses)
        if (pose.hold_out && pose.used) {
            const Eigen::Vector3d field =
                result.position_field->at(pose.bias.predicted.translation);
            observed.insert(observed.end(), field.begin(), field.end());
        }
    result.explanation =
        explain(Eigen::Map<const Eigen::VectorXd>(observed.data(), std::ssize(observed)),
                result.signatures);
    if (result.explanation)
        result.reasons.push_back(fmt::format("the field looks like {} (|cosine| {:.3f})",
                                             result.explanation->text, result.explanation->cosine));
}

}  // namespace

double DetectionCounts::rate() const {
    const int all = training + hold_out;
    return all > 0 ? static_cast<double>(training_detected + hold_out_detected) / all : 0.0;
}

Qualification qualify(const QualificationInput& input) {
    require_usable(input);
    const Projector projector(*input.camera);
    Qualification result;
    result.quantities = unjudged(input.limits);
    count_detections(input, result);
    const std::string too_few = fmt::format(
        "too few poses with a detected marker: {} training (at least {}), {} hold-out (at least "
        "{})",
        result.detection.training_detected, min_training_poses, result.detection.hold_out_detected,
        min_hold_out_poses);
    if (result.detection.training_detected < min_training_poses ||
        result.detection.hold_out_detected < min_hold_out_poses ||
        !registered(input, projector, result))
        return skipped(std::move(result), too_few);
    if (find_biases(input, projector, result) < min_hold_out_poses)
        return skipped(std::move(result),
                       "too few hold-out poses whose render is detected as well");
    fit_fields(input, result);
    find_signatures(input, projector, result);
    fill_budget(input, result);
    judge_all(result);
    explain_verdict(result);
    return result;
}

}  // namespace etalon
