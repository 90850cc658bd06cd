#include <fmt/format.h>
#include <fmt/ranges.h>

#include "compare/qualification/judged_quantities.h"
#include "core/file/text.h"
#include "report/number_text.h"
#include "station/certify/certificate.css.h"
#include "station/certify/certificate.h"

namespace etalon {
namespace {

using Texts = std::vector<std::string>;

std::string unit_text(const std::string& unit) {
    return unit == "um" ? "µm" : unit;
}

// A percent sign stays with its number.
std::string typeset(const std::string& text) {
    std::string html = escape_html(text);
    for (std::size_t at = 0; (at = html.find(" %", at)) != std::string::npos;)
        html.replace(at, 1, "&nbsp;");
    return html;
}

std::string heading(const std::string& text) {
    return "<h2>" + escape_html(text) + "</h2>\n";
}

std::string paragraphs(const Texts& texts) {
    std::string html;
    for (const std::string& text : texts)
        html += "<p>" + typeset(text) + "</p>\n";
    return html;
}

std::string facts(const std::vector<std::pair<std::string, std::string>>& rows) {
    std::string html = "<table class=\"facts\">\n";
    for (const auto& [label, value] : rows)
        html += fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", escape_html(label),
                            escape_html(value));
    return html + "</table>\n";
}

// Columns from `first_number` to before `last_number` are aligned right.
std::string figures(const Texts& header, const std::vector<Texts>& rows, std::size_t first_number,
                    std::size_t last_number, const char* looks = "figures") {
    const auto line = [&](const Texts& cells, const char* tag) {
        std::string html = "<tr>";
        for (std::size_t i = 0; i < cells.size(); ++i)
            html += fmt::format("<{}{}>{}</{}>", tag,
                                i >= first_number && i < last_number ? " class=\"n\"" : "",
                                escape_html(cells[i]), tag);
        return html + "</tr>\n";
    };
    std::string html = fmt::format("<table class=\"{}\">\n", looks) + line(header, "th");
    for (const Texts& row : rows)
        html += line(row, "td");
    return html + "</table>\n";
}

std::string volume_text(const StationFile& station) {
    Texts sides;
    for (std::size_t i = 0; i < station.stage.axes.size(); ++i) {
        const bool rotary = station.stage.axes[i].kind == Axis::Kind::rotary;
        const double unit = rotary ? deg_per_rad : 1.0;
        sides.push_back(fmt::format("{} {:.6g} to {:.6g} {}", station.stage.axes[i].name,
                                    station.plan.volume[i].low * unit,
                                    station.plan.volume[i].high * unit, rotary ? "°" : "mm"));
    }
    return fmt::format("{}", fmt::join(sides, ", "));
}

// A value to the digits of its U, which has two (GUM 7.2.6).
Texts result_row(const JudgedQuantity& each, bool is_judged) {
    const int decimals = decimals_of(each.expanded_uncertainty);
    return {quantity_kind(each.name).words,
            fixed(each.value, decimals),
            fixed(each.expanded_uncertainty, decimals),
            fixed(each.coverage_factor, 2),
            is_judged ? significant(each.limit, 6) : dash,
            unit_text(each.unit),
            is_judged ? name(each.outcome) : dash};
}

std::string results_html(const Qualification& analysis) {
    std::vector<Texts> rows;
    for (const JudgedQuantity& each : analysis.quantities)
        if (each.measured)
            rows.push_back(result_row(each, true));
    for (const JudgedQuantity& each : analysis.reported)
        if (each.measured && !quantity_kind(each.name).is_of_pixels)
            rows.push_back(result_row(each, false));
    return heading("Results") +
           figures({"Quantity", "Value", "U", "k", "Limit", "Unit", "Outcome"}, rows, 1, 5) +
           "<p class=\"small\">Quantities of pixels that have no limit are in dcc.xml and in the "
           "record.</p>\n";
}

// Without a prior it is the most that it can be.
std::string risk_text(double probability, const DecisionRisk& risk) {
    return (risk.has_prior ? "" : "at most ") + probability_text(probability);
}

std::string decision_html(const Certificate& certificate) {
    const Qualification& analysis = *certificate.run.analysis;
    std::vector<Texts> rows;
    for (const JudgedQuantity& each : analysis.quantities)
        if (each.risk)
            rows.push_back({quantity_kind(each.name).words,
                            probability_text(each.risk->conformance),
                            risk_text(each.risk->consumer, *each.risk),
                            risk_text(each.risk->producer, *each.risk)});
    return heading("Decision rule: " + analysis.rule.name()) +
           paragraphs({fmt::format(
               "{}. A camera with any judged quantity at its limit gets PASS in at most {}, one "
               "with all {} at their limits FAIL in at most {} of runs (ILAC-G8, JCGM 106).",
               analysis.rule.sentence(), probability_text(analysis.risk.false_acceptance),
               analysis.risk.judged, probability_text(analysis.risk.false_rejection))}) +
           figures({"Quantity", "Within its limit", "Consumer's risk", "Producer's risk"}, rows, 1,
                   4);
}

std::string climate_text(const std::optional<ClimateSummary>& climate, const char* unit) {
    if (!climate)
        return "not measured";
    return fmt::format(
        "{:.2f} to {:.2f} {}, mean {:.2f} {}, standard deviation {:.2f}{}", climate->lowest,
        climate->highest, unit, climate->mean, unit, climate->deviation,
        climate->readings > 0 ? fmt::format(" of {} readings", climate->readings) : ", by hand");
}

std::string traceability_html(const StationFile& station) {
    std::vector<Texts> rows;
    for (const TracedReference& each : station.references) {
        const int decimals = decimals_of(each.expanded_uncertainty);
        rows.push_back({each.name, fixed(each.value, decimals),
                        fixed(each.expanded_uncertainty, decimals), unit_text(each.unit),
                        each.certificate, each.laboratory, each.date + " to " + each.due});
    }
    return heading("Traceability") + figures({"Reference", "Deviation", "U (k = 2)", "Unit",
                                              "Certificate", "Laboratory", "In force"},
                                             rows, 1, 3);
}

std::string conditions_html(const Qualification& analysis) {
    std::vector<Texts> rows;
    for (const AcceptanceCondition& each : analysis.conditions)
        rows.push_back({each.name, name(each.state), each.text});
    return rows.empty() ? ""
                        : heading("Conditions") +
                              figures({"Condition", "State", "Found"}, rows, 0, 0, "figures wide");
}

std::string remarks_html(const Certificate& certificate) {
    const Texts remarks = certificate_remarks(certificate);
    if (remarks.empty())
        return "";
    std::string html = heading("Remarks") + "<ul>\n";
    for (const std::string& remark : remarks)
        html += "<li>" + typeset(remark) + "</li>\n";
    return html + "</ul>\n";
}

std::string head_html(const CertificateForm& form) {
    return fmt::format(
        "<header><div><p class=\"name\">{}</p><p>{}</p></div><p class=\"number\">Certificate "
        "{}</p></header>\n<h1>Calibration certificate</h1>\n",
        escape_html(form.laboratory.name), escape_html(address_of(form.laboratory)),
        escape_html(form.number));
}

std::string item_html(const Certificate& certificate) {
    const QualifyResult& run = certificate.run;
    const CertificateForm& form = certificate.form;
    const auto [first, last] = days_of(run);
    return facts(
        {{"Object", fmt::format("Camera {} with its geometric calibration",
                                trimmed(run.camera.vendor + " " + run.camera.model))},
         {"Serial number", run.camera.serial},
         {"Calibration under test", "SHA-256 " + run.station.inputs.at(1).sha256},
         {"Customer", fmt::format("{}, {}", form.customer.name, address_of(form.customer))},
         {"Date of calibration",
          (first == last ? first : fmt::format("{} to {}", first, last)) + " (UTC)"},
         {"Place", fmt::format("{}, {}; station {}", form.laboratory.name,
                               address_of(form.laboratory), run.station.id)},
         {"Operator", operators_of(run)},
         {"Volume", volume_text(run.station)},
         {"Quantities", "Bias of the pose that is measured with the camera, over the volume"}});
}

std::string end_html(const Certificate& certificate) {
    const CertificateForm& form = certificate.form;
    return fmt::format(
        "<div class=\"sign\"><div>{}, {}</div><div>{}<br>{}</div></div>\n"
        "<p class=\"small record\">Record of the run: events.jsonl SHA-256 <code>{}</code>, "
        "run.json SHA-256 <code>{}</code>; measured with etalon {}. {}</p>\n",
        escape_html(form.laboratory.city), escape_html(certificate.issued),
        escape_html(form.signer_name), escape_html(form.signer_role),
        escape_html(certificate.log_sha256), escape_html(certificate.run_sha256),
        escape_html(certificate.run.sessions.back().version), escape_html(copying_sentence));
}

}  // namespace

std::string certificate_html(const Certificate& certificate) {
    const QualifyResult& run = certificate.run;
    const Qualification& analysis = *run.analysis;
    return fmt::format(
               "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>"
               "Calibration certificate {}</title><style>\n{}</style></head><body>\n",
               escape_html(certificate.form.number), certificate_css) +
           head_html(certificate.form) + item_html(certificate) + "<p class=\"statement\">" +
           escape_html(conformity_sentence(certificate)) + "</p>\n" + results_html(analysis) +
           decision_html(certificate) + heading("Method") +
           paragraphs(method_sentences(certificate)) + heading("Environment") +
           facts(
               {{"Temperature", climate_text(room_temperature(run.station, run.environment), "°C")},
                {"Relative humidity",
                 climate_text(room_humidity(run.station, run.environment), "%")}}) +
           traceability_html(run.station) + conditions_html(analysis) + remarks_html(certificate) +
           end_html(certificate) + "</body></html>\n";
}

}  // namespace etalon
