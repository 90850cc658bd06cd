#include "station/qualify/qualify_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "compare/match/overlay.h"
#include "compare/photometric/photometric_model.h"
#include "compare/verdict/judged_quantities.h"
#include "core/errors.h"
#include "core/text.h"
#include "report/html.h"
#include "report/number_text.h"
#include "station/qualify/report_plots.h"
#include "station/qualify/run_expectation.h"

namespace etalon {
namespace {

constexpr const char* unknown = "unknown";

std::string number(double value) {
    return significant(value, 3);
}

std::string joined(const std::vector<std::string>& parts, const std::string& separator) {
    return fmt::format("{}", fmt::join(parts, separator));
}

// A relative number in percent, a coefficient as it is, any other with its unit.
std::string with_unit(double value, const std::string& unit) {
    if (!std::isfinite(value))
        return "none";
    if (unit == "1")
        return significant(100.0 * value, 2) + " %";
    return unit.empty() ? significant(value, 2) : significant(value, 2) + " " + unit;
}

// The sentence under the verdict: the judged quantity that is nearest to its limit.
std::string deciding_sentence(const QualifyResult& result) {
    if (!result.analysis)
        return result.reason;
    const JudgedQuantity* deciding = nullptr;
    double worst = -1.0;
    for (const JudgedQuantity& each : result.analysis->quantities) {
        const double used = (each.value + each.expanded_uncertainty) / each.limit;
        if (each.outcome != Outcome::skipped && used > worst) {
            worst = used;
            deciding = &each;
        }
    }
    if (!deciding)
        return joined(result.analysis->reasons, " ");
    return fmt::format("{}: {} {} with U = {} {} (k = {:.2f}) against a limit of {} {}.",
                       quantity_kind(deciding->name).words, significant(deciding->value, 2),
                       deciding->unit, significant(deciding->expanded_uncertainty, 2),
                       deciding->unit, deciding->coverage_factor, number(deciding->limit),
                       deciding->unit);
}

std::string size_text(const CausingError& error) {
    return fmt::format("{} +- {}", with_unit(error.size, error.unit),
                       significant(error.expanded_uncertainty, 2));
}

// What to do about the named cause: each error's first remedy, or all of those that the run cannot
// tell apart.
std::string what_to_do(const Cause& cause) {
    std::string all;
    for (const CausingError& error : cause.errors) {
        const std::string one = fmt::format("{}", fmt::join(error.remedies, ", or "));
        all += (all.empty() ? "" : "; and ") + one;
    }
    all.front() = static_cast<char>(std::toupper(all.front()));
    return all + ".";
}

void add_causes(HtmlPage& page, const Causes& causes) {
    const Cause* named = causes.named();
    if (named)
        page.add_paragraph(fmt::format("Most probable cause ({:.0f} %): {}. What to do: {}",
                                       100.0 * named->probability, named->text(),
                                       what_to_do(*named)));
    else if (causes.none_of_these > 0.5)
        page.add_paragraph("What differs is none of the errors that are looked for.");
    if (causes.ranked.empty() || causes.no_error > 0.5)
        return;
    TableRows rows;
    for (const Cause& cause : causes.ranked) {
        std::string sizes;
        for (const CausingError& error : cause.errors)
            sizes += (sizes.empty() ? "" : "; ") + size_text(error);
        rows.push_back({fmt::format("{:.0f} %", 100.0 * cause.probability), cause.text(), sizes});
    }
    rows.push_back({fmt::format("{:.0f} %", 100.0 * causes.none_of_these), "none of these", ""});
    rows.push_back({fmt::format("{:.0f} %", 100.0 * causes.no_error), "no error", ""});
    page.add_table({"probability", "cause (~: cannot be told apart)", "size and U"}, rows);
}

void add_summary(HtmlPage& page, const QualifyResult& result) {
    page.add_verdict(name(result.outcome), deciding_sentence(result));
    Facts facts{
        {"Camera", joined({result.camera.vendor, result.camera.model, result.camera.serial}, " ")},
        {"Station", result.station.id},
        {"Limits", result.station.limits.id},
        {"Marker", result.station.marker.spec},
        {"Poses measured", fmt::format("{} of {}", result.poses.size(), result.plan.poses.size())},
        {"Duration", fmt::format("{:.0f} s", result.duration_s)}};
    if (result.analysis) {
        facts.emplace_back("Marker detected",
                           fmt::format("{:.1f} %", 100.0 * result.analysis->detection.rate()));
        if (result.analysis->registration)
            facts.emplace_back(
                "Registration residual",
                fmt::format("{} px RMS",
                            number(result.analysis->registration->registration.residual_rms_px)));
    }
    page.add_facts(facts);
    if (!result.analysis)
        return;
    for (const std::string& reason : result.analysis->reasons)
        page.add_paragraph(reason);
    if (result.analysis->pixels)
        for (const std::string& finding : result.analysis->pixels->findings)
            page.add_paragraph("Photographs and renders: " + finding + ".");
    if (result.analysis->causes)
        add_causes(page, *result.analysis->causes);
}

// A value of exactly 0 is a finding, not a gap.
std::string note_of(const JudgedQuantity& quantity) {
    const bool measured = quantity.outcome != Outcome::skipped;
    if (quantity.reason.empty() && measured && quantity.value == 0.0)
        return "the field is no stronger than noise alone makes it";
    return quantity.reason;
}

std::vector<std::string> quantity_row(const JudgedQuantity& each, bool is_judged) {
    const auto figure = [&](double value) { return each.measured ? significant(value, 2) : dash; };
    return {quantity_kind(each.name).words,
            figure(each.value),
            figure(each.expanded_uncertainty),
            figure(each.coverage_factor),
            significant(each.monte_carlo_uncertainty, 3),
            is_judged ? number(each.limit) : "none",
            each.unit,
            is_judged ? name(each.outcome) : "reported",
            is_judged ? note_of(each) : ""};
}

void add_conditions(HtmlPage& page, const Qualification& analysis) {
    if (analysis.conditions.empty())
        return;
    page.add_heading("Conditions for a PASS");
    TableRows rows;
    for (const AcceptanceCondition& each : analysis.conditions)
        rows.push_back({each.name, name(each.state), each.text});
    page.add_table({"condition", "this run", "found"}, rows);
}

void add_judged(HtmlPage& page, const Qualification& analysis) {
    page.add_heading("Judged on the hold-out poses");
    TableRows rows;
    for (const JudgedQuantity& each : analysis.quantities)
        rows.push_back(quantity_row(each, true));
    for (const JudgedQuantity& each : analysis.reported)
        rows.push_back(quantity_row(each, false));
    page.add_table(
        {"quantity", "value", "U", "k", "U by Monte Carlo", "limit", "unit", "outcome", "note"},
        rows);
    page.add_paragraph(fmt::format(
        "Risks: a camera with any judged quantity at its limit gets PASS in at most {:.1f} % of "
        "runs; one with all {} judged quantities at their limits gets FAIL in at most {:.1f} %.",
        100.0 * analysis.risk.wrong_pass, analysis.risk.judged, 100.0 * analysis.risk.wrong_fail));
    page.add_paragraph(
        "value + U <= limit is PASS, value - U > limit is FAIL, anything between is INCONCLUSIVE. "
        "Judged is a smooth field of the bias over the volume, never its mean: registration makes "
        "the mean vanish whatever the camera.");
}

void add_unseen(HtmlPage& page, const Qualification& analysis) {
    page.add_heading("What this run could and could not see");
    page.add_paragraph(
        "Each error was pushed through this run's own poses, noise and registration. An error "
        "smaller than the size it takes to be seen hides in the noise; errors that look the same "
        "change the measured field in the same way, and only their sum is judged. A constant pose "
        "offset is never observable here: the registration of stage and camera absorbs it.");
    TableRows rows;
    for (const ErrorSignature& each : analysis.signatures)
        rows.push_back({each.name, each.observable ? "seen" : "NOT_OBSERVABLE",
                        with_unit(each.detectable_size, each.unit), with_unit(each.size, each.unit),
                        significant(each.before_rms_mm, 2), significant(each.after_rms_mm, 2),
                        joined(each.confounded_with, ", ")});
    page.add_table(
        {"error", "this run", "size it takes to be seen", "an error of", "moves poses by / mm RMS",
         "left after registration / mm RMS", "looks the same as"},
        rows);
}

// Mean and standard deviation of one component of one bias over the hold-out poses.
std::vector<std::string> bias_row(const std::string& label, const std::vector<Pose>& poses,
                                  std::optional<PoseError> PoseBias::*bias,
                                  Eigen::Vector3d PoseError::*part, int axis, double unit) {
    std::vector<double> values;
    for (const Pose& pose : poses)
        if (const auto& error = pose.bias.*bias; pose.hold_out && error)
            values.push_back(((*error).*part)(axis) / unit);
    if (values.size() < 2)
        return {label, dash, dash, dash, fmt::format("{}", values.size())};
    double mean = 0.0, squares = 0.0, largest = 0.0;
    for (const double value : values)
        mean += value / static_cast<double>(values.size());
    for (const double value : values) {
        squares += (value - mean) * (value - mean);
        largest = std::max(largest, std::abs(value));
    }
    const double deviation = std::sqrt(squares / static_cast<double>(values.size() - 1));
    return {label, number(mean), number(deviation), number(largest),
            fmt::format("{}", values.size())};
}

void add_biases(HtmlPage& page, const std::vector<Pose>& poses) {
    page.add_heading("Pose biases on the hold-out poses");
    page.add_paragraph(
        "B1 is what the detector does to a perfect image: detector(render) - truth. B2 compares "
        "the "
        "photographs with the registered stage, B3 with renders at the registered stage; B3 is "
        "what "
        "is left of camera model and stage when the detector's own bias is out. B1 and B2 are "
        "reported and not judged.");
    constexpr double mrad = 1e-3;
    TableRows rows;
    const std::pair<const char*, std::optional<PoseError> PoseBias::*> biases[] = {
        {"B1", &PoseBias::b1}, {"B2", &PoseBias::b2}, {"B3", &PoseBias::b3}, {"B4", &PoseBias::b4}};
    for (const auto& [label, bias] : biases) {
        for (int axis = 0; axis < 3; ++axis)
            rows.push_back(bias_row(fmt::format("{} t{} / mm", label, "xyz"[axis]), poses, bias,
                                    &PoseError::translation_mm, axis, 1.0));
        for (int axis = 0; axis < 3; ++axis)
            rows.push_back(bias_row(fmt::format("{} r{} / mrad", label, "xyz"[axis]), poses, bias,
                                    &PoseError::rotation_rad, axis, mrad));
    }
    page.add_table({"component", "mean", "standard deviation", "largest", "poses"}, rows);
}

// Which quantities the budget is shown for, and how.
struct BudgetColumn {
    const char* quantity;
    const char* heading;
};
constexpr BudgetColumn budget_columns[] = {
    {quantity::position_rms, "in the position field's RMS / mm"},
    {quantity::position_max, "in its maximum / mm"},
    {quantity::length_max, "in lengths / mm"},
    {quantity::rotation_rms, "in the rotation field's RMS / mrad"}};

std::string contribution(const BudgetRow& row, const char* quantity) {
    if (!row.sensitivity.contains(quantity))
        return dash;
    if (row.standard_uncertainty)
        return number(row.contribution(quantity));
    return row.widest ? "up to " + number(row.sensitivity.at(quantity) * *row.widest) : unknown;
}

void add_budget(HtmlPage& page, const Qualification& analysis) {
    page.add_heading("Uncertainty budget");
    std::vector<std::string> headings{"source", "standard uncertainty", "unit", "distribution",
                                      "degrees of freedom"};
    for (const BudgetColumn& column : budget_columns)
        headings.emplace_back(column.heading);
    headings.emplace_back("from");
    TableRows rows;
    for (const BudgetRow& row : analysis.budget) {
        std::vector<std::string> cells{
            row.source, significant(row.standard_uncertainty, 3, unknown), row.unit,
            name(row.distribution),
            std::isfinite(row.degrees_of_freedom) ? number(row.degrees_of_freedom) : "∞"};
        for (const BudgetColumn& column : budget_columns)
            cells.push_back(contribution(row, column.quantity));
        cells.push_back(row.counted ? row.basis : "not in U: " + row.basis);
        rows.push_back(cells);
    }
    page.add_table(headings, rows);
    page.add_paragraph(
        "Contributions are standard uncertainties and add in quadrature; the coverage factor of U "
        "follows from the effective degrees of freedom (Welch-Satterthwaite).");
    if (!analysis.budget_complete)
        page.add_paragraph(
            "A source marked unknown is not zero. Where it could change the outcome there is no "
            "PASS with it.");
}

void add_registration(HtmlPage& page, const BiasCorrectedRegistration& corrected) {
    const Registration& registration = corrected.registration;
    page.add_heading("Registration of stage and camera");
    page.add_facts(
        {{"Training poses used", fmt::format("{}", corrected.used.size())},
         {"Their motion", registration.motion},
         {"Rounds of bias correction", fmt::format("{}", corrected.rounds)},
         {"Rank", fmt::format("{} of 12", registration.rank)},
         {"Condition number", number(registration.condition_number)},
         {"Residual", fmt::format("{} px RMS", number(registration.residual_rms_px))},
         {"Points held for outliers", fmt::format("{}", registration.down_weighted_points)}});
    for (const GaugeFreedom& freedom : registration.freedoms)
        page.add_paragraph("Not determined by this stage's motion, fixed by the nominal mount: " +
                           freedom.name + ".");
    for (const WeakDirection& weak : registration.weak)
        page.add_paragraph(fmt::format(
            "Badly determined: {}, standard deviation {} {}. All poses say less about it than one "
            "would if the mounting were known.",
            weak.name, number(std::sqrt(registration.reduced_squares) * weak.deviation),
            weak.is_shift() ? "mm" : "rad"));
    const auto row = [](const std::string& label, const Rigid& transform) {
        const Vector6d pose = vector_from_rigid(transform);
        std::vector<std::string> cells{label};
        for (int i = 0; i < 6; ++i)
            cells.push_back(fmt::format("{:.{}f}", pose(i), i < 3 ? 5 : 3));
        return cells;
    };
    page.add_table(
        {"transform", "rx / rad", "ry / rad", "rz / rad", "tx / mm", "ty / mm", "tz / mm"},
        {row("camera_from_base", registration.camera_from_base),
         row("carriage_from_marker", registration.carriage_from_marker)});
}

// ---- photographs against renders ------------------------------------------------------------

struct Extreme {
    const Pose* pose;
    std::string label;
};

// Four hold-out poses worth looking at: nearest, farthest, most off-axis, largest bias.
std::vector<Extreme> poses_to_show(const QualifyResult& result) {
    struct Wanted {
        const char* label;
        double (*score)(const PoseBias&);
    };
    const Wanted wanted[] = {
        {"nearest", [](const PoseBias& b) { return -b.predicted.translation.z(); }},
        {"farthest", [](const PoseBias& b) { return b.predicted.translation.z(); }},
        {"most off-axis", [](const PoseBias& b) { return off_axis_tangent(b.predicted); }},
        {"largest position bias",
         [](const PoseBias& b) { return b.b3 ? b.b3->translation_mm.norm() : -1e300; }}};
    std::vector<Extreme> shown;
    for (const Wanted& each : wanted) {
        const Pose* best = nullptr;
        for (const Pose& pose : result.poses)
            if (!pose.render_file.empty() &&
                (!best || each.score(pose.bias) > each.score(best->bias)))
                best = &pose;
        const auto twin = std::ranges::find(shown, best, &Extreme::pose);
        if (twin != shown.end())
            twin->label += std::string(", ") + each.label;
        else if (best)
            shown.push_back({best, each.label});
    }
    return shown;
}

// The part of the image around the marker, with room for its blur.
cv::Rect marker_crop(const std::vector<Eigen::Vector2d>& corners, const cv::Size& size) {
    std::vector<cv::Point2f> points;
    for (const Eigen::Vector2d& corner : corners)
        points.emplace_back(static_cast<float>(corner.x()), static_cast<float>(corner.y()));
    cv::Rect box = cv::boundingRect(points);
    const int room = std::max(8, std::max(box.width, box.height) / 4);
    box -= cv::Point(room, room);
    box += cv::Size(2 * room, 2 * room);
    return box & cv::Rect(cv::Point(), size);
}

// Photograph, render and their overlay side by side, enlarged to whole multiples.
cv::Mat comparison_strip(const cv::Mat& photo_gray, const cv::Mat& render_gray, double gain) {
    cv::Mat panels[3], strip;
    for (int i = 0; i < 2; ++i) {
        cv::Mat eight_bit;
        (i == 0 ? photo_gray : render_gray).convertTo(eight_bit, CV_8U);
        cv::cvtColor(eight_bit, panels[i], cv::COLOR_GRAY2BGR);
    }
    const cv::Mat everywhere(photo_gray.size(), CV_8UC1, cv::Scalar(255));
    panels[2] = red_cyan_overlay(photo_gray, render_gray, everywhere, gain);
    cv::hconcat(panels, 3, strip);
    const int factor = std::max(1, 900 / strip.cols);
    cv::resize(strip, strip, {}, factor, factor, cv::INTER_NEAREST);
    return strip;
}

HtmlPage::Figure pose_figure(const QualifyResult& result, const Extreme& shown) {
    constexpr double gain = 4.0;
    const Pose& pose = *shown.pose;
    const std::string caption = fmt::format(
        "Pose {} ({}): photograph, render, and their difference enlarged {:.0f} times (red: the "
        "photograph is brighter, cyan: the render is).",
        pose.index, shown.label, gain);
    try {
        const CodeImage photo = recorded_photo(result, *first_whole(pose));
        const CodeImage render = read_image(result.folder / pose.render_file);
        const cv::Rect crop = marker_crop(pose.corners, photo.pixels.size());
        const cv::Mat strip = comparison_strip(gray_of({photo.pixels(crop), photo.bits}),
                                               gray_of({render.pixels(crop), photo.bits}), gain);
        return {embedded_png(strip, caption), caption};
    } catch (const ConfigError& error) {
        return {"<p>" + escape_html(error.what()) + "</p>", caption};
    }
}

void add_pictures(HtmlPage& page, const QualifyResult& result) {
    const std::vector<Extreme> shown = poses_to_show(result);
    if (shown.empty())
        return;
    page.add_heading("Photograph against render");
    add_residual_summary(page, result);
    HtmlPage::Figures figures;
    for (const Extreme& each : shown)
        figures.push_back(pose_figure(result, each));
    page.add_figures(figures);
}

// ---- the run --------------------------------------------------------------------------------

void add_run(HtmlPage& page, const QualifyResult& result) {
    const CaptureStatistics counters = result.statistics();
    page.add_heading("The run");
    page.add_facts({{"Started", result.started_utc},
                    {"Camera address", result.camera.uri},
                    {"Frames delivered", fmt::format("{}", counters.delivered)},
                    {"Frames rejected and triggered again", fmt::format("{}", counters.rejected)},
                    {"Packets missed", fmt::format("{}", counters.missing_packets)},
                    {"Exposure", fmt::format("{} µs", result.settings.exposure.count())},
                    {"Gain", fmt::format("{} dB", number(result.settings.gain_db))},
                    {"Image", fmt::format("{} x {} px, {} bit", result.settings.width,
                                          result.settings.height, result.settings.bits)}});
    for (const std::string& remark : result.remarks)
        page.add_paragraph(remark);
    TableRows inputs;
    for (const InputFile& input : result.station.inputs)
        inputs.push_back({input.role, input.path.filename().string(), input.sha256});
    page.begin_details("Input files and software");
    page.add_table({"input", "file", "SHA-256"}, inputs);
    page.add_software(result.software);
    page.end_details();
}

void add_analysis(HtmlPage& page, const QualifyResult& result) {
    const Qualification& analysis = *result.analysis;
    add_judged(page, analysis);
    add_conditions(page, analysis);
    add_bias_plots(page, result);
    add_pictures(page, result);
    add_unseen(page, analysis);
    add_biases(page, result.poses);
    add_run_expectation(page, result);
    add_budget(page, analysis);
    if (analysis.registration)
        add_registration(page, *analysis.registration);
}

}  // namespace

void write_qualify_report(const QualifyResult& result, const std::filesystem::path& path) {
    const std::string camera =
        result.camera.serial.empty() ? result.camera.uri : result.camera.serial;
    HtmlPage page("Qualification of camera " + camera,
                  fmt::format("Station {}, {}", result.station.id, result.started_utc));
    add_summary(page, result);
    if (result.analysis)
        add_analysis(page, result);
    add_run(page, result);
    write_text(path, page.finish());
}

}  // namespace etalon
