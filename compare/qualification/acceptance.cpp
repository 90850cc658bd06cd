#include "compare/qualification/acceptance.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>

#include "compare/qualification/diagnosis_input.h"
#include "compare/qualification/qualification.h"

namespace etalon {
namespace {

using State = AcceptanceCondition::State;

// What is less than this part of a limit adds a thirtieth to its square.
constexpr double of_limit = 0.25;

AcceptanceCondition not_checked(const char* name, std::string why) {
    return {name, State::not_checked, 0.0, 0.0, "", std::move(why)};
}

AcceptanceCondition checked(const char* name, bool is_met, double value, double limit,
                            const char* unit, std::string text) {
    return {name, is_met ? State::met : State::not_met, value, limit, unit, std::move(text)};
}

AcceptanceCondition volume_coverage(const Qualification& result) {
    const std::vector<AnalysedPose>& poses = result.poses;
    constexpr double min_share = 0.5;
    constexpr int min_planned = 2;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const AnalysedPose& pose : poses)
        centre += pose.bias.predicted.translation / static_cast<double>(poses.size());
    std::array<int, 8> planned{}, used{};
    for (const AnalysedPose& pose : poses) {
        if (!pose.hold_out)
            continue;
        const Eigen::Vector3d from_centre = pose.bias.predicted.translation - centre;
        const auto octant =
            static_cast<std::size_t>((from_centre.x() > 0 ? 1 : 0) + (from_centre.y() > 0 ? 2 : 0) +
                                     (from_centre.z() > 0 ? 4 : 0));
        ++planned[octant];
        used[octant] += pose.used ? 1 : 0;
    }
    double smallest = 1.0;
    for (std::size_t i = 0; i < planned.size(); ++i)
        if (planned[i] >= min_planned)
            smallest = std::min(smallest, static_cast<double>(used[i]) / planned[i]);
    return checked("volume coverage", smallest >= min_share, smallest, min_share, "1",
                   fmt::format("in the emptiest octant of the volume {:.0f} % of the hold-out "
                               "poses were used, {:.0f} % are needed{}",
                               100.0 * smallest, 100.0 * min_share,
                               result.position_field->is_full()
                                   ? ""
                                   : "; they lie in a plane or on a line, and the verdict is of "
                                     "what the camera does there"));
}

AcceptanceCondition poses_that_fit(const Qualification& result) {
    std::vector<std::string> outlying;
    for (const RejectedPose& pose : result.outlying)
        outlying.push_back(pose.text);
    return checked(
        "poses that fit", outlying.empty(), static_cast<double>(outlying.size()), 0.0, "1",
        outlying.empty()
            ? "no pose lies where no field puts it"
            : fmt::format("the stage was not where it said, the camera showed an old frame, or the "
                          "detector took something else for the marker: {}; left out",
                          fmt::join(outlying, ", ")));
}

AcceptanceCondition residuals(const Qualification& result) {
    const char* title = "residuals against noise";
    if (!result.position_lack_of_fit)
        return not_checked(title,
                           "the noise is not known: take two frames at each pose, or characterise "
                           "the camera (etalon characterise), whose file then states it");
    const LackOfFit& rest = *result.position_lack_of_fit;
    const double limit = rest.chi_square_limit;
    return checked(title, rest.chi_square_ratio <= limit, rest.chi_square_ratio, limit, "1",
                   fmt::format("chi-square per degree of freedom is {:.2f} with {:.0f} degrees of "
                               "freedom; {:.2f} is the most",
                               rest.chi_square_ratio, rest.degrees_of_freedom, limit));
}

AcceptanceCondition residuals_over_image(const QualificationInput& input,
                                         const Qualification& result) {
    const ImageCoherence& found = result.corners->coherence;
    const double size_mm = result.corners->coherent_rms_mm,
                 least_mm = of_limit * input.limits.by_quantity.at(quantity::position_rms);
    return checked(
        "residuals over the image", found.deviations <= coherence_deviations || size_mm <= least_mm,
        found.deviations, coherence_deviations, "1",
        fmt::format("residuals of different poses within {:.0f} px of each other in the image have "
                    "{:.0f} % of their power in common ({:.1f} standard deviations from none; "
                    "{:.1f} is the most), some {:.3f} mm RMS of position{}",
                    found.bin_px, 100.0 * found.share, found.deviations, coherence_deviations,
                    size_mm,
                    found.deviations > coherence_deviations
                        ? ": a distortion, or an error of the stage, that no named error follows"
                        : ""));
}

// "20 ppm", "2.75 mrad", "0.02 mm".
std::string size_text(double size, const std::string& unit) {
    constexpr double million = 1e6, thousand = 1e3;
    if (unit == "1")
        return fmt::format("{:.0f} ppm", million * size);
    if (unit == "rad")
        return fmt::format("{:.3g} mrad", thousand * size);
    return fmt::format("{:.3g}{}{}", size, unit.empty() ? "" : " ", unit);
}

std::string text_of(const ContradictedInput& input) {
    std::string text = fmt::format(
        "{}: declared {}, found {} +- {}", input.name, size_text(input.declared, input.unit),
        size_text(input.found, input.unit), size_text(input.expanded_uncertainty, input.unit));
    if (!input.or_all_of.empty())
        text += fmt::format(" (or, as much the other way and all of them, {})",
                            fmt::join(input.or_all_of, ", "));
    return text;
}

AcceptanceCondition declared_inputs(const Qualification& result) {
    std::vector<std::string> texts;
    double largest = 0.0;
    for (const ContradictedInput& input : result.corners->fit.contradicted) {
        texts.push_back(text_of(input));
        largest = std::max(largest, input.deviations);
    }
    return checked("declared inputs", texts.empty(), largest, contradiction_deviations, "1",
                   texts.empty() ? fmt::format("nothing that is declared is off by more than "
                                               "{:.0f} of its standard uncertainties",
                                               contradiction_deviations)
                                 : fmt::format("{}", fmt::join(texts, "; ")));
}

// A field that some errors make by themselves against the limits of the judged one.
AcceptanceCondition alone(const char* title, const char* whose, const FieldSummary& field,
                          const QualificationInput& input) {
    const double rms_limit = input.limits.by_quantity.at(quantity::position_rms),
                 max_limit = input.limits.by_quantity.at(quantity::position_max);
    const Outcome rms = decide(field.rms, field.rms_uncertainty, rms_limit, input.limits.rule),
                  max = decide(field.max, field.max_uncertainty, max_limit, input.limits.rule);
    const std::string text = fmt::format(
        "{}: {:.3f} mm RMS with U = {:.3f} mm, limit {:.3f} mm; {:.3f} mm at most with U = {:.3f} "
        "mm, limit {:.3f} mm",
        whose, field.rms, field.rms_uncertainty, rms_limit, field.max, field.max_uncertainty,
        max_limit);
    const bool is_within = rms == Outcome::pass && max == Outcome::pass;
    if (is_within || rms == Outcome::fail || max == Outcome::fail)
        return checked(title, is_within, field.rms, rms_limit, "mm", text);
    return not_checked(
        title,
        "this run does not tell whether it is within its limits, as other errors could hide it; " +
            text);
}

AcceptanceCondition edges_alone(const QualificationInput& input, const Qualification& result) {
    const char* title = "edges alone";
    if (!result.corners->edges_alone)
        return checked(title, true, 0.0, input.limits.by_quantity.at(quantity::position_rms), "mm",
                       "edges are not seen to lie elsewhere than in the renders");
    return alone(title, "the field that edges make which lie elsewhere than in the renders",
                 *result.corners->edges_alone, input);
}

struct Drift {
    Eigen::Vector3d shift_mm;
    double uncertainty_mm = 0.0;  // U, k = 2, in its worst direction

