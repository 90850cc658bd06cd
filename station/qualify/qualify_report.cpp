#include "station/qualify/run_analysis.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <opencv2/imgproc.hpp>

#include <tuple>

#include "compare/match/overlay.h"
#include "compare/qualification/judged_quantities.h"
#include "core/file/text.h"
#include "report/number_text.h"
#include "report/svg_plot.h"

namespace etalon {
namespace {

constexpr const char* unknown = "unknown";

std::string joined(const std::vector<std::string>& parts, const std::string& separator) {
    return fmt::format("{}", fmt::join(parts, separator));
}

// Factor and " mm": a relative number is shown in percent, a coefficient as it is.
std::pair<double, std::string> read_unit(const std::string& unit) {
    return unit == "1" ? std::pair(100.0, " %") : std::pair(1.0, unit.empty() ? "" : " " + unit);
}

std::string with_unit(double value, const std::string& unit) {
    const auto [factor, text] = read_unit(unit);
    return std::isfinite(value) ? significant(factor * value, 2) + text : "none";
}

// ---- verdict, cause, what to do -------------------------------------------------------------

// The one nearest to its limit, or farthest beyond; null when none was measured.
const JudgedQuantity* deciding_quantity(const Qualification& analysis) {
    const JudgedQuantity* deciding = nullptr;
    double worst = -1.0;
    for (const JudgedQuantity& each : analysis.quantities) {
        const double used = (each.value + each.expanded_uncertainty) / each.limit;
        if (each.outcome != Outcome::skipped && used > worst) {
            worst = used;
            deciding = &each;
        }
    }
    return deciding;
}

std::string deciding_sentence(const JudgedQuantity& deciding) {
    const std::string& unit = deciding.unit;
    std::string text =
        fmt::format("{}: {} {}", quantity_kind(deciding.name).words,
                    value_or_below(deciding.value, deciding.expanded_uncertainty, 2), unit);
    if (deciding.value != 0.0)
        text +=
            fmt::format(", U = {} {} (k = {:.2f})", significant(deciding.expanded_uncertainty, 2),
                        unit, deciding.coverage_factor);
    return text + fmt::format("; the limit is {} {}.", significant(deciding.limit, 3), unit);
}

// A line of the analysis or the station as a sentence.
std::string sentence(std::string text) {
    if (text.empty())
        return text;
    text.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(text.front())));
    return text.back() == '.' ? text : text + ".";
}

// Why there is no PASS, beside the deciding quantity; names of quantities in words.
std::vector<std::string> other_reasons(const Qualification& analysis,
                                       const JudgedQuantity* deciding) {
    std::vector<std::string> reasons;
    for (std::string reason : analysis.reasons) {
        const std::string first = reason.substr(0, reason.find(' '));
        if (deciding && first == deciding->name)
            continue;
        const auto kind = std::ranges::find(quantity_kinds(), first, &QuantityKind::name);
        if (kind != quantity_kinds().end())
            reason.replace(0, first.size(), kind->words);
        reasons.push_back(sentence(reason));
    }
    return reasons;
}

// Empty for what has no size, as an exposure that is too long.
std::string size_text(const CausingError& error) {
    if (!(error.expanded_uncertainty > 0.0))
        return "";
    const auto [factor, unit] = read_unit(error.unit);
    const double expanded = factor * error.expanded_uncertainty;
    const int decimals = decimals_of(expanded);
    return fmt::format("{} ± {}{}", fixed(factor * error.size, decimals), fixed(expanded, decimals),
                       unit);
}

std::string percent(double probability) {
    return fmt::format("{:.0f} %", 100.0 * probability);
}

