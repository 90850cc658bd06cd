#include "compare/qualification/declared.h"

#include <fmt/format.h>

#include <cmath>

#include "compare/qualification/qualification.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// Of the used poses, which are the chain's.
template <class Value>
std::vector<Value> of_used(const std::vector<Value>& values, const std::vector<Pose>& poses,
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

}  // namespace

std::vector<StageError> stage_errors_of(const QualificationInput& input) {
    std::vector<StageError> errors;
    for (const auto& [error, is_linear_scale, in_budget, uncertainty] : input.stage_terms)
        errors.push_back({error.name, error.unit, error.size,
                          of_used(error.base_from_carriage, input.poses, error.name)});
    return errors;
}

std::vector<StageAxisMotion> axis_motions_of(const QualificationInput& input) {
    std::vector<StageAxisMotion> motions;
    for (StageAxisMotion axis : input.axis_motions) {
        axis.position = of_used(axis.position, input.poses, axis.name);
        axis.advanced = of_used(axis.advanced, input.poses, axis.name);
        if (!axis.approach.empty())
            axis.approach = of_used(axis.approach, input.poses, axis.name);
        for (std::vector<Rigid>& aside : axis.aside)
            if (!aside.empty())
                aside = of_used(aside, input.poses, axis.name);
        motions.push_back(std::move(axis));
    }
    return motions;
}

double repeatability_mm2(const QualificationInput& input) {
    double sum = 0.0;
    for (const DeclaredRepeatability& each : input.repeatability)
        sum += std::pow(each.marker_mm.value_or(0.0), 2);
    return sum / 3.0;
}

double error_maps_mm2(const QualificationInput& input) {
    double sum = 0.0;
    for (const DeclaredErrorMap& each : input.error_maps)
        sum += std::pow(each.marker_rms_mm, 2);
    return sum / 3.0;
}

std::map<std::string, double> declared_uncertainties(const QualificationInput& input) {
    std::map<std::string, double> declared;
    const DeclaredTemperature temperature = input.temperature.value_or(DeclaredTemperature{});
    const auto warmed = [&](double own, double expansion_per_k) {
        return std::hypot(own, temperature.standard_uncertainty_k * expansion_per_k);
    };
    for (const DeclaredStageTerm& term : input.stage_terms)
        if (term.standard_uncertainty)
            declared[term.error.name] =
                term.is_linear_scale
                    ? warmed(*term.standard_uncertainty, temperature.stage_expansion_per_k)
                    : *term.standard_uncertainty;
    if (input.marker_size_uncertainty)
        declared["marker print size"] =
            input.temperature
                ? warmed(*input.marker_size_uncertainty, temperature.marker_expansion_per_k)
                : std::hypot(*input.marker_size_uncertainty,
                             max_temperature_k * max_expansion_per_k);
    if (input.marker_flatness_mm)
        declared["marker twist"] = declared["marker bow"] = *input.marker_flatness_mm;
    return declared;
}

Eigen::MatrixXd declared_fields(const QualificationInput& input,
                                const std::vector<ErrorSignature>& signatures) {
    const auto declared = declared_uncertainties(input);
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

}  // namespace etalon