    bool is_told() const { return shift_mm.allFinite() && std::isfinite(uncertainty_mm); }
    double least_mm() const { return shift_mm.norm() - uncertainty_mm; }
};

// A shift that goes with a number of each sample, over the numbers' range, by weighted least
// squares beside the field.
Drift fitted_drift(const BiasField& field, std::span<const FieldSample> samples,
                   std::span<const double> numbers) {
    const auto [first, last] = std::minmax_element(numbers.begin(), numbers.end());
    const double middle = 0.5 * (*first + *last), range = *last - *first;
    const auto rows = 3 * std::ssize(samples);
    Eigen::MatrixXd shift(rows, 3);
    Eigen::VectorXd error(rows);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const auto k = static_cast<Eigen::Index>(3 * i);
        shift.middleRows<3>(k) = (numbers[i] - middle) / range * Eigen::Matrix3d::Identity();
        error.segment<3>(k) = samples[i].error;
    }
    const Eigen::MatrixXd design = stacked_design(field, samples);
    const Eigen::MatrixXd from_samples = estimator(field, samples);
    const Eigen::MatrixXd freed = shift - design * (from_samples * shift);
    const Eigen::VectorXd residual = error - design * (from_samples * error);
    const Eigen::MatrixXd weighted =
        times_blocks(freed.transpose(), sample_weights(field, samples));
    const Eigen::Matrix3d covariance = Eigen::Matrix3d(weighted * freed).inverse();
    return {covariance * (weighted * residual),
            field_coverage_factor * std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(
                                                  Eigen::MatrixXd(covariance))
                                                  .eigenvalues()
                                                  .maxCoeff())};
}

