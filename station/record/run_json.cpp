#include "station/record/run_json.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/file/text.h"
#include "report/number_text.h"
#include "report/result_table.h"
#include "station/record/record_json.h"

namespace etalon {

ETALON_MEMBERS_TO_JSON(Attachment, path, sha256)
ETALON_MEMBERS_TO_JSON(CausingError, names, size, expanded_uncertainty, unit, remedies)
ETALON_MEMBERS_TO_JSON(ClimateSummary, lowest, highest, mean, deviation, readings)
ETALON_MEMBERS_TO_JSON(ErrorSignature, name, unit, size, before_rms_mm, before_max_mm, after_rms_mm,
                       after_max_mm, detectable_size, observable, reason, confounded_with)
ETALON_MEMBERS_TO_JSON(LackOfFit, rms, rms_uncertainty, noise_rms, chi_square_ratio,
                       degrees_of_freedom, chi_square_limit)
ETALON_MEMBERS_TO_JSON(LengthErrors, pairs, longest_mm, measured_rms_mm, measured_max_mm,
                       field_max_mm, field_max_length_mm, field_max_uncertainty_mm)
ETALON_MEMBERS_TO_JSON(TracedReference, name, value, expanded_uncertainty, unit, certificate,
                       laboratory, date, due)

namespace {

double seconds(Duration duration) {
    return std::chrono::duration<double>(duration).count();
}

double unit_of(const Axis& axis) {
    return axis.kind == Axis::Kind::rotary ? deg_per_rad : 1.0;
}

Json camera_json(const QualifyResult& result) {
    Json camera = result.camera;
    camera["uri"] = result.station.camera.uri;
    camera["calibrated_serial"] = result.station.camera.model.serial;
    camera["settings"] = settings_json(result.settings);
    add_counters(camera, result.statistics());
    camera["remarks"] = result.remarks;
    return camera;
}

Json axis_json(const Axis& axis) {
    const double unit = unit_of(axis);
    const bool rotary = axis.kind == Axis::Kind::rotary;
    const auto size = [&](const std::optional<double>& value) {  // in the axis' unit
        return value ? Json(*value * unit) : Json();
    };
    const auto point_json = [&](const ErrorMapPoint& point) -> Json {
        return {point.position * unit, point.error * unit, point.uncertainty * unit};
    };
    return {{"name", axis.name},
            {"kind", rotary ? "rotary" : "linear"},
            {"unit", rotary ? "deg" : "mm"},
            {"direction", numbers_of(axis.direction)},
            {"point_mm", numbers_of(axis.point_mm)},
            {"travel", {axis.low * unit, axis.high * unit}},
            {"speed", axis.speed * unit},
            {"scale_uncertainty", or_null(axis.scale_uncertainty)},
            {"repeatability", size(axis.repeatability)},
            {"previous_from_mount", pose_numbers(axis.previous_from_mount)},
            {"zero", axis.zero * unit},
            {"approach", axis.approach},
            {"overrun", axis.overrun * unit},
            {"backlash", axis.backlash * unit},
            {"backlash_uncertainty", size(axis.backlash_uncertainty)},
            {"read_noise", size(axis.read_noise)},
            {"direction_uncertainty_rad", or_null(axis.direction_uncertainty)},
            {"point_uncertainty_mm", or_null(axis.point_uncertainty)},
            {"error_map", axis.errors ? json_list(axis.errors->points(), point_json) : Json()}};
}

Json forbidden_json(const StationStage& stage) {
    Json boxes = Json::array();
    for (const ForbiddenBox& box : stage.rules.forbidden) {
        Json sides = {{"name", box.name}};
        for (std::size_t i = 0; i < stage.axes.size(); ++i)
            if (std::isfinite(box.sides[i].low))
                sides[stage.axes[i].name] = {box.sides[i].low * unit_of(stage.axes[i]),
                                             box.sides[i].high * unit_of(stage.axes[i])};
        boxes.push_back(sides);
    }
    return boxes;
}

Json link_json(const StageLink& link) {
    Json json = {{"unit", link.unit}, {"response_timeout_ms", link.response_timeout.count()}};
    if (const auto* port = std::get_if<SerialPort>(&link.address)) {
        json["device"] = port->device;
        json["baud"] = port->baud;
        json["format"] = fmt::format("{}{}{}", port->data_bits, port->parity, port->stop_bits);
        json["quiet_ms"] = link.quiet.count();
    } else {
        json["host"] = std::get<TcpAddress>(link.address).host;
        json["port"] = std::get<TcpAddress>(link.address).port;
    }
    return json;
}

Json plan_json(const StationFile& station, const Plan& plan) {
    Json volume;
    for (std::size_t i = 0; i < station.stage.axes.size(); ++i) {
        const double unit = unit_of(station.stage.axes[i]);
        volume[station.stage.axes[i].name] = {station.plan.volume[i].low * unit,
                                              station.plan.volume[i].high * unit};
    }
    const auto hold_out = std::ranges::count(plan.poses, true, &PlannedPose::hold_out);
    return {{"volume", volume},
            {"poses", plan.poses.size()},
            {"hold_out", hold_out},
            {"repeats", station.plan.repeats},
            {"frames", station.plan.frames},
            {"seed", station.plan.seed},
            {"settle_ms", station.plan.settle.count()},
            {"expected_duration_s", seconds(plan.expected_duration)}};
}

// `source`: a sensor's address, "given by hand", or null.
Json environment_json(const QualifyResult& result) {
    const auto& declared = result.station.environment;
    Json source;
    if (declared)
        source = declared->sensor ? describe(declared->sensor->link) : "given by hand";
    return {{"source", source},
            {"temperature_c", or_null(room_temperature(result.station, result.environment))},
            {"humidity_percent", or_null(room_humidity(result.station, result.environment))},
            {"lost", result.environment.lost}};
}

ColumnsOf<RunSession> session_columns() {
    return {{"started_utc", &RunSession::started_utc},
            {"start_s", &RunSession::start_s},
            {"version", &RunSession::version},
            {"operator", &RunSession::operator_name},
            {"poses_visited", &RunSession::poses}};
}

// ---- poses.csv

using PoseColumns = ColumnsOf<AnalysedPose>;

// A column for each axis, in its unit where the numbers are positions.
template <class Number, class Phase>
void add_axis_columns(PoseColumns& columns, const std::vector<Axis>& axes, const char* prefix,
                      std::vector<Number> Phase::*numbers) {
    for (std::size_t i = 0; i < axes.size(); ++i) {
        constexpr bool is_position = std::is_same_v<Number, double>;
        const double unit = is_position ? unit_of(axes[i]) : 1.0;
        const std::string& name = axes[i].name;
        columns.push_back({prefix + (is_position ? AxisUnits(axes[i].kind).mm_key(name) : name),
                           [=](const AnalysedPose& pose) -> TableCell {
                               if constexpr (is_position)
                                   return unit * (pose.*numbers)[i];
                               else
                                   return (pose.*numbers)[i];
                           }});
    }
}

// Before the analysis their cells are empty.
void add_analysis_columns(PoseColumns& columns, bool is_analysed) {
    columns.push_back({"used", [=](const AnalysedPose& pose) {
                           return is_analysed ? TableCell(pose.used) : TableCell();
                       }});
    for (const auto& [prefix, part] :
         {std::pair("photo_", &PoseBias::photo), std::pair("render_", &PoseBias::render)})
        add_columns(
            columns, columns_of_pose(),
            [=, part = part](const AnalysedPose& pose) -> const Rigid* {
                const auto& estimate = pose.bias.*part;
                return is_analysed && estimate ? &estimate->camera_from_marker : nullptr;
            },
            prefix);
    add_columns(
        columns, columns_of_pose(),
        [=](const AnalysedPose& pose) { return is_analysed ? &pose.bias.predicted : nullptr; },
        "predicted_");
    ColumnsOf<PoseError> six;
    for (int i = 0; const char* key : {"x_mm", "y_mm", "z_mm", "rx_mrad", "ry_mrad", "rz_mrad"}) {
        six.push_back({key, [i](const PoseError& error) {
                           return i < 3 ? error.translation_mm[i]
                                        : error.rotation_rad[i - 3] * 1000.0;
                       }});
        ++i;
    }
    for (const auto& [prefix, part] :
         {std::pair("b1_", &PoseBias::b1), std::pair("b2_", &PoseBias::b2),
          std::pair("b3_", &PoseBias::b3), std::pair("b4_", &PoseBias::b4)})
        add_columns(
            columns, six,
            [=, part = part](const AnalysedPose& pose) -> const PoseError* {
                const auto& error = pose.bias.*part;
                return is_analysed && error ? &*error : nullptr;
            },
            prefix);
}

PoseColumns pose_columns(const std::vector<Axis>& axes, bool is_analysed) {
    PoseColumns columns = {{"pose", &AnalysedPose::index}, {"split", [](const AnalysedPose& pose) {
                                                                return pose.hold_out ? "hold-out"
                                                                                     : "training";
                                                            }}};
    add_axis_columns(columns, axes, "commanded_", &AnalysedPose::target);
    add_axis_columns(columns, axes, "read_back_", &AnalysedPose::read_back);
    add_axis_columns(columns, axes, "deviation_", &AnalysedPose::read_back_deviation);
    add_axis_columns(columns, axes, "approach_", &AnalysedPose::approach);
    columns.push_back({"frames", [](const AnalysedPose& pose) { return pose.frames.size(); }});
    columns.push_back({"detections", &AnalysedPose::detections});
    const auto add_time = [&](const char* key,
                              const std::function<double(const AnalysedPose&)>& seconds) {
        columns.push_back(
            {key, [=](const AnalysedPose& pose) { return fmt::format("{:.6f}", seconds(pose)); }});
    };
    add_time("move_start_s", &AnalysedPose::move_start_s);
    add_time("settled_s", [](const AnalysedPose& pose) { return pose.settled_s.value_or(0.0); });
    add_time("done_s", &AnalysedPose::done_s);
    add_analysis_columns(columns, is_analysed);
    const ColumnsOf<PhotoResidual> residual = {{"residual_rms_gray", &PhotoResidual::rms_gray},
                                               {"residual_p99_gray", &PhotoResidual::p99_gray},
                                               {"psf_sigma_px", &PhotoResidual::psf_sigma_px}};
    add_columns(columns, residual, &AnalysedPose::residual);
    return columns;
}

// ---- the analysis

Json decision_risk_json(const std::optional<DecisionRisk>& risk) {
    if (!risk)
        return {};
    return {{"conformance_probability", risk->conformance},
            {"global_consumer", risk->consumer},
            {"global_producer", risk->producer},
            {"global_of", risk->has_prior ? "prior" : "any prior, at most"},
            {"passes_95", or_null(risk->passes_95)},
            {"passes_50", or_null(risk->passes_50)},
            {"passes_5", or_null(risk->passes_5)}};
}

// Limit and outcome of a reported quantity, and infinite degrees of freedom, are null.
Json measurement_json(const JudgedQuantity& q, bool judged) {
    const auto figure = [&](double value) { return q.measured ? Json(value) : Json(); };
    return {{"name", q.name},
            {"unit", q.unit},
            {"value", figure(q.value)},
            {"expanded_uncertainty", figure(q.expanded_uncertainty)},
            {"coverage_factor", figure(q.coverage_factor)},
            {"degrees_of_freedom", figure(q.degrees_of_freedom)},
            {"monte_carlo_uncertainty", or_null(q.monte_carlo_uncertainty)},
            {"limit", judged ? Json(q.limit) : Json()},
            {"outcome", judged ? Json(name(q.outcome)) : Json()},
            {"reason", q.reason},
            {"risk", decision_risk_json(q.risk)}};
}

Json registration_json(const BiasCorrectedRegistration& corrected) {
    const Registration& registration = corrected.registration;
    const auto freedom_json = [](const GaugeFreedom& freedom) -> Json {
        return {{"name", freedom.name}, {"direction", numbers_of(freedom.direction)}};
    };
    // Deviations as `etalon register` gives them: the corners' noise is that of the residuals.
    const auto weak_json = [&](const PoorlyConstrainedDirection& weak) -> Json {
        return {{"name", weak.name},
                {"direction", numbers_of(weak.direction)},
                {"deviation", std::sqrt(registration.reduced_squares) * weak.deviation},
                {"unit", weak.is_shift() ? "mm" : "rad"},
                {"worth_photographs", weak.worth_poses}};
    };
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
            {"freedoms", json_list(registration.freedoms, freedom_json)},
            {"badly_determined", json_list(registration.weak, weak_json)}};
}

Json field_json(const BiasField& field, const FieldSummary& summary) {
    return {{"coefficients", numbers_of(field.coefficients)},
            {"samples", field.samples},
            {"degrees_of_freedom", field.degrees_of_freedom},
            {"down_weighted", field.down_weighted},
            {"centre_mm", numbers_of(field.centre_mm)},
            {"residual_along", field.residual_along},
            {"residual_across", field.residual_across},
            {"rms", summary.rms},
            {"rms_uncertainty", summary.rms_uncertainty},
            {"noise_rms", summary.noise_rms},
            {"max", summary.max},
            {"max_uncertainty", summary.max_uncertainty},
            {"max_position_mm", numbers_of(summary.max_position_mm)}};
}

Json condition_json(const AcceptanceCondition& each) {
    const bool checked = each.is_compared();
    return {{"name", each.name},
            {"state", name(each.state)},
            {"value", checked ? Json(each.value) : Json()},
            {"limit", checked ? Json(each.limit) : Json()},
            {"unit", each.unit},
            {"text", each.text}};
}

Json budget_row_json(const BudgetRow& row) {
    Json contributions = Json::object();
    for (const auto& [quantity, sensitivity] : row.sensitivity)
        if (row.standard_uncertainty)
            contributions[quantity] = row.contribution(quantity);
    return {{"source", row.source},
            {"standard_uncertainty", or_null(row.standard_uncertainty)},
            {"unit", row.unit},
            {"distribution", name(row.distribution)},
            {"degrees_of_freedom", row.degrees_of_freedom},
            {"in_uncertainty", row.counted},
            {"widest", or_null(row.widest)},
            {"sensitivity", row.sensitivity},
            {"contribution", contributions},
            {"basis", row.basis}};
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

// A sum of probabilities may be over 1 by its rounding.
double at_most_one(double sum) {
    return std::min(sum, 1.0);
}

Json causes_json(const Causes& causes) {
    const auto cause_json = [](const Cause& cause) -> Json {
        return {{"text", cause.text()},
                {"probability", at_most_one(cause.probability)},
                {"errors", cause.errors},
                {"instead", cause.instead}};
    };
    return {{"ranked", json_list(causes.ranked, cause_json)},
            {"no_error", at_most_one(causes.no_error)},
            {"none_of_these", at_most_one(causes.none_of_these)},
            {"corner_scatter_px", causes.corner_scatter_px},
            {"scatter", causes.scatter}};
}

void add_analysis(Json& run, const Qualification& analysis) {
    run["measurements"] = json_list(analysis.quantities, [](const JudgedQuantity& each) {
        return measurement_json(each, true);
    });
    run["reported"] = json_list(analysis.reported, [](const JudgedQuantity& each) {
        return measurement_json(each, false);
    });
    run["decision_rule"] = {{"name", analysis.rule.name()},
                            {"guard_factor", analysis.rule.guard_factor}};
    run["risk"] = {{"judged", analysis.risk.judged},
                   {"each", analysis.risk.each},
                   {"wrong_pass", analysis.risk.false_acceptance},
                   {"wrong_fail", analysis.risk.false_rejection}};
    run["conditions"] = json_list(analysis.conditions, condition_json);
    run["reasons"] = analysis.reasons;
    add_present(run, "pixels", analysis.pixels, pixels_json);
    add_present(run, "causes", analysis.causes, causes_json);
    run["detection"] = {{"training", analysis.detection.training},
                        {"training_detected", analysis.detection.training_detected},
                        {"hold_out", analysis.detection.hold_out},
                        {"hold_out_detected", analysis.detection.hold_out_detected},
                        {"rate", analysis.detection.rate()}};
    add_present(run, "registration", analysis.registration, registration_json);
    if (analysis.position_field)
        run["position_field_mm"] = field_json(*analysis.position_field, analysis.position_summary);
    if (analysis.rotation_field)
        run["rotation_field_rad"] = field_json(*analysis.rotation_field, analysis.rotation_summary);
    add_present(run, "position_rest_mm", analysis.position_lack_of_fit);
    add_present(run, "lengths", analysis.lengths);
    if (analysis.photometric)
        run["photometric_position_field_mm"] = field_json(analysis.photometric->position_field,
                                                          analysis.photometric->position_summary);
    run["budget_complete"] = analysis.budget_complete;
    run["budget"] = json_list(analysis.budget, budget_row_json);
    run["gauge_report"] = analysis.signatures;
}

// ---- junit.xml

struct TestCase {
    std::string name, text;  // text: what was found, in one sentence
    std::string element;     // "failure", "error", "skipped"; empty: passed
    std::string outcome;     // "INCONCLUSIVE"
};

// XML 1.0 has no control characters; what is not ASCII is replaced, as it may not be UTF-8.
std::string xml_text(const std::string& text) {
    std::string plain = text;
    for (char& c : plain)
        if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7e)
            c = c == '\n' ? ' ' : '?';
    return escape_html(plain);
}

constexpr const char* element_of_outcome[] = {"", "failure", "error", "skipped", "skipped"};

std::string measured_text(const JudgedQuantity& quantity) {
    if (quantity.outcome == Outcome::skipped)
        return quantity.reason;
    const std::string text =
        fmt::format("{:.4g} {} with U = {:.3g} {} (k = {:.3g}) against a limit of {:.4g} {}",
                    quantity.value, quantity.unit, quantity.expanded_uncertainty, quantity.unit,
                    quantity.coverage_factor, quantity.limit, quantity.unit);
    return quantity.reason.empty() ? text : text + ": " + quantity.reason;
}

TestCase verdict_case(const QualifyResult& result) {
    TestCase verdict{"verdict", result.reason, "error", name(result.outcome)};
    if (result.outcome == RunOutcome::pass)
        verdict.element = "";
    if (result.outcome == RunOutcome::fail)
        verdict.element = "failure";
    if (verdict.text.empty() && result.analysis)
        verdict.text = fmt::format("{}", fmt::join(result.analysis->reasons, " "));
    return verdict;
}

std::vector<TestCase> cases_of(const QualifyResult& result) {
    std::vector<TestCase> cases;
    if (result.analysis)
        for (const JudgedQuantity& quantity : result.analysis->quantities)
            cases.push_back({quantity.name, measured_text(quantity),
                             element_of_outcome[static_cast<std::size_t>(quantity.outcome)],
                             name(quantity.outcome)});
    cases.push_back(verdict_case(result));
    return cases;
}

std::string xml_of(const TestCase& test, const std::string& class_name) {
    std::string xml = fmt::format("    <testcase classname=\"{}\" name=\"{}\" time=\"0\">",
                                  xml_text(class_name), xml_text(test.name));
    if (test.element == "skipped")
        xml += fmt::format("<skipped message=\"{}: {}\"/>", test.outcome, xml_text(test.text));
    else if (!test.element.empty())
        xml += fmt::format("<{0} type=\"{1}\" message=\"{2}\">{2}</{0}>", test.element,
                           test.outcome, xml_text(test.text));
    else
        xml += fmt::format("<system-out>{}</system-out>", xml_text(test.text));
    return xml + "</testcase>\n";
}

}  // namespace

