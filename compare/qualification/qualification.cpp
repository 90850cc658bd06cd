#include "compare/qualification/qualification.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "calib/registration/stage_motion.h"
#include "compare/diagnosis/outlier_poses.h"
#include "compare/qualification/diagnosis_input.h"
#include "compare/qualification/judged_quantities.h"
#include "compare/qualification/qualification_budget.h"

namespace etalon {
namespace {

void require_usable(const QualificationInput& input) {
    const auto require = [](bool is_usable, std::string_view otherwise) {
        if (!is_usable)
            throw NumericalError(fmt::format("qualification: {}", otherwise));
    };
    require(input.camera, "a camera is needed");
    require(input.expected_poses.empty() || input.expected_poses.size() == input.poses.size(),
            "the expected poses are not of these poses");
    for (const VisitedPose& pose : input.poses) {
        require(vector_from_rigid(pose.base_from_carriage).allFinite(),
                "a stage position is not finite");
        if (!pose.is_detected())
            continue;
        const ImagePoints& bias = pose.detector_bias_px;
        if (pose.corners.size() != input.points_mm.size())
            throw NumericalError(fmt::format("qualification: {} corners for a marker of {} points",
                                             pose.corners.size(), input.points_mm.size()));
        for (const Eigen::Vector2d& corner : pose.corners)
            require(corner.allFinite(), "a corner is not finite");
        require(bias.empty() || bias.size() == pose.corners.size(),
                "a detector's bias is not of the marker's points");
        require(!bias.empty() || input.render_and_detect, "a way to render is needed");
        require(!pose.photometric ||
                    (vector_from_rigid(pose.photometric->camera_from_marker).allFinite() &&
                     pose.photometric->covariance.allFinite()),
                "a photometric pose is not finite");
    }
}

void count_detections(const QualificationInput& input, Qualification& result) {
    DetectionCounts& counts = result.detection;
    for (const VisitedPose& pose : input.poses) {
        (pose.hold_out ? counts.hold_out : counts.training) += 1;
        (pose.hold_out ? counts.hold_out_detected : counts.training_detected) += pose.is_detected();
    }
    if (counts.rate() < 1.0)
        result.reasons.push_back(
            fmt::format("the marker was detected in {:.1f} % of the poses", 100.0 * counts.rate()));
}

// A camera that gives one picture again and again may give an old one.
void find_equal_frames(const QualificationInput& input, Qualification& result) {
    const std::vector<int> equal = poses_of_equal_frames(input.poses);
    if (equal.empty())
        return;
    const auto shown = std::span(equal).first(std::min<std::size_t>(equal.size(), 5));
    result.reasons.push_back(fmt::format(
        "the frames of {} poses are equal to the last bit ({}{}): the camera repeats pictures, or "
        "its noise is below rounding",
        equal.size(), fmt::join(shown, ", "), shown.size() < equal.size() ? "..." : ""));
}

// All quantities in the documented order: those with a limit are judged, the others reported.
void list_quantities(const QualificationInput& input, Qualification& result) {
    for (const QuantityKind& kind : quantity_kinds()) {
        const auto limit = input.limits.by_quantity.find(kind.name);
        const bool is_judged = limit != input.limits.by_quantity.end();
        if (!is_judged && !input.options.measure_reported)
            continue;
        (is_judged ? result.quantities : result.reported)
            .push_back({.name = kind.name,
                        .unit = kind.unit,
                        .limit = is_judged ? limit->second : 0.0,
                        .reason = is_judged ? "" : "the limits have none for it"});
    }
    result.risk = family_wise_risk(result.quantities, input.limits.rule);
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

// Where white clips, edges lie elsewhere than in the renders, and nothing else can be told.
Qualification overexposed(Qualification result) {
    result.causes.emplace().ranked.push_back(
        {{{{"overexposed"}, 0.0, 0.0, "", {"expose less and measure again"}}}, 1.0});
    return skipped(std::move(result),
                   "overexposed: white is at the end of the scale, so nothing was measured");
}

// With the marker at `predicted`: where the detector's bias is known, that is what it adds there.
std::optional<ImagePoints> expected_corners(const QualificationInput& input,
                                            const Projector& projector, const AnalysedPose& pose,
                                            const Rigid& predicted) {
    if (pose.detector_bias_px.empty())
        return input.render_and_detect(predicted);
    ImagePoints corners = projected(projector, input.points_mm, predicted);
    for (std::size_t k = 0; k < corners.size(); ++k)
        corners[k] += pose.detector_bias_px[k];
    return corners;
}

// Those to register on, and their indices among the input's.
struct TrainingPoses {
    std::vector<RegistrationPose> poses;
    std::vector<ImagePoints> known_bias;
    std::vector<std::size_t> indices;
};

TrainingPoses training_poses(const QualificationInput& input, const Projector& projector,
                             const Qualification& result) {
    TrainingPoses training;
    for (std::size_t i = 0; i < result.poses.size(); ++i) {
        const AnalysedPose& pose = result.poses[i];
        if (pose.hold_out || pose.outlying || !pose.is_detected())
            continue;
        std::optional<Rigid> first_estimate;
        if (!input.expected_poses.empty())
            first_estimate = input.expected_poses[i];
        else if (const auto seen = estimate_pose(projector, input.points_mm, pose.corners))
            first_estimate = seen->camera_from_marker;
        if (!first_estimate)
            continue;
        training.poses.push_back({pose.base_from_carriage, *first_estimate, pose.corners});
        training.known_bias.push_back(pose.detector_bias_px);
        training.indices.push_back(i);
    }
    return training;
}

// Whether the photograph's pixels show the marker elsewhere, too: else the detector slipped.
bool was_elsewhere(const VisitedPose& pose, const Registration& registration,
                   const Eigen::Vector3d& off_mm) {
    const Rigid predicted = registration.camera_from_marker(pose.base_from_carriage);
    return !pose.seen_at ||
           (pose.seen_at->translation - predicted.translation).norm() > 0.5 * off_mm.norm();
}

// Leaves out the outliers (`indices`: among the result's poses) that were elsewhere; false: none.
bool leave_out(const QualificationInput& input, const std::vector<OutlierPose>& outliers,
               const std::vector<std::size_t>& indices, Qualification& result) {
    const Registration& registration = result.registration->registration;
    bool is_any = false;
    for (const OutlierPose& outlier : outliers) {
        const std::size_t i = indices[outlier.index];
        AnalysedPose& pose = result.poses[i];
        if (!was_elsewhere(pose, registration, outlier.off_mm))
            continue;
        is_any = true;
        pose.outlying = true;
        pose.used = false;
        const std::string off = off_text(
            registration.camera_from_base.rotation.conjugate() * outlier.off_mm, input.axis_motions,
            pose.base_from_carriage, registration.carriage_from_marker, i);
        result.outlying.push_back({pose.index, fmt::format("pose {}{}", pose.index, off)});
    }
    return is_any;
}

// On the training poses with a pose estimate that are not outlying; false for too few of them.
bool registered(const QualificationInput& input, const Projector& projector,
                Qualification& result) {
    TrainingPoses training = training_poses(input, projector, result);
    if (std::ssize(training.poses) < min_training_poses)
        return false;
    if (!input.stage_reach.empty()) {
        // Poses that were lost may leave the others in a plane or on a line.
        std::vector<Rigid> seen;
        for (const RegistrationPose& pose : training.poses)
            seen.push_back(pose.base_from_carriage);
        require_full_motion(seen, input.stage_reach);
    }
    const auto register_all = [&] {
        result.registration = register_bias_corrected(projector, input.points_mm, training.poses,
                                                      input.nominal_carriage_from_marker,
                                                      input.render_and_detect, training.known_bias);
    };
    register_all();
    const auto outliers =
        outlying_registered(projector, input.points_mm, *result.registration, training.poses,
                            input.limits.by_quantity.at(quantity::position_rms));
    if (leave_out(input, outliers, training.indices, result)) {
        training = training_poses(input, projector, result);
        register_all();
    }
    for (std::size_t& used : result.registration->used) {
        used = training.indices[used];
        result.poses[used].used = true;
    }
    return std::ssize(result.registration->used) >= min_training_poses;
}

// Biases of all poses; B3 only of hold-out poses, and the training poses' differences of the
// registration's last round. Returns how many hold-out poses have B3.
int find_biases(const QualificationInput& input, const Projector& projector,
                Qualification& result) {
    const Registration& registration = result.registration->registration;
    int usable = 0;
    for (AnalysedPose& pose : result.poses) {
        const Rigid predicted = registration.camera_from_marker(pose.base_from_carriage);
        std::optional<ImagePoints> expected;
        if (pose.hold_out && pose.is_detected())
            expected = expected_corners(input, projector, pose, predicted);
        pose.bias = pose_bias(projector, input.points_mm, predicted, pose.corners,
                              expected.value_or(ImagePoints{}));
        if (pose.photometric)
            pose.bias.b4 = pose_error(pose.photometric->camera_from_marker, predicted);
        if (pose.hold_out) {
            pose.used = pose.bias.b3.has_value();
            usable += pose.used ? 1 : 0;
        }
    }
    for (std::size_t i = 0; i < result.registration->used.size(); ++i) {
        PoseBias& bias = result.poses[result.registration->used[i]].bias;
        bias.difference_px = differences(result.registration->corrected_px[i],
                                         projected(projector, input.points_mm, bias.predicted));
    }
    return usable;
}

// `covariance` gives the levels of noise along the axis and across it.
FieldSample sample_of(const PoseBias& bias, const Eigen::Vector3d& error,
                      const Eigen::Vector3d& axis, const Eigen::Matrix3d& covariance) {
    const double along = axis.dot(covariance * axis);
    return {bias.predicted.translation, error, axis, std::sqrt(along),
            std::sqrt(0.5 * std::max(0.0, covariance.trace() - along))};
}

FieldSample position_sample(const PoseBias& bias, const PoseError& error,
                            const Matrix6d& covariance) {
    return sample_of(bias, error.translation_mm, bias.predicted.translation.normalized(),
                     covariance.bottomRightCorner<3, 3>());
}

std::vector<FieldSample> position_samples(const std::vector<AnalysedPose>& poses) {
    std::vector<FieldSample> samples;
    for (const AnalysedPose& pose : poses)
        if (pose.is_judged())
            samples.push_back(
                position_sample(pose.bias, *pose.bias.b3, pose.bias.photo->covariance_per_px2));
    return samples;
}

std::vector<FieldSample> rotation_samples(const std::vector<AnalysedPose>& poses) {
    std::vector<FieldSample> samples;
    for (const AnalysedPose& pose : poses) {
        if (!pose.is_judged())
            continue;
        const PoseBias& bias = pose.bias;
        samples.push_back(sample_of(bias, bias.predicted.rotation * bias.b3->rotation_rad,
                                    bias.predicted.rotation * Eigen::Vector3d::UnitZ(),
                                    bias.photo->covariance_per_px2.topLeftCorner<3, 3>()));
    }
    return samples;
}

std::vector<FieldSample> photometric_samples(const std::vector<AnalysedPose>& poses) {
    std::vector<FieldSample> samples;
    for (const AnalysedPose& pose : poses)
        if (pose.hold_out && !pose.outlying && pose.bias.b4)
            samples.push_back(
                position_sample(pose.bias, *pose.bias.b4, pose.photometric->covariance));
    return samples;
}

std::vector<Eigen::Vector3d> volume_of(const std::vector<AnalysedPose>& poses) {
    std::vector<Eigen::Vector3d> volume;
    for (const AnalysedPose& pose : poses)
        volume.push_back(pose.bias.predicted.translation);
    return volume;
}

// The field of the hold-out poses' positions, but for those that are outlying.
void fit_position_field(const QualificationInput& input, Qualification& result) {
    const FieldBasis basis = position_basis(input.camera->projection);
    const std::vector<FieldSample> positions = position_samples(result.poses);
    result.position_field = fit_smooth_field(positions, basis);
    std::vector<std::size_t> judged;
    for (std::size_t i = 0; i < result.poses.size(); ++i)
        if (result.poses[i].is_judged())
            judged.push_back(i);
    const auto outliers = outlying_samples(positions, *result.position_field,
                                           input.limits.by_quantity.at(quantity::position_rms));
    if (leave_out(input, outliers, judged, result))
        result.position_field = fit_smooth_field(position_samples(result.poses), basis);
}

bool is_listed(const Qualification& result, const char* quantity) {
    return std::ranges::count(result.quantities, quantity, &JudgedQuantity::name) > 0 ||
           std::ranges::count(result.reported, quantity, &JudgedQuantity::name) > 0;
}

void fit_fields(const QualificationInput& input, const NoiseDraws& draws, Qualification& result) {
    const std::vector<Eigen::Vector3d> volume = volume_of(result.poses);
    fit_position_field(input, result);
    result.position_summary = summarize(*result.position_field, volume, draws);
    if (is_listed(result, quantity::rotation_rms) || is_listed(result, quantity::rotation_max)) {
        result.rotation_field =
            fit_smooth_field(rotation_samples(result.poses), FieldBasis::linear);
        result.rotation_summary = summarize(*result.rotation_field, volume, draws);
    }
    if (is_listed(result, quantity::length_max))
        result.lengths =
            length_errors(*result.position_field, position_samples(result.poses), draws);
    const std::vector<FieldSample> photometric = photometric_samples(result.poses);
    if (std::ssize(photometric) < min_hold_out_poses)
        return;
    PhotometricField& field = result.photometric.emplace();
    field.poses = static_cast<int>(photometric.size());
    field.position_field = fit_smooth_field(photometric, position_basis(input.camera->projection));
    field.position_summary = summarize(field.position_field, volume, draws);
}

SignatureChain chain_of(const QualificationInput& input, const Projector& projector,
                        const Qualification& result) {
    const Registration& registration = result.registration->registration;
    SignatureChain chain{projector,
                         input.points_mm,
                         registration.camera_from_base,
                         registration.carriage_from_marker,
                         {}};
    std::ranges::copy_if(result.poses, std::back_inserter(chain.poses), &AnalysedPose::used);
    return chain;
}

// Those that are known already are taken where they are of as many hold-out poses.
void find_signatures(const QualificationInput& input, const SignatureChain& chain,
                     Qualification& result) {
    const Qualification* known = input.options.known_run;
    const auto judged = std::ranges::count_if(result.poses, &AnalysedPose::is_judged);
    if (known && !known->signatures.empty() &&
        known->signatures.front().after.size() == 3 * judged) {
        result.signatures = known->signatures;
        return;
    }
    HoldOutNoise noise;
    for (const FieldSample& sample : position_samples(result.poses)) {
        noise.along_mm.push_back(result.position_field->scale_along * sample.sigma_along);
        noise.across_mm.push_back(result.position_field->scale_across * sample.sigma_across);
    }
    result.signatures = error_signatures(chain, stage_errors_of(input, result.poses), noise,
                                         input.limits.by_quantity.at(quantity::position_rms));
}

// Whether these are of as many poses, and of the same pixel errors.
bool are_of(const ErrorEffects& effects, const DiagnosisInput& evidence,
            const Qualification& result) {
    const SignatureChain& chain = evidence.request.chain;
    const auto judged = std::ranges::count_if(result.poses, &AnalysedPose::is_judged);
    return evidence.request.pixel_errors.empty() &&
           effects.errors.front().corners_px.rows() ==
               2 * std::ssize(chain.points_mm) * std::ssize(chain.poses) &&
           effects.after_mm.front().rows() == 3 * judged;
}

// The field that a smooth one fitted to the hold-out poses would be, were there nothing else.
FieldSummary field_alone(const EffectAlone& effect, const NoiseDraws& draws,
                         const Qualification& result) {
    BiasField field = *result.position_field;
    const Eigen::MatrixXd from_samples = estimator(field, position_samples(result.poses));
    const Eigen::MatrixXd factor = from_samples * effect.factor_mm;
    field.coefficients = from_samples * effect.mean_mm;
    field.covariance = factor * factor.transpose();
    return summarize(field, volume_of(result.poses), draws);
}

std::vector<PoseResiduals> residuals_in_image(const DiagnosisInput& evidence, const JointFit& fit) {
    std::vector<PoseResiduals> all;
    const std::vector<AnalysedPose>& poses = evidence.request.chain.poses;
    for (std::size_t i = 0; i < poses.size(); ++i) {
        const double deviation = std::sqrt(evidence.covariance_px2[i].diagonal().mean());
        all.push_back({stacked(poses[i].corners), fit.residual_px[i] / deviation});
    }
    return all;
}

// Root mean square length over the poses.
double residual_rms_mm(const SignatureChain& chain, const JointFit& fit) {
    double squares = 0.0;
    for (std::size_t i = 0; i < chain.poses.size(); ++i)
        squares += chain.pose_jacobian(i)
                       .colPivHouseholderQr()
                       .solve(fit.residual_px[i])
                       .tail<3>()
                       .squaredNorm();
    return std::sqrt(squares / static_cast<double>(chain.poses.size()));
}

void find_corner_figures(const QualificationInput& input, const SignatureChain& chain,
                         const NoiseDraws& draws, Qualification& result) {
    const DiagnosisInput evidence = diagnosis_input(input, chain, result);
    const Qualification* known = input.options.known_run;
    const bool is_known = known && known->effects && are_of(*known->effects, evidence, result);
    if (!is_known)
        result.effects = error_effects(evidence.request);
    CornerFigures& figures = result.corners.emplace();
    figures.fit = joint_fit(evidence, is_known ? *known->effects : *result.effects);
    figures.camera_alone = field_alone(figures.fit.camera, draws, result);
    if (!figures.fit.edges.mean_mm.isZero(0.0))
        figures.edges_alone = field_alone(figures.fit.edges, draws, result);
    figures.coherence = image_coherence(residuals_in_image(evidence, figures.fit),
                                        input.camera->width, input.camera->height);
    figures.coherent_rms_mm =
        residual_rms_mm(chain, figures.fit) * std::sqrt(figures.coherence.share);
}

// Of each judged pose's position, by corners, stage and error maps. Nothing when it is not known.
std::optional<std::vector<SampleNoise>> position_noise(const QualificationInput& input,
                                                       const Qualification& result) {
    std::vector<SampleNoise> noise;
    for (const AnalysedPose& pose : result.poses) {
        if (!pose.is_judged())
            continue;
        if (!pose.noise)
            return std::nullopt;
        noise.push_back({position_covariance(input, pose, 1.0 + input.render_noise_ratio) +
                             error_maps_mm2(input) * Eigen::Matrix3d::Identity(),
                         pose.noise->degrees_of_freedom});
        if (!(noise.back().covariance.trace() > 0.0))
            return std::nullopt;
    }
    return noise;
}

// Needs the signatures: what is declared as uncertain may be in the residuals, too.
void find_position_rest(const QualificationInput& input, Qualification& result) {
    if (const auto noise = position_noise(input, result))
        result.position_lack_of_fit =
            lack_of_fit(*result.position_field, position_samples(result.poses), *noise,
                        declared_fields(input, result.signatures));
}

// Value and U; false, with the reason, when the run has no value.
bool measure(JudgedQuantity& quantity, const Qualification& result) {
    const QuantityKind& kind = quantity_kind(quantity.name);
    const auto found = kind.measured(result);
    if (!found) {
        quantity.reason = kind.missing;
        return false;
    }
    quantity.measured = true;
    quantity.value = found->value;
    if (kind.is_of_pixels) {
        quantity.expanded_uncertainty = found->noise_uncertainty;
        quantity.coverage_factor = pixel_coverage_factor;
        return true;
    }
    const CombinedUncertainty uncertainty = combined(result.budget, quantity.name);
    quantity.expanded_uncertainty = uncertainty.expanded;
    quantity.coverage_factor = uncertainty.coverage_factor;
    quantity.degrees_of_freedom = uncertainty.degrees_of_freedom;
    return true;
}

// A PASS must hold whatever an unknown input may be. Nothing when it does.
std::string unknown_in_the_way(const JudgedQuantity& quantity, const DecisionRule& rule,
                               const Qualification& result) {
    auto sources = unknown_sources(result.budget, quantity.name, true);
    const double widest = combined(result.budget, quantity.name, true).expanded;
    if (sources.empty() && decide(quantity.value, widest, quantity.limit, rule) != Outcome::pass)
        sources = unknown_sources(result.budget, quantity.name, false);
    if (sources.empty())
        return "";
    return fmt::format("the uncertainty of '{}' is unknown", fmt::join(sources, "', '"));
}

void judge(JudgedQuantity& quantity, const Limits& limits, Qualification& result) {
    if (!measure(quantity, result))
        return;
    decide(quantity, limits);
    if (quantity.outcome != Outcome::pass)
        return;
    quantity.reason = unknown_in_the_way(quantity, limits.rule, result);
    if (!quantity.reason.empty()) {
        quantity.outcome = Outcome::inconclusive;
        result.budget_complete = false;
    }
}

void judge_all(const Limits& limits, Qualification& result) {
    result.budget_complete = true;
    for (JudgedQuantity& quantity : result.quantities)
        judge(quantity, limits, result);
    for (JudgedQuantity& quantity : result.reported)
        measure(quantity, result);
    result.rule = limits.rule;
    result.risk = family_wise_risk(result.quantities, limits.rule);
    result.verdict = combine(result.quantities);
}

// A PASS is accepted only from a run that is what its uncertainty takes it for.
void require_conditions(const QualificationInput& input, Qualification& result) {
    result.conditions = acceptance_conditions(input, result, position_samples(result.poses));
    for (const AcceptanceCondition& condition : result.conditions) {
        const bool is_unchecked = condition.state == AcceptanceCondition::State::not_checked;
        if (condition.state == AcceptanceCondition::State::not_met)
            result.reasons.push_back(condition.name + " is not as it must be: " + condition.text);
        else if (is_unchecked && !input.limits.lets_pass_unchecked(condition.name))
            result.reasons.push_back(fmt::format(
                "{} could not be checked: {}; or let it pass by may_be_unchecked in the limits",
                condition.name, condition.text));
        else
            continue;
        if (result.verdict == Outcome::pass)
            result.verdict = Outcome::inconclusive;
    }
}

void add_monte_carlo(const QualificationInput& input, std::span<const FieldInput> inputs,
                     Qualification& result) {
    const MonteCarloUncertainty b3 = monte_carlo_uncertainty(
        *result.position_field, position_samples(result.poses), volume_of(result.poses), inputs,
        input.options.seed, input.options.stop);
    for (std::vector<JudgedQuantity>* list : {&result.quantities, &result.reported})
        for (JudgedQuantity& quantity : *list)
            if (const auto figure = quantity_kind(quantity.name).monte_carlo)
                quantity.monte_carlo_uncertainty = b3.*figure;
}

std::string why_not_pass(const JudgedQuantity& quantity) {
    if (quantity.outcome == Outcome::skipped)
        return fmt::format("{} is SKIPPED: {}", quantity.name, quantity.reason);
    const std::string why = quantity.outcome == Outcome::inconclusive ? quantity.reason : "";
    return fmt::format("{} is {:.4f} {} with U = {:.4f} {}, limit {:.4f} {}: {}{}{}", quantity.name,
                       quantity.value, quantity.unit, quantity.expanded_uncertainty, quantity.unit,
                       quantity.limit, quantity.unit, name(quantity.outcome),
                       why.empty() ? "" : ", ", why);
}

// A finding fails a camera only where its limits say so; none makes a FAIL a PASS.
void judge_pixels(const QualificationInput& input, Qualification& result) {
    if (!input.limits.pixels_must_match)
        return;
    if (!result.pixels || result.pixels->photos == 0) {
        result.reasons.emplace_back(
            "the limits ask for pixels that match, and no photograph could be compared");
        if (result.verdict == Outcome::pass)
            result.verdict = Outcome::inconclusive;
    } else if (!result.pixels->findings.empty()) {
        result.reasons.emplace_back("the pixels do not match, as the limits ask for");
        result.verdict = Outcome::fail;
    }
}

}  // namespace

double DetectionCounts::rate() const {
    const int all = training + hold_out;
    return all > 0 ? static_cast<double>(training_detected + hold_out_detected) / all : 0.0;
}

Qualification qualify(const QualificationInput& input) {
    require_usable(input);
    Qualification result;
    for (const VisitedPose& pose : input.poses)
        result.poses.push_back({pose});
    find_noise(result.poses);
    const Projector projector(*input.camera);
    list_quantities(input, result);
    count_detections(input, result);
    find_equal_frames(input, result);
    result.pixels = input.pixels;
    if (result.pixels && result.pixels->is_overexposed)
        return overexposed(std::move(result));
    const std::string too_few = fmt::format(
        "too few poses with a detected marker: {} training (at least {}), {} hold-out (at least "
        "{})",
        result.detection.training_detected, min_training_poses, result.detection.hold_out_detected,
        min_hold_out_poses);
    if (result.detection.training_detected < min_training_poses ||
        result.detection.hold_out_detected < min_hold_out_poses ||
        !registered(input, projector, result))
        return skipped(std::move(result), too_few);
    const int usable = find_biases(input, projector, result);
    if (usable < min_hold_out_poses)
        return skipped(std::move(result),
                       "too few hold-out poses whose render is detected as well");
    std::optional<NoiseDraws> own_draws;
    const NoiseDraws& draws = input.options.known_draws ? *input.options.known_draws
                                                        : own_draws.emplace(input.options.seed);
    fit_fields(input, draws, result);
    const SignatureChain chain = chain_of(input, projector, result);
    find_signatures(input, chain, result);
    find_position_rest(input, result);
    find_corner_figures(input, chain, draws, result);
    QualificationBudget budget = qualification_budget(input, result, position_samples(result.poses),
                                                      calibration_signatures(chain));
    result.budget = std::move(budget.rows);
    judge_all(input.limits, result);
    require_conditions(input, result);
    judge_pixels(input, result);
    if (input.options.monte_carlo)
        add_monte_carlo(input, budget.inputs, result);
    for (const JudgedQuantity& quantity : result.quantities)
        if (result.verdict != Outcome::pass && quantity.outcome != Outcome::pass)
            result.reasons.push_back(why_not_pass(quantity));
    if (input.options.look_for_causes)
        result.causes = causes_of_run(input, chain, result);
    return result;
}

}  // namespace etalon
