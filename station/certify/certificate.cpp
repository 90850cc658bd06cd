#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compare/uncertainty/uncertainty_budget.h"
#include "core/statistics/distributions.h"
#include "station/certify/certificate.h"

namespace etalon {

std::string conformity_sentence(const Certificate& certificate) {
    const QualifyResult& run = certificate.run;
    const std::string limits = fmt::format("the limits '{}'", run.station.limits.id);
    if (run.outcome == RunOutcome::pass)
        return fmt::format("PASS: the camera conforms to {}.", limits);
    if (run.outcome == RunOutcome::fail)
        return fmt::format("FAIL: the camera does not conform to {}.", limits);
    return fmt::format("INCONCLUSIVE: no statement of conformity to {} can be made.", limits);
}

std::vector<std::string> method_sentences(const Certificate& certificate) {
    const QualifyResult& run = certificate.run;
    const auto hold_out = std::ranges::count(run.poses, true, &AnalysedPose::hold_out);
    return {
        fmt::format(
            "A printed marker ({}) on a precision stage was photographed in {} poses, {} "
            "frames each. Where stage and camera stand to each other was registered on {} "
            "of the poses with the calibration under test; the results are of the other {}.",
            run.station.marker.spec, run.poses.size(), run.station.plan.frames,
            std::ssize(run.poses) - hold_out, hold_out),
        "The bias B3 is the pose found in the photograph less the one found in its render, the "
        "image "
        "that the calibration predicts at the registered pose. Judged is a smooth field of it over "
        "the volume. A constant offset of all poses is not measured: the registration takes it up.",
        "Uncertainty by the GUM (JCGM 100), budget and degrees of freedom in the record. U = k u "
        "covers one-sided 97.7 % (two-sided 95.4 %) where nothing else is said."};
}

std::vector<std::string> certificate_remarks(const Certificate& certificate) {
    const QualifyResult& run = certificate.run;
    std::vector<std::string> remarks;
    if (run.sessions.size() > 1)
        remarks.push_back(fmt::format(
            "The measurement was interrupted and resumed: {} sessions, the stage homed in each.",
            run.sessions.size()));
    if (run.outcome != RunOutcome::pass)
        for (const std::string& reason : run.analysis->reasons)
            remarks.push_back(reason);
    for (const AcceptanceCondition& each : run.analysis->conditions)
        if (each.state == AcceptanceCondition::State::not_checked)
            remarks.push_back(fmt::format("{}: not checked, {}", each.name, each.text));
    remarks.insert(remarks.end(), run.remarks.begin(), run.remarks.end());
    return remarks;
}

std::string operators_of(const QualifyResult& run) {
    std::vector<std::string> names;
    for (const RunSession& session : run.sessions)
        if (std::ranges::find(names, session.operator_name) == names.end())
            names.push_back(session.operator_name);
    return fmt::format("{}", fmt::join(names, ", "));
}

double coverage_of(const JudgedQuantity& quantity) {
    const bool has_its_quantile =
        quantity.coverage_factor == coverage_factor(quantity.degrees_of_freedom);
    const double one_sided =
        has_its_quantile ? coverage_probability : normal_probability(quantity.coverage_factor);
    return 2.0 * one_sided - 1.0;
}

}  // namespace etalon
