// Elements in the order of PTB's schema 3.2.0 (https://ptb.de/dcc/v3.2.0/dcc.xsd); quantities by
// D-SI 2.1 (https://ptb.de/si/v2.1.0/SI_Format.xsd).
#include "station/certify/dcc_xml.h"

#include <fmt/format.h>

#include "compare/qualification/judged_quantities.h"
#include "core/file/text.h"
#include "core/program/version.h"
#include "station/certify/certificate.h"
#include "station/certify/traceability.h"

namespace etalon {
namespace {

std::string escaped(std::string text) {
    for (char& c : text)
        if (static_cast<unsigned char>(c) < ' ' || c == 127)
            c = ' ';
    return escape_html(text);
}

}  // namespace

void XmlText::begin(const std::string& name, Attributes attributes) {
    text_ += std::string(2 * open_.size(), ' ') + "<" + name;
    for (const auto& [key, value] : attributes)
        text_ += std::string(" ") + key + "=\"" + escaped(value) + "\"";
}

void XmlText::open(const std::string& name, Attributes attributes) {
    begin(name, attributes);
    text_ += ">\n";
    open_.push_back(name);
}

void XmlText::close() {
    const std::string name = open_.back();
    open_.pop_back();
    text_ += std::string(2 * open_.size(), ' ') + "</" + name + ">\n";
}

void XmlText::leaf(const std::string& name, const std::string& content, Attributes attributes) {
    begin(name, attributes);
    text_ += ">" + escaped(content) + "</" + name + ">\n";
}

namespace {

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

struct ExpandedUncertainty {
    double uncertainty, coverage_factor, coverage_probability;
};

class DccWriter {
public:
    explicit DccWriter(const Certificate& certificate)
        : certificate_(certificate), run_(certificate.run), form_(certificate.form) {}

    std::string write() {
        xml_.open("dcc:digitalCalibrationCertificate",
                  {{"xmlns:dcc", "https://ptb.de/dcc"},
                   {"xmlns:si", "https://ptb.de/si"},
                   {"xmlns:xsi", "http://www.w3.org/2001/XMLSchema-instance"},
                   {"xsi:schemaLocation", "https://ptb.de/dcc https://ptb.de/dcc/v3.2.0/dcc.xsd"},
                   {"schemaVersion", "3.2.0"}});
        add_administrative_data();
        add_results();
        xml_.close();
        return xml_.text();
    }

private:
    // ---- small parts

    void content(const std::string& element, const std::string& text) {
        xml_.open(element);
        xml_.leaf("dcc:content", text, {{"lang", "en"}});
        xml_.close();
    }

    void contents(const std::string& element, const std::vector<std::string>& texts) {
        xml_.open(element);
        for (const std::string& text : texts)
            xml_.leaf("dcc:content", text, {{"lang", "en"}});
        xml_.close();
    }

    // Nothing for text that is only blanks: the schema has no such.
    void optional_leaf(const std::string& element, const std::string& text) {
        if (const std::string_view kept = trimmed(text); !kept.empty())
            xml_.leaf(element, std::string(kept));
    }

    void identification(const char* issuer, const std::string& value, const std::string& name) {
        xml_.open("dcc:identification");
        xml_.leaf("dcc:issuer", issuer);
        xml_.leaf("dcc:value", std::string(trimmed(value)));
        content("dcc:name", name);
        xml_.close();
    }

    void location(const PostalContact& contact) {
        xml_.open("dcc:location");
        xml_.leaf("dcc:street", contact.street);
        xml_.leaf("dcc:postCode", contact.postcode);
        xml_.leaf("dcc:city", contact.city);
        xml_.leaf("dcc:countryCode", contact.country);
        xml_.close();
    }

    void contact(const std::string& element, const PostalContact& contact) {
        xml_.open(element);
        content("dcc:name", contact.name);
        location(contact);
        xml_.close();
    }

    void real(double value, const DsiUnit& unit, const std::optional<ExpandedUncertainty>& u) {
        xml_.open("si:real");
        xml_.leaf("si:value", exact(value));
        xml_.leaf("si:unit", unit.dsi);
        if (u) {
            xml_.open("si:expandedUnc");
            xml_.leaf("si:uncertainty", exact(u->uncertainty));
            xml_.leaf("si:coverageFactor", exact(u->coverage_factor));
            xml_.leaf("si:coverageProbability", exact(u->coverage_probability));
            xml_.close();
        }
        xml_.close();
    }