std::vector<std::string> cause_sentences(const Causes& causes) {
    if (const Cause* named = causes.named()) {
        std::vector<std::string> sentences;
        for (const CausingError& error : named->errors)
            sentences.push_back(
                size_text(error).empty()
                    ? error.text() + "."
                    : fmt::format("{}: {} (U, k = 2).", error.text(), size_text(error)));
        if (const auto others = named->alternatives(); !others.empty())
            sentences.push_back(fmt::format("Or in place of these: {}.", joined(others, "; ")));
        sentences.back() += fmt::format(" Probability {}.", percent(named->probability));
        return sentences;
    }
    if (causes.no_error > 0.5)
        return {fmt::format("None: noise and what the station declares explain what was seen ({}).",
                            percent(causes.no_error))};
    if (causes.none_of_these > 0.5)
        return {"What differs is none of the errors that are looked for."};
    if (!causes.ranked.empty())
        return {"No single one is more probable than not; the table of causes has them all."};
    return {};
}

// Each as a sentence.
std::vector<std::string> sentences(std::vector<std::string> texts) {
    std::ranges::transform(texts, texts.begin(), sentence);
    return texts;
}

void add_summary(HtmlPage& page, const QualifyResult& result) {
    if (!result.analysis) {
        page.add_verdict(name(result.outcome), result.reason);
        return;
    }
    const Qualification& analysis = *result.analysis;
    const JudgedQuantity* deciding = deciding_quantity(analysis);
    const Causes causes = analysis.causes.value_or(Causes{});
    const Cause* named = causes.named();
    using Texts = std::vector<std::string>;
    page.add_verdict(name(result.outcome),
                     deciding ? deciding_sentence(*deciding) : "Nothing could be judged.",
                     {{"Most probable cause", cause_sentences(causes)},
                      {"What to do", named ? sentences(named->remedies()) : Texts()},
                      {result.outcome == RunOutcome::pass ? "Remarks" : "Why it is not PASS",
                       other_reasons(analysis, deciding)},
                      {"Photographs against renders",
                       analysis.pixels ? sentences(analysis.pixels->findings) : Texts()}});
}

void add_causes(HtmlPage& page, const Causes& causes) {
    if (causes.ranked.empty() || causes.no_error > 0.5)
        return;
    TableRows rows;
    for (const Cause& cause : causes.ranked) {
        std::vector<std::string> sizes;
        for (const CausingError& error : cause.errors)
            sizes.push_back(size_text(error));
        rows.push_back({cause.text(), percent(cause.probability), joined(sizes, "; ")});
    }
    rows.push_back({"none of these", percent(causes.none_of_these), ""});
    rows.push_back({"no error", percent(causes.no_error), ""});
    page.add_heading("Causes");
    page.add_table({"cause", "probability", "size, U with k = 2"}, rows);
    page.add_notes({"What ~ joins explains the same: this run cannot tell it apart."});
}

// ---- what was judged ------------------------------------------------------------------------

std::vector<std::string> quantity_row(const JudgedQuantity& each, bool is_judged) {
    const auto figure = [&](double value) { return each.measured ? significant(value, 2) : dash; };
    return {quantity_kind(each.name).words,
            is_judged ? name(each.outcome) : "no limit",
            each.measured ? value_or_below(each.value, each.expanded_uncertainty, 2) : dash,
            figure(each.expanded_uncertainty),
            figure(each.coverage_factor),
            is_judged ? significant(each.limit, 3) : dash,
            each.unit};
}

// Each reason once, behind the quantities that it is given for.
std::vector<std::string> quantity_notes(const Qualification& analysis) {
    std::map<std::string, std::vector<std::string>> by_reason;
    for (const JudgedQuantity& each : analysis.quantities)
        if (!each.reason.empty())
            by_reason[each.reason].emplace_back(quantity_kind(each.name).words);
    std::vector<std::string> notes;
    for (const auto& [reason, quantities] : by_reason)
        notes.push_back(joined(quantities, "; ") + ": " + reason + ".");
    return notes;
}