std::string run_json(const QualifyResult& result) {
    const StationFile& station = result.station;
    Json run = {
        {"etalon", "run/1"},
        {"outcome", name(result.outcome)},
        {"reason", result.reason},
        {"started_utc", result.started_utc},
        {"duration_s", result.duration_s},
        {"sessions", json_rows(table_of(session_columns(), result.sessions))},
        {"station", station.id},
        {"marker", station.marker.spec},
        {"detector", station.detector},
        {"background", station.background},
        {"white_level", station.white_level},
        {"carriage_from_marker_nominal", pose_numbers(station.carriage_from_marker_nominal)},
        {"marker_size_uncertainty", or_null(station.marker_size_uncertainty)},
        {"marker_flatness_mm", or_null(station.marker_flatness_mm)},
        {"environment", environment_json(result)},
        {"references", station.references},
        {"limits", station.limits.id},
        {"due_after_days", or_null(station.limits.due_after_days)},
        {"inputs", inputs_json(station.inputs)},
        {"camera", camera_json(result)},
        {"stage",
         {{"link", link_json(station.stage.link)},
          {"profile", station.stage.profile},
          {"axes", json_list(station.stage.axes, axis_json)},
          {"forbidden", forbidden_json(station.stage)}}},
        {"plan", plan_json(station, result.plan)},
        {"poses_visited", result.poses.size()}};
    if (result.analysis)
        add_analysis(run, *result.analysis);
    run["mean_residual_gray"] = or_null(mean_residual_gray(result));
    run["software"] = software_json(result.software);
    run["attachments"] = result.attachments;
    return text_of(run, 2) + "\n";
}