    void software() {
        xml_.open("dcc:software");
        content("dcc:name", "etalon");
        xml_.leaf("dcc:release", version);
        xml_.close();
    }

    // ---- administrative data

    void add_administrative_data() {
        xml_.open("dcc:administrativeData");
        xml_.open("dcc:dccSoftware");
        software();
        xml_.close();
        add_core_data();
        add_items();
        xml_.open("dcc:calibrationLaboratory");
        contact("dcc:contact", form_.laboratory);
        xml_.close();
        add_responsible_person();
        contact("dcc:customer", form_.customer);
        add_statements();
        xml_.close();
    }

    void add_core_data() {
        const RunDays days = days_of(run_);
        xml_.open("dcc:coreData");
        xml_.leaf("dcc:countryCodeISO3166_1", form_.laboratory.country);
        xml_.leaf("dcc:usedLangCodeISO639_1", "en");
        xml_.leaf("dcc:mandatoryLangCodeISO639_1", "en");
        xml_.leaf("dcc:uniqueIdentifier", form_.number);
        xml_.open("dcc:identifications");
        identification("calibrationLaboratory", certificate_.log_sha256,
                       "SHA-256 of the run's log, events.jsonl");
        identification("calibrationLaboratory", certificate_.run_sha256, "SHA-256 of run.json");
        xml_.close();
        xml_.leaf("dcc:beginPerformanceDate", days.first);
        xml_.leaf("dcc:endPerformanceDate", days.last);
        xml_.leaf("dcc:performanceLocation", "laboratory");
        xml_.leaf("dcc:issueDate", certificate_.issued);
        xml_.close();
    }

    void add_items() {
        const CameraIdentity& camera = run_.camera;
        xml_.open("dcc:items");
        xml_.open("dcc:item");
        content("dcc:name", "Camera with its geometric calibration");
        xml_.open("dcc:manufacturer");
        content("dcc:name", camera.vendor);
        xml_.close();
        optional_leaf("dcc:model", camera.model);
        xml_.open("dcc:identifications");
        identification("manufacturer", camera.serial, "Serial number");
        identification("calibrationLaboratory", run_.station.inputs.at(1).sha256,
                       "SHA-256 of the calibration under test");
        xml_.close();
        xml_.close();
        xml_.close();
    }

    void add_responsible_person() {
        xml_.open("dcc:respPersons");
        xml_.open("dcc:respPerson");
        xml_.open("dcc:person");
        content("dcc:name", form_.signer_name);
        xml_.close();
        xml_.leaf("dcc:role", form_.signer_role);
        xml_.leaf("dcc:mainSigner", "true");
        xml_.close();
        xml_.open("dcc:respPerson");
        xml_.open("dcc:person");
        content("dcc:name", operators_of(run_));
        xml_.close();
        xml_.leaf("dcc:role", "operator");
        xml_.close();
        xml_.close();
    }

    void statement(const std::string& name, const std::vector<std::string>& texts) {
        xml_.open("dcc:statement");
        content("dcc:name", name);
        contents("dcc:declaration", texts);
        xml_.close();
    }

    void add_statements() {
        xml_.open("dcc:statements");
        xml_.open("dcc:statement");
        content("dcc:name", "Conformity");
        contents("dcc:declaration", {conformity_sentence(certificate_), decision_sentence()});
        if (run_.outcome != RunOutcome::inconclusive)
            xml_.leaf("dcc:conformity", run_.outcome == RunOutcome::pass ? "pass" : "fail");
        xml_.close();
        statement("Validity", {copying_sentence});
        if (const auto remarks = certificate_remarks(certificate_); !remarks.empty())
            statement("Remarks", remarks);
        xml_.close();
    }

    std::string decision_sentence() const {
        const Qualification& analysis = *run_.analysis;
        return fmt::format(
            "Decision rule {}: {}. Risk of a PASS with a quantity at its limit: {:.4g}; of a FAIL "
            "with all {} at their limits: {:.4g}.",
            analysis.rule.name(), analysis.rule.sentence(), analysis.risk.false_acceptance,
            analysis.risk.judged, analysis.risk.false_rejection);
    }

    // ---- results