// The longest pause between poses, where it is longer than all the rest of the run: what changes
// steadily while poses are taken, or in the pause alone, is then no straight line in time.
struct Pause {
    double begin_s = 0.0, end_s = 0.0;
};
std::optional<Pause> long_pause(std::vector<double> times) {
    std::ranges::sort(times);
    Pause longest;
    for (std::size_t i = 0; i + 1 < times.size(); ++i)
        if (times[i + 1] - times[i] > longest.end_s - longest.begin_s)
            longest = {times[i], times[i + 1]};
    const double rest = times.back() - times.front() - (longest.end_s - longest.begin_s);
    return longest.end_s - longest.begin_s > rest ? std::optional(longest) : std::nullopt;
}

// By time and, where a pause parts the run, by the order of the poses and from before to after it.
struct DriftBy {
    std::string words;
    Drift drift;
};
std::vector<DriftBy> drifts(const BiasField& field, std::span<const FieldSample> samples,
                            const std::vector<double>& times) {
    const auto fitted = [&](const auto& number_of) {
        std::vector<double> numbers;
        for (const double time : times)
            numbers.push_back(number_of(time));
        return fitted_drift(field, samples, numbers);
    };
    std::vector<DriftBy> all = {
        {"from the first to the last pose", fitted_drift(field, samples, times)}};
    if (const auto pause = long_pause(times)) {
        const std::string gap = fmt::format("a pause of {:.0f} s", pause->end_s - pause->begin_s);
        all.push_back({"from the first to the last pose without " + gap, fitted([&](double time) {
                           return time > pause->begin_s ? time - (pause->end_s - pause->begin_s)
                                                        : time;
                       })});
        all.push_back({"from before to after " + gap,
                       fitted([&](double time) { return time > pause->begin_s ? 1.0 : 0.0; })});
    }
    return all;
}

AcceptanceCondition drift(const QualificationInput& input, const Qualification& result,
                          std::span<const FieldSample> samples) {
    const char* title = "drift over the run";
    std::vector<double> times;
    for (const AnalysedPose& pose : result.poses) {
        if (pose.is_judged() && !pose.settled_s)
            return not_checked(title, "the poses carry no times");
        if (pose.is_judged())
            times.push_back(*pose.settled_s);
    }
    if (times.size() != samples.size())
        throw NumericalError("acceptance: times and samples do not agree");
    const double limit = input.limits.by_quantity.at(quantity::position_rms);
    const std::vector<DriftBy> all = drifts(*result.position_field, samples, times);
    if (!std::ranges::all_of(all, [](const DriftBy& by) { return by.drift.is_told(); }))
        return not_checked(title, "the poses' order does not let drift be told from the field");
    const DriftBy& worst =
        *std::ranges::max_element(all, {}, [](const DriftBy& by) { return by.drift.least_mm(); });
    const double size = worst.drift.shift_mm.norm();
    return checked(title, worst.drift.least_mm() <= limit, size, limit, "mm",
                   fmt::format("{:.3f} mm {}, U = {:.3f} mm; it must not be shown to exceed {:.3f} "
                               "mm",
                               size, worst.words, worst.drift.uncertainty_mm, limit));
}

// How far the marker moves when an axis goes by its readings' standard deviation in a pose, all
// axes together, mm.
double reading_scatter_mm(const QualificationInput& input, const Qualification& result,
                          std::size_t pose) {
    const Eigen::Vector3d& centre =
        result.registration->registration.carriage_from_marker.translation;
    const AnalysedPose& at = result.poses[pose];
    double square = 0.0;
    for (std::size_t k = 0; k < input.axis_motions.size(); ++k) {
        const StageAxisMotion& axis = input.axis_motions[k];
        const double step_mm =
            (axis.advanced.at(pose) * centre - at.base_from_carriage * centre).norm();
        square += std::pow(at.read_back_deviation[k] * step_mm / axis.step, 2);
    }
    return std::sqrt(square);
}