std::string poses_csv(const QualifyResult& result) {
    return csv_of(table_of(pose_columns(result.station.stage.axes, result.analysis.has_value()),
                           result.poses));
}

std::string convergence_csv(const QualifyResult& result) {
    std::string csv = "round,largest_move_px\n";
    if (!result.analysis || !result.analysis->registration)
        return csv;
    int round = 0;
    for (const double change : result.analysis->registration->changes_px)
        csv += fmt::format("{},{}\n", ++round, exact(change));
    return csv;
}

std::string junit_xml(const QualifyResult& result) {
    const std::vector<TestCase> cases = cases_of(result);
    const auto count = [&](const char* element) {
        return std::count_if(cases.begin(), cases.end(),
                             [&](const TestCase& test) { return test.element == element; });
    };
    const std::string counts = fmt::format(
        "tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\" time=\"{:.3f}\"", cases.size(),
        count("failure"), count("error"), count("skipped"), result.duration_s);
    const std::string camera =
        result.camera.serial.empty() ? result.camera.uri : result.camera.serial;
    std::string xml = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
    xml += fmt::format("<testsuites {}>\n  <testsuite name=\"{}\" {} timestamp=\"{}\">\n", counts,
                       xml_text("camera " + camera), counts, xml_text(result.started_utc));
    for (const TestCase& test : cases)
        xml += xml_of(test, "etalon." + result.station.id);
    return xml + "  </testsuite>\n</testsuites>\n";
}

}  // namespace etalon