    void add_results() {
        xml_.open("dcc:measurementResults");
        xml_.open("dcc:measurementResult");
        content("dcc:name", "Pose bias of the camera over the volume");
        add_methods();
        xml_.open("dcc:usedSoftware");
        software();
        xml_.close();
        add_references();
        add_environment();
        xml_.open("dcc:results");
        for (const JudgedQuantity& each : run_.analysis->quantities)
            if (each.measured)
                add_result(each, true);
        for (const JudgedQuantity& each : run_.analysis->reported)
            if (each.measured)
                add_result(each, false);
        xml_.close();
        xml_.close();
        xml_.close();
    }

    void add_methods() {
        xml_.open("dcc:usedMethods");
        xml_.open("dcc:usedMethod");
        content("dcc:name", "Photographs of a marker on a stage against their renders");
        contents("dcc:description", method_sentences(certificate_));
        xml_.leaf("dcc:norm", "JCGM 100:2008");
        xml_.leaf("dcc:norm", "JCGM 106:2012");
        xml_.close();
        xml_.close();
    }

    void add_references() {
        xml_.open("dcc:measuringEquipments");
        for (const TracedReference& each : run_.station.references) {
            xml_.open("dcc:measuringEquipment");
            content("dcc:name", each.name);
            content("dcc:description", fmt::format("certificate by {} of {}, due {}",
                                                   each.laboratory, each.date, each.due));
            xml_.open("dcc:identifications");
            identification("other", each.certificate, "Number of its certificate");
            xml_.close();
            xml_.open("dcc:measuringEquipmentQuantities");
            xml_.open("dcc:measuringEquipmentQuantity");
            content("dcc:name", "Deviation");
            real(each.value, dsi_unit(each.unit),
                 ExpandedUncertainty{each.expanded_uncertainty, 2.0, 0.9545});
            xml_.close();
            xml_.close();
            xml_.close();
        }
        xml_.close();
    }

    void add_condition(const std::string& name, const ClimateSummary& climate, const char* unit) {
        xml_.open("dcc:influenceCondition");
        content("dcc:name", name);
        xml_.open("dcc:data");
        const DsiUnit as{unit, unit};
        for (const auto& [label, value] :
             {std::pair("Mean", climate.mean), std::pair("Lowest", climate.lowest),
              std::pair("Highest", climate.highest)}) {
            xml_.open("dcc:quantity");
            content("dcc:name", label);
            real(value, as, std::nullopt);
            xml_.close();
        }
        xml_.close();
        xml_.close();
    }

    void add_environment() {
        xml_.open("dcc:influenceConditions");
        add_condition("Temperature", room_temperature(run_.station, run_.environment).value(),
                      "\\degreecelsius");
        if (const auto humidity = room_humidity(run_.station, run_.environment))
            add_condition("Relative humidity", *humidity, "\\percent");
        xml_.close();
    }

    void add_result(const JudgedQuantity& each, bool is_judged) {
        const DsiUnit& unit = dsi_unit(each.unit);
        xml_.open("dcc:result");
        content("dcc:name", quantity_kind(each.name).words);
        xml_.open("dcc:data");
        xml_.open("dcc:quantity", {{"refType", "etalon_" + each.name}});
        content("dcc:name", each.name);
        real(each.value, unit,
             ExpandedUncertainty{each.expanded_uncertainty, each.coverage_factor,
                                 coverage_of(each)});
        if (is_judged || unit.definition)
            add_result_data(each, unit, is_judged);
        xml_.close();
        xml_.close();
        xml_.close();
    }

    void add_result_data(const JudgedQuantity& each, const DsiUnit& unit, bool is_judged) {
        xml_.open("dcc:measurementMetaData");
        if (is_judged) {
            xml_.open("dcc:metaData");
            content("dcc:name", "Judgement");
            content("dcc:declaration", fmt::format("{}; limit {} {}", name(each.outcome),
                                                   exact(each.limit), each.unit));
            if (each.outcome == Outcome::pass || each.outcome == Outcome::fail)
                xml_.leaf("dcc:conformity", each.outcome == Outcome::pass ? "pass" : "fail");
            xml_.close();
        }
        if (unit.definition) {
            xml_.open("dcc:metaData");
            xml_.leaf("dcc:nonSIDefinition", unit.definition);
            xml_.leaf("dcc:nonSIUnit", unit.ours);
            xml_.close();
        }
        xml_.close();
    }

    const Certificate& certificate_;
    const QualifyResult& run_;
    const CertificateForm& form_;
    XmlText xml_;
};

}  // namespace

std::string dcc_xml(const Certificate& certificate) {
    return DccWriter(certificate).write();
}

}  // namespace etalon