void add_judged(HtmlPage& page, const Qualification& analysis) {
    page.add_heading("Judged on the hold-out poses");
    TableRows rows;
    for (const JudgedQuantity& each : analysis.quantities)
        rows.push_back(quantity_row(each, true));
    for (const JudgedQuantity& each : analysis.reported)
        rows.push_back(quantity_row(each, false));
    page.add_table({"quantity", "outcome", "value", "U", "k", "limit", "unit"}, rows);
    std::vector<std::string> notes = quantity_notes(analysis);
    notes.insert(
        notes.end(),
        {analysis.rule.sentence() + ". U is the expanded uncertainty, one-sided 97.7 %, and k its "
                                    "coverage factor; \"below\" U "
                                    "is a field that is no stronger than noise alone makes it.",
         "Judged is a smooth field of the bias over the volume, never its mean: registration makes "
         "the mean vanish whatever the camera.",
         fmt::format("A camera with any judged quantity at its limit gets PASS in at most {:.1f} % "
                     "of runs; one with all {} at their limits gets FAIL in at most {:.1f} %.",
                     100.0 * analysis.risk.false_acceptance, analysis.risk.judged,
                     100.0 * analysis.risk.false_rejection)});
    page.add_notes(notes);
    page.add_facts(
        {{"B1, reported",
          "Bias of the detector: the pose found in a render less the pose that was rendered."},
         {"B2, reported",
          "The pose found in the photograph less the one that stage and registration give."},
         {"B3, judged",
          "The pose found in the photograph less the one found in its render: the "
          "detector's own bias drops out, camera model and stage are left."},
         {"B4", "As B3, of photometric poses: fitted to all pixels in place of corners."}});
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
         "left after registration / mm RMS", "confounded with"},
        rows);
}

// Mean and standard deviation of one component of a bias.
std::vector<std::string> bias_row(const std::string& label, const std::vector<double>& values) {
    const auto n = static_cast<double>(values.size());
    const std::string count = fmt::format("{}", values.size());
    if (values.size() < 2)
        return {label, dash, dash, dash, count};
    double mean = 0.0, squares = 0.0, largest = 0.0;
    for (const double value : values)
        mean += value / n;
    for (const double value : values) {
        squares += (value - mean) * (value - mean);
        largest = std::max(largest, std::abs(value));
    }
    return {label, significant(mean, 3), significant(std::sqrt(squares / (n - 1.0)), 3),
            significant(largest, 3), count};
}

void add_biases(HtmlPage& page, const std::vector<AnalysedPose>& poses) {
    page.add_heading("Pose biases on the hold-out poses");
    page.add_paragraph(
        "Mean and scatter by component, in the camera frame. Judged is the field of B3 and, where "
        "there is a limit, of B4; B1 and B2 are reported.");
    TableRows rows;
    for (const auto& [label, bias] :
         {std::pair("B1", &PoseBias::b1), std::pair("B2", &PoseBias::b2),
          std::pair("B3", &PoseBias::b3), std::pair("B4", &PoseBias::b4)})
        for (const auto& [name, part, unit] :
             {std::tuple("{} t{} / mm", &PoseError::translation_mm, 1.0),
              std::tuple("{} r{} / mrad", &PoseError::rotation_rad, 1e-3)})
            for (int axis = 0; axis < 3; ++axis) {
                std::vector<double> values;
                for (const AnalysedPose& pose : poses)
                    if (const auto& error = pose.bias.*bias; pose.hold_out && error)
                        values.push_back(((*error).*part)(axis) / unit);
                rows.push_back(
                    bias_row(fmt::format(fmt::runtime(name), label, "xyz"[axis]), values));
            }
    page.add_table({"component", "mean", "standard deviation", "largest", "poses"}, rows);
}

// Which quantities the budget is shown for, with their headings.
constexpr std::pair<const char*, const char*> budget_columns[] = {
    {quantity::position_rms, "RMS / mm"},
    {quantity::position_max, "maximum / mm"},
    {quantity::length_max, "lengths / mm"},
    {quantity::rotation_rms, "rotation / mrad"}};

