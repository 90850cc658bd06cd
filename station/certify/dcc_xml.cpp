// Elements in the order of PTB's schema 3.2.0 (https://ptb.de/dcc/v3.2.0/dcc.xsd); quantities by
// D-SI 2.1 (https://ptb.de/si/v2.1.0/SI_Format.xsd).
#include <fmt/format.h>

#include "compare/qualification/judged_quantities.h"
#include "core/file/text.h"
#include "core/program/version.h"
#include "station/certify/certificate.h"

namespace etalon {
namespace {

// ---- XML 1.0, two spaces a level

using Attributes = std::initializer_list<std::pair<const char*, std::string>>;

// What XML cannot hold (control characters) becomes a space.
std::string xml_escaped(std::string text) {
    for (char& c : text)
        if (static_cast<unsigned char>(c) < ' ' || c == 127)
            c = ' ';
    return escape_html(text);
}

std::string start_tag(const std::string& name, Attributes attributes) {
    std::string tag = "<" + name;
    for (const auto& [key, value] : attributes)
        tag += std::string(" ") + key + "=\"" + xml_escaped(value) + "\"";
    return tag + ">";
}

// An element that holds text.
std::string leaf(const std::string& name, std::string_view text, Attributes attributes = {}) {
    return start_tag(name, attributes) + xml_escaped(std::string(text)) + "</" + name + ">\n";
}

// An element that holds these elements.
std::string element(const std::string& name, const std::string& elements,
                    Attributes attributes = {}) {
    std::string text = start_tag(name, attributes) + "\n";
    for (std::size_t begin = 0; begin < elements.size();) {
        const std::size_t end = elements.find('\n', begin) + 1;
        text += "  " + elements.substr(begin, end - begin);
        begin = end;
    }
    return text + "</" + name + ">\n";
}

std::string contents(const std::string& name, const std::vector<std::string>& texts) {
    std::string all;
    for (const std::string& text : texts)
        all += leaf("dcc:content", text, {{"lang", "en"}});
    return element(name, all);
}

std::string content(const std::string& name, const std::string& text) {
    return contents(name, {text});
}

std::string identification(const char* issuer, const std::string& value, const std::string& name) {
    return element(
        "dcc:identification",
        leaf("dcc:issuer", issuer) + leaf("dcc:value", trimmed(value)) + content("dcc:name", name));
}

std::string contact(const std::string& name, const PostalContact& contact) {
    return element(name, content("dcc:name", contact.name) +
                             element("dcc:location", leaf("dcc:street", contact.street) +
                                                         leaf("dcc:postCode", contact.postcode) +
                                                         leaf("dcc:city", contact.city) +
                                                         leaf("dcc:countryCode", contact.country)));
}

std::string software() {
    return element("dcc:software", content("dcc:name", "etalon") + leaf("dcc:release", version));
}

// A unit of ours in the notation of D-SI; what the SI does not have is a number, with a word on it.
struct DsiUnit {
    const char* ours;
    const char* dsi;
    const char* definition = nullptr;
};
constexpr DsiUnit dsi_units[] = {
    {"mm", "\\milli\\metre"},
    {"mrad", "\\milli\\radian"},
    {"um", "\\micro\\metre"},
    {"ppm", "\\ppm"},
    {"K", "\\kelvin"},
    {"%", "\\percent"},
    {"1", "\\one"},
    {"px", "\\one", "pixels of the camera: distances between the centres of two neighbours"},
    {"gray", "\\one", "1/255 of full scale"},
};

const DsiUnit& dsi_unit(const std::string& unit) {
    for (const DsiUnit& each : dsi_units)
        if (each.ours == unit)
            return each;
    throw NumericalError(fmt::format("certificate: no notation of the unit '{}'", unit));
}

std::string real(double value, const char* dsi_unit, const std::string& uncertainty = "") {
    return element("si:real",
                   leaf("si:value", exact(value)) + leaf("si:unit", dsi_unit) + uncertainty);
}

std::string expanded(double uncertainty, double coverage_factor, double coverage_probability) {
    return element("si:expandedUnc",
                   leaf("si:uncertainty", exact(uncertainty)) +
                       leaf("si:coverageFactor", exact(coverage_factor)) +
                       leaf("si:coverageProbability", exact(coverage_probability)));
}

std::string core_data(const Certificate& certificate) {
    const RunDays days = days_of(certificate.run);
    return element("dcc:coreData",
                   leaf("dcc:countryCodeISO3166_1", certificate.form.laboratory.country) +
                       leaf("dcc:usedLangCodeISO639_1", "en") +
                       leaf("dcc:mandatoryLangCodeISO639_1", "en") +
                       leaf("dcc:uniqueIdentifier", certificate.form.number) +
                       element("dcc:identifications",
                               identification("calibrationLaboratory", certificate.log_sha256,
                                              "SHA-256 of the run's log, events.jsonl") +
                                   identification("calibrationLaboratory", certificate.run_sha256,
                                                  "SHA-256 of run.json")) +
                       leaf("dcc:beginPerformanceDate", days.first) +
                       leaf("dcc:endPerformanceDate", days.last) +
                       leaf("dcc:performanceLocation", "laboratory") +
                       leaf("dcc:issueDate", certificate.issued));
}

// Without a model that is only blanks: the schema has no such.
std::string items(const QualifyResult& run) {
    const std::string_view model = trimmed(run.camera.model);
    return element(
        "dcc:items",
        element(
            "dcc:item",
            content("dcc:name", "Camera with its geometric calibration") +
                element("dcc:manufacturer", content("dcc:name", run.camera.vendor)) +
                (model.empty() ? "" : leaf("dcc:model", model)) +
                element("dcc:identifications",
                        identification("manufacturer", run.camera.serial, "Serial number") +
                            identification("calibrationLaboratory", run.station.inputs.at(1).sha256,
                                           "SHA-256 of the calibration under test"))));
}

std::string person(const std::string& name, const std::string& role, const std::string& rest = "") {
    return element("dcc:respPerson", element("dcc:person", content("dcc:name", name)) +
                                         leaf("dcc:role", role) + rest);
}

std::string statement(const std::string& name, const std::vector<std::string>& texts,
                      const std::string& rest = "") {
    return element("dcc:statement",
                   content("dcc:name", name) + contents("dcc:declaration", texts) + rest);
}

std::string decision_sentence(const Qualification& analysis) {
    return fmt::format(
        "Decision rule {}: {}. Risk of a PASS with a quantity at its limit: {:.4g}; of a FAIL "
        "with all {} at their limits: {:.4g}.",
        analysis.rule.name(), analysis.rule.sentence(), analysis.risk.false_acceptance,
        analysis.risk.judged, analysis.risk.false_rejection);
}

std::string statements(const Certificate& certificate) {
    const QualifyResult& run = certificate.run;
    const std::string conformity =
        run.outcome == RunOutcome::inconclusive
            ? ""
            : leaf("dcc:conformity", run.outcome == RunOutcome::pass ? "pass" : "fail");
    const auto remarks = certificate_remarks(certificate);
    return element("dcc:statements",
                   statement("Conformity",
                             {conformity_sentence(certificate), decision_sentence(*run.analysis)},
                             conformity) +
                       statement("Validity", {copying_sentence}) +
                       (remarks.empty() ? "" : statement("Remarks", remarks)));
}

std::string administrative_data(const Certificate& certificate) {
    const CertificateForm& form = certificate.form;
    return element(
        "dcc:administrativeData",
        element("dcc:dccSoftware", software()) + core_data(certificate) + items(certificate.run) +
            element("dcc:calibrationLaboratory", contact("dcc:contact", form.laboratory)) +
            element("dcc:respPersons",
                    person(form.signer_name, form.signer_role, leaf("dcc:mainSigner", "true")) +
                        person(operators_of(certificate.run), "operator")) +
            contact("dcc:customer", form.customer) + statements(certificate));
}

std::string method(const Certificate& certificate) {
    return element(
        "dcc:usedMethods",
        element("dcc:usedMethod",
                content("dcc:name", "Photographs of a marker on a stage against their renders") +
                    contents("dcc:description", method_sentences(certificate)) +
                    leaf("dcc:norm", "JCGM 100:2008") + leaf("dcc:norm", "JCGM 106:2012")));
}

std::string equipment(const TracedReference& each) {
    return element(
        "dcc:measuringEquipment",
        content("dcc:name", each.name) +
            content("dcc:description", fmt::format("certificate by {} of {}, due {}",
                                                   each.laboratory, each.date, each.due)) +
            element("dcc:identifications",
                    identification("other", each.certificate, "Number of its certificate")) +
            element("dcc:measuringEquipmentQuantities",
                    element("dcc:measuringEquipmentQuantity",
                            content("dcc:name", "Deviation") +
                                real(each.value, dsi_unit(each.unit).dsi,
                                     expanded(each.expanded_uncertainty, 2.0, 0.9545)))));
}

std::string condition(const std::string& name, const ClimateSummary& climate, const char* unit) {
    std::string data;
    for (const auto& [label, value] :
         {std::pair("Mean", climate.mean), std::pair("Lowest", climate.lowest),
          std::pair("Highest", climate.highest)})
        data += element("dcc:quantity", content("dcc:name", label) + real(value, unit));
    return element("dcc:influenceCondition", content("dcc:name", name) + element("dcc:data", data));
}

std::string environment(const QualifyResult& run) {
    std::string conditions = condition(
        "Temperature", room_temperature(run.station, run.environment).value(), "\\degreecelsius");
    if (const auto humidity = room_humidity(run.station, run.environment))
        conditions += condition("Relative humidity", *humidity, "\\percent");
    return element("dcc:influenceConditions", conditions);
}

std::string judgement(const JudgedQuantity& each) {
    const bool is_decided = each.outcome == Outcome::pass || each.outcome == Outcome::fail;
    return element(
        "dcc:metaData",
        content("dcc:name", "Judgement") +
            content("dcc:declaration", fmt::format("{}; limit {} {}", name(each.outcome),
                                                   exact(each.limit), each.unit)) +
            (is_decided ? leaf("dcc:conformity", each.outcome == Outcome::pass ? "pass" : "fail")
                        : ""));
}

std::string result(const JudgedQuantity& each, bool is_judged) {
    const DsiUnit& unit = dsi_unit(each.unit);
    std::string about = is_judged ? judgement(each) : "";
    if (unit.definition)
        about += element("dcc:metaData", leaf("dcc:nonSIDefinition", unit.definition) +
                                             leaf("dcc:nonSIUnit", unit.ours));
    const std::string value =
        real(each.value, unit.dsi,
             expanded(each.expanded_uncertainty, each.coverage_factor, coverage_of(each)));
    return element(
        "dcc:result",
        content("dcc:name", quantity_kind(each.name).words) +
            element("dcc:data",
                    element("dcc:quantity",
                            content("dcc:name", each.name) + value +
                                (about.empty() ? "" : element("dcc:measurementMetaData", about)),
                            {{"refType", "etalon_" + each.name}})));
}

std::string results(const Certificate& certificate) {
    const QualifyResult& run = certificate.run;
    std::string equipments, quantities;
    for (const TracedReference& each : run.station.references)
        equipments += equipment(each);
    for (const auto* list : {&run.analysis->quantities, &run.analysis->reported})
        for (const JudgedQuantity& each : *list)
            if (each.measured)
                quantities += result(each, list == &run.analysis->quantities);
    return element("dcc:measurementResults",
                   element("dcc:measurementResult",
                           content("dcc:name", "Pose bias of the camera over the volume") +
                               method(certificate) + element("dcc:usedSoftware", software()) +
                               element("dcc:measuringEquipments", equipments) + environment(run) +
                               element("dcc:results", quantities)));
}

}  // namespace

std::string dcc_xml(const Certificate& certificate) {
    return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" +
           element("dcc:digitalCalibrationCertificate",
                   administrative_data(certificate) + results(certificate),
                   {{"xmlns:dcc", "https://ptb.de/dcc"},
                    {"xmlns:si", "https://ptb.de/si"},
                    {"xmlns:xsi", "http://www.w3.org/2001/XMLSchema-instance"},
                    {"xsi:schemaLocation", "https://ptb.de/dcc https://ptb.de/dcc/v3.2.0/dcc.xsd"},
                    {"schemaVersion", "3.2.0"}});
}

}  // namespace etalon