AcceptanceCondition rest_within_poses(const QualificationInput& input,
                                      const Qualification& result) {
    const char* title = "rest within poses";
    double sum = 0.0, freedom = 0.0, worst = 0.0, declared = 0.0;
    int count = 0, worst_pose = 0;
    for (std::size_t i = 0; i < result.poses.size(); ++i) {
        const AnalysedPose& pose = result.poses[i];
        if (!pose.is_judged() || pose.readings.size() < 2 ||
            pose.read_back_deviation.size() != input.axis_motions.size())
            continue;
        const double scatter = reading_scatter_mm(input, result, i);
        if (scatter > worst)
            worst_pose = pose.index;
        worst = std::max(worst, scatter);
        sum += scatter * scatter;
        freedom += static_cast<double>(pose.readings.size() - 1);
        ++count;
    }
    if (count == 0)
        return {title, State::not_asked, 0.0, 0.0, "", "the poses carry no readings of the stage"};
    for (const DeclaredRepeatability& axis : input.repeatability)
        declared += axis.reading_mm * axis.reading_mm;
    const double rms = std::sqrt(sum / count),
                 limit = std::max(of_limit * input.limits.by_quantity.at(quantity::position_rms),
                                  std::sqrt(declared * chi_square_limit(freedom)));
    return checked(title, rms <= limit, rms, limit, "mm",
                   fmt::format("while a pose is photographed the stage's readings scatter by "
                               "{:.3f} mm RMS at the marker, by {:.3f} mm in pose {}",
                               rms, worst, worst_pose));
}

// Of both poses at the same target: all but random errors are alike and drop out.
AcceptanceCondition repeatability(const QualificationInput& input, const Qualification& result) {
    const char* title = "repeatability";
    const auto usable = [](const AnalysedPose& pose) {
        return pose.bias.b2 && pose.noise && !pose.outlying;
    };
    double sum = 0.0;
    int repeats = 0, pairs = 0;
    for (std::size_t i = 0; i < result.poses.size(); ++i) {
        const AnalysedPose& pose = result.poses[i];
        if (!pose.repeats)
            continue;
        ++repeats;
        if (*pose.repeats >= i)
            throw NumericalError(fmt::format(
                "acceptance: pose {} repeats pose {}, which is not before it", i, *pose.repeats));
        const AnalysedPose& before = result.poses[*pose.repeats];
        if (!usable(pose) || !usable(before))
            continue;
        ++pairs;
        const Eigen::VectorXd difference =
            pose.bias.b2->translation_mm - before.bias.b2->translation_mm;
        const Eigen::Matrix3d covariance =
            position_covariance(input, pose) + position_covariance(input, before);
        const Eigen::LDLT<Eigen::MatrixXd> solver{Eigen::MatrixXd(covariance)};
        if (!solver.isPositive() || !(covariance.determinant() > 0.0))
            return not_checked(title, "frames that are alike to the last bit tell no noise");
        sum += difference.dot(solver.solve(difference));
    }
    if (repeats == 0)
        return {title, State::not_asked, 0.0, 0.0, "", "the plan visits no pose twice"};
    if (pairs == 0)
        return not_checked(title, "no pose was seen twice by corners whose noise is known");
    const double freedom = 3.0 * pairs;
    const double ratio = sum / freedom, limit = chi_square_limit(freedom);
    return checked(title, ratio <= limit, ratio, limit, "1",
                   fmt::format("{} poses visited again: chi-square per degree of freedom is "
                               "{:.2f}; {:.2f} is the most",
                               pairs, ratio, limit));
}

}  // namespace

const char* name(State state) {
    constexpr const char* names[] = {"met", "NOT MET", "not checked", "not asked for"};
    return names[static_cast<std::size_t>(state)];
}

std::vector<AcceptanceCondition> acceptance_conditions(const QualificationInput& input,
                                                       const Qualification& result,
                                                       std::span<const FieldSample> samples) {
    return {volume_coverage(result),
            poses_that_fit(result),
            residuals(result),
            residuals_over_image(input, result),
            declared_inputs(result),
            alone("camera alone", "the field that the camera's errors make by themselves",
                  result.corners->camera_alone, input),
            edges_alone(input, result),
            drift(input, result, samples),
            rest_within_poses(input, result),
            repeatability(input, result)};
}

Eigen::Matrix3d position_covariance(const DeclaredStation& station, const AnalysedPose& pose,
                                    double times) {
    return times * pose.noise->variance_px2 *
               pose.bias.photo->covariance_per_px2.bottomRightCorner<3, 3>() +
           repeatability_mm2(station) * Eigen::Matrix3d::Identity();
}

}  // namespace etalon