std::string contribution(const BudgetRow& row, const char* quantity) {
    if (!row.sensitivity.contains(quantity))
        return dash;
    if (row.standard_uncertainty)
        return significant(row.contribution(quantity), 2);
    return row.widest ? "up to " + significant(row.sensitivity.at(quantity) * *row.widest, 2)
                      : unknown;
}

// Degrees of freedom are said where they are not infinite.
std::string origin_of(const BudgetRow& row) {
    std::string text = row.counted ? row.basis : "not in U: " + row.basis;
    text += std::string("; ") + name(row.distribution);
    if (std::isfinite(row.degrees_of_freedom))
        text += fmt::format(", {:.0f} degrees of freedom", row.degrees_of_freedom);
    return text;
}

void add_budget(HtmlPage& page, const Qualification& analysis) {
    page.add_heading("Uncertainty budget");
    std::vector<std::string> headings{"source", "u", "unit"};
    for (const auto& [quantity, heading] : budget_columns)
        headings.emplace_back(heading);
    headings.emplace_back("from");
    TableRows rows;
    for (const BudgetRow& row : analysis.budget) {
        std::vector<std::string> cells{row.source,
                                       significant(row.standard_uncertainty, 2, unknown), row.unit};
        for (const auto& [quantity, heading] : budget_columns)
            cells.push_back(contribution(row, quantity));
        cells.push_back(origin_of(row));
        rows.push_back(cells);
    }
    page.add_table(headings, rows);
    std::vector<std::string> notes{
        "u is the source's standard uncertainty; RMS, maximum, lengths and rotation are what it "
        "contributes to the position field's RMS and maximum, to lengths and to the rotation "
        "field's RMS. Contributions add in quadrature; the coverage factor of U follows from the "
        "effective degrees of freedom (Welch-Satterthwaite)."};
    for (const JudgedQuantity& each : analysis.quantities)
        if (each.monte_carlo_uncertainty)
            notes.push_back(fmt::format("Propagated by Monte Carlo, U is {} {}: {}.",
                                        significant(*each.monte_carlo_uncertainty, 2), each.unit,
                                        quantity_kind(each.name).words));
    if (!analysis.budget_complete)
        notes.emplace_back(
            "A source marked unknown is not zero. Where it could change the outcome there is no "
            "PASS with it.");
    page.add_notes(notes);
}

void add_registration(HtmlPage& page, const BiasCorrectedRegistration& corrected) {
    const Registration& registration = corrected.registration;
    page.add_heading("Registration of stage and camera");
    page.add_facts(
        {{"Training poses used", fmt::format("{}", corrected.used.size())},
         {"Stage motion", registration.motion},
         {"Rounds of bias correction", fmt::format("{}", corrected.rounds)},
         {"Rank", fmt::format("{} of 12", registration.rank)},
         {"Condition number", significant(registration.condition_number, 3)},
         {"Residual", fmt::format("{} px RMS", significant(registration.residual_rms_px, 3))},
         {"Points flagged as outliers", fmt::format("{}", registration.down_weighted_points)}});
    std::vector<std::string> notes;
    for (const GaugeFreedom& freedom : registration.freedoms)
        notes.push_back("Not determined by this stage's motion, fixed by the nominal mount: " +
                        freedom.name + ".");
    for (const PoorlyConstrainedDirection& weak : registration.weak)
        notes.push_back(fmt::format(
            "Badly determined: {}, standard deviation {} {}. All poses say less about it than one "
            "would if the mounting were known.",
            weak.name, significant(std::sqrt(registration.reduced_squares) * weak.deviation, 3),
            weak.is_shift() ? "mm" : "rad"));
    page.add_notes(notes);
    TableRows rows;
    for (const auto& [label, transform] :
         {std::pair("camera_from_base", registration.camera_from_base),
          std::pair("carriage_from_marker", registration.carriage_from_marker)}) {
        rows.push_back({label});
        for (int i = 0; const double number : pose_numbers(transform))
            rows.back().push_back(fixed(number, i++ < 3 ? 5 : 3));
    }
    page.add_table(
        {"transform", "rx / rad", "ry / rad", "rz / rad", "tx / mm", "ty / mm", "tz / mm"}, rows);
}

