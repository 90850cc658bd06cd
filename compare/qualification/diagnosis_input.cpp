#include "compare/qualification/diagnosis_input.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>

#include "compare/qualification/qualification.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

// Of the used poses, which are the chain's.
template <class Value>
std::vector<Value> of_used(const std::vector<Value>& values, const std::vector<AnalysedPose>& poses,
                           const std::string& whose) {
    if (values.size() != poses.size())
        throw NumericalError(fmt::format("qualification: '{}' has {} transforms for {} poses",
                                         whose, values.size(), poses.size()));
    std::vector<Value> used;
    for (std::size_t i = 0; i < poses.size(); ++i)
        if (poses[i].used)
            used.push_back(values[i]);
    return used;
}

std::vector<StageAxisMotion> axis_motions_of(const std::vector<StageAxisMotion>& all,
                                             const std::vector<AnalysedPose>& poses) {
    std::vector<StageAxisMotion> motions = all;
    for (StageAxisMotion& axis : motions) {
        axis.position = of_used(axis.position, poses, axis.name);
        axis.advanced = of_used(axis.advanced, poses, axis.name);
        if (!axis.approach.empty())
            axis.approach = of_used(axis.approach, poses, axis.name);
        for (std::vector<Rigid>& aside : axis.aside)
            if (!aside.empty())
                aside = of_used(aside, poses, axis.name);
    }
    return motions;
}

}  // namespace

std::vector<StageError> stage_errors_of(const DeclaredStation& station,
                                        const std::vector<AnalysedPose>& poses) {
    std::vector<StageError> errors;
    for (const DeclaredStageTerm& term : station.stage_terms) {
        StageError& error = errors.emplace_back(term.error);
        error.base_from_carriage = of_used(error.base_from_carriage, poses, error.name);
    }
    return errors;
}

double repeatability_mm2(const DeclaredStation& station) {
    double sum = 0.0;
    for (const DeclaredRepeatability& each : station.repeatability)
        sum += std::pow(each.marker_mm.value_or(0.0), 2);
    return sum / 3.0;
}

double error_maps_mm2(const DeclaredStation& station) {
    double sum = 0.0;
    for (const DeclaredErrorMap& each : station.error_maps)
        sum += std::pow(each.marker_rms_mm, 2);
    return sum / 3.0;
}

std::map<std::string, double> declared_uncertainties(const DeclaredStation& station) {
    std::map<std::string, double> declared;
    const DeclaredTemperature temperature = station.temperature.value_or(DeclaredTemperature{});
    const auto warmed = [&](double own, double expansion_per_k) {
        return std::hypot(own, temperature.standard_uncertainty_k * expansion_per_k);
    };
    for (const DeclaredStageTerm& term : station.stage_terms)
        if (term.standard_uncertainty)
            declared[term.error.name] =
                term.error.is_linear_scale
                    ? warmed(*term.standard_uncertainty, temperature.stage_expansion_per_k)
                    : *term.standard_uncertainty;
    if (station.marker_size_uncertainty)
        declared["marker print size"] =
            station.temperature
                ? warmed(*station.marker_size_uncertainty, temperature.marker_expansion_per_k)
                : std::hypot(*station.marker_size_uncertainty,
                             max_temperature_k * max_expansion_per_k);
    if (station.marker_flatness_mm)
        declared["marker twist"] = declared["marker bow"] = *station.marker_flatness_mm;
    return declared;
}

Eigen::MatrixXd declared_fields(const DeclaredStation& station,
                                const std::vector<ErrorSignature>& signatures) {
    const auto declared = declared_uncertainties(station);
    Eigen::MatrixXd columns;
    for (const ErrorSignature& signature : signatures) {
        const auto found = declared.find(signature.name);
        if (found == declared.end() || found->second == 0.0)
            continue;
        columns.conservativeResize(signature.after.size(), columns.cols() + 1);
        columns.rightCols<1>() = signature.after * (found->second / signature.size);
    }
    return columns;
}

