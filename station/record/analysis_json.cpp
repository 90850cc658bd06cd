#include "station/record/analysis_json.h"

#include <cmath>
#include <span>

#include "report/number_text.h"

namespace etalon {
namespace {

using Json = RecordJson;

Json decision_risk_json(const std::optional<DecisionRisk>& risk) {
    if (!risk)
        return {};
    return {{"conformance_probability", risk->conformance},
            {"global_consumer", risk->consumer},
            {"global_producer", risk->producer},
            {"global_of", risk->has_prior ? "prior" : "any prior, at most"},
            {"passes_95", optional_number(risk->passes_95)},
            {"passes_50", optional_number(risk->passes_50)},
            {"passes_5", optional_number(risk->passes_5)}};
}

// Of a reported quantity limit and outcome are null: nobody asked for a judgement. Infinite degrees
// of freedom are written as null.
Json measurement_json(const JudgedQuantity& q, bool judged) {
    const auto figure = [&](double value) { return q.measured ? Json(value) : Json(); };
    return {{"name", q.name},
            {"unit", q.unit},
            {"value", figure(q.value)},
            {"expanded_uncertainty", figure(q.expanded_uncertainty)},
            {"coverage_factor", figure(q.coverage_factor)},
            {"degrees_of_freedom", figure(q.degrees_of_freedom)},
            {"monte_carlo_uncertainty", optional_number(q.monte_carlo_uncertainty)},
            {"limit", judged ? Json(q.limit) : Json()},
            {"outcome", judged ? Json(name(q.outcome)) : Json()},
            {"reason", q.reason},
            {"risk", decision_risk_json(q.risk)}};
}

Json measurements_json(std::span<const JudgedQuantity> quantities, bool judged) {
    Json list = Json::array();
    for (const JudgedQuantity& quantity : quantities)
        list.push_back(measurement_json(quantity, judged));
    return list;
}

Json risk_json(const FamilyRisk& risk) {
    return {{"judged", risk.judged},
            {"each", risk.each},
            {"wrong_pass", risk.false_acceptance},
            {"wrong_fail", risk.false_rejection}};
}

// Deviations as `etalon register` gives them: the corners' noise is that of the residuals.
Json weak_json(const Registration& registration) {
    Json list = Json::array();
    for (const PoorlyConstrainedDirection& weak : registration.weak)
        list.push_back({{"name", weak.name},
                        {"direction", numbers_json(weak.direction)},
                        {"deviation", std::sqrt(registration.reduced_squares) * weak.deviation},
                        {"unit", weak.is_shift() ? "mm" : "rad"},
                        {"worth_photographs", weak.worth_poses}});
    return list;
}

Json registration_json(const BiasCorrectedRegistration& corrected) {
    const Registration& registration = corrected.registration;
    Json freedoms = Json::array();
    for (const GaugeFreedom& freedom : registration.freedoms)
        freedoms.push_back(
            {{"name", freedom.name}, {"direction", numbers_json(freedom.direction)}});
    return {{"motion", registration.motion},
            {"camera_from_base", pose_numbers(registration.camera_from_base)},
            {"carriage_from_marker", pose_numbers(registration.carriage_from_marker)},
            {"residual_rms_px", registration.residual_rms_px},
            {"poses_used", corrected.used.size()},
            {"down_weighted_points", registration.down_weighted_points},
            {"rounds", corrected.rounds},
            {"last_change_px", corrected.last_change_px},
            {"rank", registration.rank},
            {"condition_number", registration.condition_number},
            {"freedoms", freedoms},
            {"badly_determined", weak_json(registration)}};
}

Json field_json(const BiasField& field, const FieldSummary& summary) {
    return {{"coefficients", numbers_json(field.coefficients)},
            {"samples", field.samples},
            {"degrees_of_freedom", field.degrees_of_freedom},
            {"down_weighted", field.down_weighted},
            {"centre_mm", numbers_json(field.centre_mm)},
            {"residual_along", field.residual_along},
            {"residual_across", field.residual_across},
            {"rms", summary.rms},
            {"rms_uncertainty", summary.rms_uncertainty},
            {"noise_rms", summary.noise_rms},
            {"max", summary.max},
            {"max_uncertainty", summary.max_uncertainty},
            {"max_position_mm", numbers_json(summary.max_position_mm)}};
}

Json conditions_json(const Qualification& analysis) {
    Json list = Json::array();
    for (const AcceptanceCondition& each : analysis.conditions) {
        const bool checked = each.is_compared();
        list.push_back({{"name", each.name},
                        {"state", name(each.state)},
                        {"value", checked ? Json(each.value) : Json()},
                        {"limit", checked ? Json(each.limit) : Json()},
                        {"unit", each.unit},
                        {"text", each.text}});
    }
    return list;
}

Json rest_json(const LackOfFit& rest) {
    return {{"rms", rest.rms},
            {"rms_uncertainty", rest.rms_uncertainty},
            {"noise_rms", rest.noise_rms},
            {"chi_square_ratio", rest.chi_square_ratio},
            {"degrees_of_freedom", rest.degrees_of_freedom},
            {"chi_square_limit", rest.chi_square_limit}};
}

Json lengths_json(const LengthErrors& lengths) {
    return {{"pairs", lengths.pairs},
            {"longest_mm", lengths.longest_mm},
            {"measured_rms_mm", lengths.measured_rms_mm},
            {"measured_max_mm", lengths.measured_max_mm},
            {"field_max_mm", lengths.field_max_mm},
            {"field_max_length_mm", lengths.field_max_length_mm},
            {"field_max_uncertainty_mm", lengths.field_max_uncertainty_mm}};
}

Json budget_row_json(const BudgetRow& row) {
    Json contributions = Json::object();
    for (const auto& [quantity, sensitivity] : row.sensitivity)
        if (row.standard_uncertainty)
            contributions[quantity] = row.contribution(quantity);
    return {{"source", row.source},
            {"standard_uncertainty", optional_number(row.standard_uncertainty)},
            {"unit", row.unit},
            {"distribution", name(row.distribution)},
            {"degrees_of_freedom", row.degrees_of_freedom},
            {"in_uncertainty", row.counted},
            {"widest", optional_number(row.widest)},
            {"sensitivity", row.sensitivity},
            {"contribution", contributions},
            {"basis", row.basis}};
}

Json budget_json(const Qualification& analysis) {
    Json list = Json::array();
    for (const BudgetRow& row : analysis.budget)
        list.push_back(budget_row_json(row));
    return list;
}

Json signatures_json(const Qualification& analysis) {
    Json list = Json::array();
    for (const ErrorSignature& s : analysis.signatures)
        list.push_back({{"name", s.name},
                        {"unit", s.unit},
                        {"size", s.size},
                        {"before_rms_mm", s.before_rms_mm},
                        {"before_max_mm", s.before_max_mm},
                        {"after_rms_mm", s.after_rms_mm},
                        {"after_max_mm", s.after_max_mm},
                        {"detectable_size", s.detectable_size},
                        {"observable", s.observable},
                        {"reason", s.reason},
                        {"confounded_with", s.confounded_with}});
    return list;
}

Json figure_json(const std::optional<PixelFigure>& figure, const char* unit) {
    if (!figure)
        return {};
    return {{"value", figure->value},
            {"expanded_uncertainty", figure->expanded_uncertainty},
            {"unit", unit}};
}

// Signed: photographs less renders.
Json pixels_json(const ImageAgreement& match) {
    return {{"photographs", match.photos},
            {"residual", figure_json(match.residual_gray, "gray")},
            {"blur", figure_json(match.blur_px, "px")},
            {"tone", figure_json(match.tone_gray, "gray")},
            {"shading", figure_json(match.shading_percent, "%")},
            {"noise", figure_json(match.noise_ratio, "1")},
            {"edge", figure_json(match.edge_px, "px")},
            {"background", figure_json(match.background_gray, "gray")},
            {"black", figure_json(match.black_gray, "gray")},
            {"overexposed", match.is_overexposed},
            {"findings", match.findings}};
}

Json causes_json(const Causes& causes) {
    Json ranked = Json::array();
    for (const Cause& cause : causes.ranked) {
        Json errors = Json::array();
        for (const CausingError& error : cause.errors)
            errors.push_back({{"names", error.names},
                              {"size", error.size},
                              {"expanded_uncertainty", error.expanded_uncertainty},
                              {"unit", error.unit},
                              {"remedies", error.remedies}});
        ranked.push_back({{"text", cause.text()},
                          {"probability", cause.probability},
                          {"errors", errors},
                          {"instead", cause.instead}});
    }
    return {{"ranked", ranked},
            {"no_error", causes.no_error},
            {"none_of_these", causes.none_of_these},
            {"corner_scatter_px", causes.corner_scatter_px},
            {"scatter", causes.scatter}};
}

}  // namespace

void add_analysis(Json& run, const Qualification& analysis) {
    run["measurements"] = measurements_json(analysis.quantities, true);
    run["reported"] = measurements_json(analysis.reported, false);
    run["decision_rule"] = {{"name", analysis.rule.name()},
                            {"guard_factor", analysis.rule.guard_factor}};
    run["risk"] = risk_json(analysis.risk);
    run["conditions"] = conditions_json(analysis);
    run["reasons"] = analysis.reasons;
    if (analysis.pixels)
        run["pixels"] = pixels_json(*analysis.pixels);
    if (analysis.causes)
        run["causes"] = causes_json(*analysis.causes);
    run["detection"] = {{"training", analysis.detection.training},
                        {"training_detected", analysis.detection.training_detected},
                        {"hold_out", analysis.detection.hold_out},
                        {"hold_out_detected", analysis.detection.hold_out_detected},
                        {"rate", analysis.detection.rate()}};
    if (analysis.registration)
        run["registration"] = registration_json(*analysis.registration);
    if (analysis.position_field)
        run["position_field_mm"] = field_json(*analysis.position_field, analysis.position_summary);
    if (analysis.rotation_field)
        run["rotation_field_rad"] = field_json(*analysis.rotation_field, analysis.rotation_summary);
    if (analysis.position_lack_of_fit)
        run["position_rest_mm"] = rest_json(*analysis.position_lack_of_fit);
    if (analysis.lengths)
        run["lengths"] = lengths_json(*analysis.lengths);
    if (analysis.photometric)
        run["photometric_position_field_mm"] = field_json(analysis.photometric->position_field,
                                                          analysis.photometric->position_summary);
    run["budget_complete"] = analysis.budget_complete;
    run["budget"] = budget_json(analysis);
    run["gauge_report"] = signatures_json(analysis);
}

}  // namespace etalon