// ---- decision rule

// The decision rule and what each judgement risks; nothing where nothing was judged.
void add_decision(HtmlPage& page, const Qualification& analysis) {
    TableRows rows;
    for (const JudgedQuantity& each : analysis.quantities)
        if (const auto& risk = each.risk)
            rows.push_back({quantity_kind(each.name).words, name(each.outcome),
                            probability_text(risk->conformance), probability_text(risk->consumer),
                            probability_text(risk->producer), significant(risk->passes_95, 3),
                            significant(risk->passes_50, 3), significant(risk->passes_5, 3),
                            each.unit});
    if (rows.empty())
        return;
    page.add_heading("Decision rule: " + analysis.rule.name());
    page.add_table({"quantity", "outcome", "within its limit", "consumer's risk", "producer's risk",
                    "PASS in 95 %", "in 50 %", "in 5 %", "unit"},
                   rows);
    page.add_notes(
        {"Within its limit: how probable that is of the true value, from this measurement alone.",
         "Risks of the rule (JCGM 106): consumer's, that a value above its limit gets PASS; "
         "producer's, that one within it gets FAIL. With the prior of the limits file where it has "
         "one, otherwise the most that they can be.",
         "Operating characteristic: true values that get PASS in 95, 50 and 5 % of runs; a dash "
         "where no value does."});
}

// ---- bias over the volume

// Angle between the optical axis and the marker's centre.
double off_axis_deg(const Rigid& camera_from_marker) {
    const Eigen::Vector3d& p = camera_from_marker.translation;
    return std::atan2(std::hypot(p.x(), p.y()), p.z()) * deg_per_rad;
}

constexpr int map_width = 420, map_height = 340;  // three beside each other stay readable

// Hold-out poses with B3: place and angle of the marker's centre, bias, and fitted field there.
struct HoldOut {
    Series biases, field;
    std::array<Series, 3> by_depth, by_angle;  // x, y and z of the bias
    double span_mm = 1.0;                      // of the places, across
};

HoldOut hold_out_biases(const QualifyResult& result) {
    const Qualification& analysis = *result.analysis;
    const LensProjection& projection = result.station.camera.model.projection;
    HoldOut poses;
    for (const AnalysedPose& pose : result.poses) {
        if (!pose.hold_out || !pose.bias.b3)
            continue;
        const Eigen::Vector3d p = pose.bias.predicted.translation, b = pose.bias.b3->translation_mm;
        const Eigen::Vector3d field = analysis.position_field
                                          ? analysis.position_field->at(p)
                                          : Eigen::Vector3d::Constant(std::nan(""));
        const std::string note =
            fmt::format("pose {}: B3 = ({:.3f}, {:.3f}, {:.3f}) mm at ({:.0f}, {:.0f}, {:.0f}) mm",
                        pose.index, b.x(), b.y(), b.z(), p.x(), p.y(), p.z());
        poses.biases.add(p.head<2>(), b.head<2>(), note);
        poses.field.add(p.head<2>(), field.head<2>());
        for (int axis = 0; axis < 3; ++axis) {
            poses.by_depth[axis].add(depth_mm(projection, p), b(axis), note);
            poses.by_angle[axis].add(off_axis_deg(pose.bias.predicted), b(axis), note);
        }
        poses.span_mm = std::max({poses.span_mm, 2 * std::abs(p.x()), 2 * std::abs(p.y())});
    }
    return poses;
}