namespace {

// Turns the x axis of every point's pixels to where the marker's x axis points in the image.
Eigen::MatrixXd marker_axes_from_image(const SignatureChain& chain, std::size_t pose) {
    const Eigen::MatrixXd by_shift = chain.pose_jacobian(pose).rightCols<3>();
    const Eigen::Vector3d x_axis =
        chain.camera_from_marker(pose).rotation * Eigen::Vector3d::UnitX();
    Eigen::Vector2d along = Eigen::Vector2d::Zero();
    for (Eigen::Index k = 0; k < by_shift.rows(); k += 2)
        along += by_shift.middleRows<2>(k) * x_axis;
    along.normalize();
    Eigen::Matrix2d turn;
    turn << along.x(), along.y(), -along.y(), along.x();
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(by_shift.rows(), by_shift.rows());
    for (Eigen::Index k = 0; k < by_shift.rows(); k += 2)
        all.block<2, 2>(k, k) = turn;
    return all;
}

// Correlation of the noise of a marker's corners, with the mean variance 1, pooled over the frames
// of all poses in the marker's axes, drawn towards independence by one frame's weight a coordinate.
Eigen::MatrixXd corner_correlation(const SignatureChain& chain) {
    const auto rows = static_cast<Eigen::Index>(2 * chain.points_mm.size());
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(rows, rows);
    double freedom = 0.0;
    for (std::size_t i = 0; i < chain.poses.size(); ++i) {
        const AnalysedPose& pose = chain.poses[i];
        if (!pose.corner_noise || pose.frames.empty())
            continue;
        const Eigen::MatrixXd turned = marker_axes_from_image(chain, i);
        const double frame_variance = pose.corner_noise->variance_px2 * pose.detections;
        for (const FrameRecord& frame : pose.frames) {
            if (frame.corners.size() != pose.corners.size())
                continue;
            const Eigen::VectorXd off = turned * stacked(differences(frame.corners, pose.corners));
            sum += off * off.transpose() / frame_variance;
        }
        freedom += pose.detections - 1;
    }
    const auto prior = static_cast<double>(rows);
    sum.diagonal().array() += prior;
    return sum / (freedom + prior);
}

// A detector slips where its corners are off by several times their noise from where the pixels of
// the same photograph put them. Beyond 99.9 % of what most poses show the noise is made as large as
// the slip.
void widen_where_slipped(const SignatureChain& chain, std::vector<Eigen::MatrixXd>& noise_px2) {
    const auto freedom = static_cast<double>(2 * chain.points_mm.size());
    constexpr double normal_999 = 3.0902;
    std::vector<double> squares(noise_px2.size(), 0.0);
    for (std::size_t i = 0; i < noise_px2.size(); ++i) {
        const AnalysedPose& pose = chain.poses[i];
        if (!pose.seen_at)
            continue;
        const auto expected = projected(chain.projector, chain.points_mm, *pose.seen_at);
        const Eigen::VectorXd slip =
            stacked(differences(differences(pose.corners, expected), pose.detector_bias_px));
        squares[i] = slip.dot(noise_px2[i].llt().solve(slip));
    }
    const double usual = std::max(1.0, median(squares) / freedom);
    for (std::size_t i = 0; i < noise_px2.size(); ++i) {
        const double times = squares[i] / (usual * freedom);
        if (times > reduced_chi_square(normal_999, freedom))
            noise_px2[i] *= times;
    }
}

// Whether an explanation of all poses covers those that were left out as well as the others.
bool covers_left_out(const Causes& of_all, const Causes& of_used, const Qualification& result) {
    constexpr double as_well = 1.1;
    const Cause* named = of_all.named();
    return named && of_all.scatter <= as_well * of_used.scatter &&
           std::ranges::none_of(result.outlying, [&](const RejectedPose& pose) {
               return std::ranges::any_of(named->errors, [&](const CausingError& error) {
                   return error.names.front() == misplaced_pose_name(pose.index);
               });
           });
}

}  // namespace

DiagnosisInput diagnosis_input(const QualificationInput& input, const SignatureChain& chain,
                               const Qualification& result) {
    DiagnosisInput evidence{{chain,
                             stage_errors_of(input, result.poses),
                             axis_motions_of(input.axis_motions, result.poses),
                             {}},
                            {},
                            {},
                            declared_uncertainties(input)};
    if (input.pixels) {
        evidence.request.pixel_errors = input.pixels->evidence.errors;
        evidence.pixels = input.pixels->evidence.observed;
        evidence.pixel_covariance = input.pixels->evidence.covariance;
    }
    const Eigen::MatrixXd correlation = corner_correlation(chain);
    const Eigen::MatrixXd modes = Eigen::LLT<Eigen::MatrixXd>(correlation).matrixL();
    for (std::size_t i = 0; i < chain.poses.size(); ++i) {
        const AnalysedPose& pose = chain.poses[i];
        if (pose.settled_s)
            evidence.request.times_s.push_back(*pose.settled_s);
        const Eigen::MatrixXd turned = marker_axes_from_image(chain, i);
        evidence.difference_px.push_back(stacked(pose.bias.difference_px));
        evidence.corner_modes.push_back(turned.transpose() * modes);
        // Where noise is not known, it is what registration has left.
        const double left_px = result.registration->registration.residual_rms_px;
        const double variance_px2 =
            std::max(pose.noise ? pose.noise->variance_px2 : left_px * left_px, 1e-12);
        evidence.covariance_px2.push_back(variance_px2 * (1.0 + input.render_noise_ratio) *
                                          turned.transpose() * correlation * turned);
    }
    widen_where_slipped(chain, evidence.covariance_px2);
    const double stage_mm2 = repeatability_mm2(input) + error_maps_mm2(input);
    for (std::size_t i = 0; i < chain.poses.size(); ++i) {
        const Eigen::MatrixXd by_shift = chain.pose_jacobian(i).rightCols<3>();
        evidence.covariance_px2[i] += stage_mm2 * by_shift * by_shift.transpose();
    }
    return evidence;
}

Causes causes_of_run(const QualificationInput& input, SignatureChain chain, Qualification result) {
    Causes causes = find_causes(diagnosis_input(input, chain, result));
    if (result.outlying.empty())
        return causes;
    for (AnalysedPose& pose : result.poses)
        pose.used = pose.used || (pose.outlying && !pose.bias.difference_px.empty());
    chain.poses.clear();
    std::ranges::copy_if(result.poses, std::back_inserter(chain.poses), &AnalysedPose::used);
    const Causes of_all = find_causes(diagnosis_input(input, chain, result));
    if (covers_left_out(of_all, causes, result))
        return of_all;
    for (const RejectedPose& pose : result.outlying) {
        const CausingError error{
            {misplaced_pose_name(pose.index)}, 0.0, 0.0, "", {misplaced_pose_remedy(pose.text)}};
        causes = with_error(error, 1.0, std::move(causes));
    }
    return causes;
}

}  // namespace etalon
