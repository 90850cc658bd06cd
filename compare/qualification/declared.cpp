#include "compare/qualification/declared.h"

#include <fmt/format.h>

#include <cmath>

#include "compare/qualification/qualification.h"
#include "core/program/errors.h"

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

}  // namespace

std::vector<StageError> stage_errors_of(const DeclaredStation& station,
                                        const std::vector<AnalysedPose>& poses) {
    std::vector<StageError> errors;
    for (const auto& [error, is_linear_scale, in_budget, uncertainty] : station.stage_terms)
        errors.push_back({error.name, error.unit, error.size,
                          of_used(error.base_from_carriage, poses, error.name)});
    return errors;
}

std::vector<StageAxisMotion> axis_motions_of(const std::vector<StageAxisMotion>& all,
                                             const std::vector<AnalysedPose>& poses) {
    std::vector<StageAxisMotion> motions;
    for (StageAxisMotion axis : all) {
        axis.position = of_used(axis.position, poses, axis.name);
        axis.advanced = of_used(axis.advanced, poses, axis.name);
        if (!axis.approach.empty())
            axis.approach = of_used(axis.approach, poses, axis.name);
        for (std::vector<Rigid>& aside : axis.aside)
            if (!aside.empty())
                aside = of_used(aside, poses, axis.name);
        motions.push_back(std::move(axis));
    }
    return motions;
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
                term.is_linear_scale
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

}  // namespace etalon