// The longest arrow is about a sixth of the plot's width.
HtmlPage::Figure arrow_figure(const HoldOut& poses) {
    const double longest = std::max({1e-9, poses.biases.longest(), poses.field.longest()});
    const double factor = round_scale(poses.span_mm / 6.0 / longest);
    SvgPlot plot("x / mm", "y / mm", map_width, map_height);
    plot.set_image_axes();
    plot.add_arrows(poses.field, factor, Color::gray, "fitted field");
    plot.add_arrows(poses.biases, factor, Color::blue, "B3");
    return {
        plot.svg(),
        fmt::format("B3 across the field of view, seen by the camera, enlarged {:g} times. Look "
                    "for arrows that turn or grow together: that is the field which is judged "
                    "(gray), the rest is noise.",
                    factor)};
}

HtmlPage::Figure component_figure(const std::array<Series, 3>& biases, const std::string& label,
                                  const std::string& caption, double limit) {
    SvgPlot plot(label, "B3 / mm", map_width, map_height);
    plot.add_points(biases[0], Color::blue, "x");
    plot.add_points(biases[1], Color::green, "y");
    plot.add_points(biases[2], Color::orange, "z");
    plot.add_level(limit, Color::red, fmt::format("limit of the maximum, {:g} mm", limit));
    plot.add_level(-limit, Color::red, "");
    return {plot.svg(), caption};
}

// B3 as arrows across the field of view, against depth and angle, with field and limit.
void add_bias_plots(HtmlPage& page, const QualifyResult& result) {
    const HoldOut poses = hold_out_biases(result);
    if (poses.biases.xs.empty())
        return;
    const double limit = result.station.limits.by_quantity.at(quantity::position_max);
    const bool is_flat = result.station.camera.model.projection.is_flat();
    page.add_heading("Bias over the volume");
    page.add_figures(
        {arrow_figure(poses),
         component_figure(poses.by_depth, is_flat ? "depth z / mm" : "distance / mm",
                          "B3 against depth. Look for z rising or falling with depth: focal "
                          "length, marker size or stage scale.",
                          limit),
         component_figure(poses.by_angle, "angle to the optical axis / deg",
                          "B3 against the distance from the axis. Look for points that leave "
                          "zero on the right: distortion.",
                          limit)});
}

// ---- photographs against renders ------------------------------------------------------------

// Hold-out poses worth looking at: nearest, farthest, most off-axis, largest bias; each once.
std::vector<std::pair<const AnalysedPose*, std::string>> poses_to_show(
    const QualifyResult& result) {
    using Score = std::function<double(const PoseBias&)>;
    const Score depth = [&](const PoseBias& b) {
        return depth_mm(result.station.camera.model.projection, b.predicted.translation);
    };
    const std::pair<std::string, Score> wanted[] = {
        {"nearest", [&](const PoseBias& b) { return -depth(b); }},
        {"farthest", depth},
        {"most off-axis", [](const PoseBias& b) { return off_axis_deg(b.predicted); }},
        {"largest position bias",
         [](const PoseBias& b) { return b.b3 ? b.b3->translation_mm.norm() : -1e300; }}};
    std::vector<std::pair<const AnalysedPose*, std::string>> shown;
    for (const auto& [label, score] : wanted) {
        const AnalysedPose* best = nullptr;
        for (const AnalysedPose& pose : result.poses)
            if (!pose.render_file.empty() && (!best || score(pose.bias) > score(best->bias)))
                best = &pose;
        const auto twin =
            std::ranges::find(shown, best, [](const auto& each) { return each.first; });
        if (twin != shown.end())
            twin->second += ", " + label;
        else if (best)
            shown.emplace_back(best, label);
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
    cv::Mat strip;
    cv::hconcat(photo_gray, render_gray, strip);
    strip.convertTo(strip, CV_8U);
    cv::cvtColor(strip, strip, cv::COLOR_GRAY2BGR);
    const cv::Mat everywhere(photo_gray.size(), CV_8UC1, cv::Scalar(255));
    cv::hconcat(strip, red_cyan_overlay(photo_gray, render_gray, everywhere, gain), strip);
    const int factor = std::max(1, 900 / strip.cols);
    cv::resize(strip, strip, {}, factor, factor, cv::INTER_NEAREST);
    return strip;
}

HtmlPage::Figure pose_figure(const QualifyResult& result, const AnalysedPose& pose,
                             const std::string& label) {
    constexpr double gain = 4.0;
    const std::string caption = fmt::format(
        "Pose {} ({}): photograph, render, and their difference enlarged {:.0f} times (red: the "
        "photograph is brighter, cyan: the render is). A coloured rim is an edge out of place.",
        pose.index, label, gain);
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

// Photograph minus render of the hold-out poses, in a sentence and a plot.
void add_residual_summary(HtmlPage& page, const QualifyResult& result) {
    Series residuals;
    for (const AnalysedPose& each : result.poses)
        if (each.residual)
            residuals.add(each.index, each.residual->rms_gray,
                          fmt::format("pose {}: RMS {:.2f}, p99 {:.2f} gray", each.index,
                                      each.residual->rms_gray, each.residual->p99_gray));
    if (residuals.empty())
        return;
    page.add_paragraph(fmt::format(
        "Mean residual {:.2f} gray (code value / full scale * 255) over {} hold-out poses, after "
        "black and white level (a plane each) and one blur width were fitted on half of the "
        "marker's cells; scored on the other half.",
        *mean_residual_gray(result), residuals.xs.size()));
    SvgPlot plot("pose", "residual RMS / gray", 640, 260);
    plot.add_points(residuals, Color::blue, "");
    plot.set_y_range(0.0, 1.15 * std::ranges::max(residuals.ys) + 1e-9);
    page.add_figures(
        {{plot.svg(),
          "Photograph minus render, RMS per hold-out pose. Look for poses that stand out: "
          "something covered the marker, moved or reflected there."}});
}

void add_pictures(HtmlPage& page, const QualifyResult& result) {
    HtmlPage::Figures figures;
    for (const auto& [pose, label] : poses_to_show(result))
        figures.push_back(pose_figure(result, *pose, label));
    if (figures.empty())
        return;
    page.add_heading("Photograph against render");
    add_residual_summary(page, result);
    page.add_figures(figures);
}

// ---- the run --------------------------------------------------------------------------------

void add_run(HtmlPage& page, const QualifyResult& result) {
    const CaptureStatistics counters = result.statistics();
    page.add_heading("The run");
    page.add_facts(
        {{"Started", result.started_utc},
         {"Duration", fmt::format("{:.0f} s", result.duration_s)},
         {"Poses measured", fmt::format("{} of {}", result.poses.size(), result.plan.poses.size())},
         {"Marker detected",
          result.analysis ? fmt::format("{:.1f} %", 100.0 * result.analysis->detection.rate())
                          : dash},
         {"Camera address", result.camera.uri},
         {"Frames delivered", fmt::format("{}", counters.delivered)},
         {"Frames rejected and triggered again", fmt::format("{}", counters.rejected)},
         {"Packets missed", fmt::format("{}", counters.missing_packets)},
         {"Exposure", fmt::format("{} µs", result.settings.exposure.count())},
         {"Gain", fmt::format("{} dB", significant(result.settings.gain_db, 3))},
         {"Image", fmt::format("{} x {} px, {} bit", result.settings.width, result.settings.height,
                               result.settings.bits)}});
    page.add_notes(result.remarks);
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
    add_decision(page, analysis);
    add_conditions(page, analysis);
    if (analysis.causes)
        add_causes(page, *analysis.causes);
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
    const CameraIdentity& camera = result.camera;
    HtmlPage page("Qualification of camera " + (camera.serial.empty() ? camera.uri : camera.serial),
                  fmt::format("{}, {} {}, station {}, limits {}, marker {}", result.started_utc,
                              camera.vendor, camera.model, result.station.id,
                              result.station.limits.id, result.station.marker.spec));
    add_summary(page, result);
    if (result.analysis)
        add_analysis(page, result);
    add_run(page, result);
    write_text(path, page.finish());
}

}  // namespace etalon
