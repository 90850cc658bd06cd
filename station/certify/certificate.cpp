#include "station/certify/certificate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <csignal>

#include "core/file/text.h"
#include "core/process/subprocess.h"
#include "core/statistics/distributions.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

// One line of text; empty where the key is missing.
std::string line_of(const Value& section, const char* key) {
    const auto value = section.find(key);
    if (!value)
        return "";
    const std::string text(trimmed(value->text()));
    if (text.empty())
        value->fail("must be a line of text");
    return text;
}

constexpr std::pair<const char*, std::string PostalContact::*> contact_keys[] = {
    {"name", &PostalContact::name},
    {"street", &PostalContact::street},
    {"postcode", &PostalContact::postcode},
    {"city", &PostalContact::city},
    {"country", &PostalContact::country}};

PostalContact contact_of(const Value& root, const char* key) {
    PostalContact contact;
    const auto section = root.find(key);
    if (!section)
        return contact;
    for (const auto& [part, text] : contact_keys)
        contact.*text = line_of(*section, part);
    const std::string& country = contact.country;
    const auto is_capital = [](char c) { return c >= 'A' && c <= 'Z'; };
    if (!country.empty() && (country.size() != 2 || !std::ranges::all_of(country, is_capital)))
        section->at("country").fail("must be two capital letters of ISO 3166-1, as DE");
    return contact;
}

using Missing = std::vector<std::string>;

void add_of_run(Missing& missing, const QualifyResult& run) {
    if (run.outcome == RunOutcome::error || run.outcome == RunOutcome::aborted)
        missing.push_back(fmt::format("a verdict: the run ended with {}, {}", name(run.outcome),
                                      run.reason.empty() ? "no reason said" : run.reason));
    else if (!run.analysis ||
             std::ranges::none_of(run.analysis->quantities, &JudgedQuantity::measured))
        missing.emplace_back("a measured value: nothing was measured");
    if (run.camera.serial.empty())
        missing.emplace_back("the camera's serial number: the device tells none");
    for (const RunSession& session : run.sessions)
        if (session.operator_name.empty())
            missing.push_back(
                fmt::format("the operator of the session of {} (--operator)", session.started_utc));
}

void add_reference(Missing& missing, const QualifyResult& run, const std::string& reference,
                   const std::string& key) {
    const TracedReference* found = reference_named(run.station.references, reference);
    if (!found) {
        missing.push_back(
            fmt::format("references.{} in station.yaml: {} is not traced", key, reference));
        return;
    }
    const RunDays days = days_of(run);
    for (const std::string& day : {days.first, days.last})
        if (!found->in_force_on(day)) {
            missing.push_back(fmt::format(
                "a valid certificate of {}: {} is of {} and was due {}, the run is of {}",
                reference, found->certificate, found->date, found->due, day));
            return;
        }
}

void add_references(Missing& missing, const QualifyResult& run) {
    for (const Axis& axis : run.station.stage.axes)
        add_reference(missing, run, "stage scale " + axis.name, "stage_scale." + axis.name);
    add_reference(missing, run, "marker print size", "marker_size");
    add_reference(missing, run, "marker flatness", "marker_flatness");
    add_reference(missing, run, "thermometer", "thermometer");
}

void add_environment(Missing& missing, const QualifyResult& run) {
    if (!run.station.environment)
        missing.emplace_back("environment in station.yaml: the temperature was not measured");
    else if (!run.environment.lost.empty())
        missing.push_back("the temperature during the whole run: " + run.environment.lost);
    else if (!room_temperature(run.station, run.environment))
        missing.emplace_back("the temperature: fewer than two readings of the room's sensor");
}

void add_budget(Missing& missing, const QualifyResult& run) {
    if (!run.analysis)
        return;
    for (const BudgetRow& row : run.analysis->budget)
        if (row.counted && !row.standard_uncertainty)
            missing.push_back(fmt::format("the uncertainty of {}: it is unknown", row.source));
}

}  // namespace

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

CertificateForm read_certificate_form(const std::filesystem::path& path) {
    const StrictFile file(path, "certificate/1");
    const Value root = file.root();
    CertificateForm form;
    form.number = line_of(root, "number");
    form.laboratory = contact_of(root, "laboratory");
    form.customer = contact_of(root, "customer");
    if (const auto signer = root.find("signer")) {
        form.signer_name = line_of(*signer, "name");
        form.signer_role = line_of(*signer, "role");
    }
    file.finish();
    return form;
}

std::vector<std::string> missing_keys(const CertificateForm& form) {
    std::vector<std::string> missing;
    const auto require = [&](const std::string& key, const std::string& text) {
        if (text.empty())
            missing.push_back(key);
    };
    require("number", form.number);
    for (const auto& [section, contact] :
         {std::pair("laboratory.", &form.laboratory), std::pair("customer.", &form.customer)})
        for (const auto& [part, text] : contact_keys)
            require(std::string(section) + part, contact->*text);
    require("signer.name", form.signer_name);
    require("signer.role", form.signer_role);
    return missing;
}

std::string address_of(const PostalContact& contact) {
    return fmt::format("{}, {} {}, {}", contact.street, contact.postcode, contact.city,
                       contact.country);
}

RunDays days_of(const QualifyResult& run) {
    constexpr double day_s = 86400.0;
    const double start_s = utc_seconds(run.started_utc).value_or(0.0);
    const auto day = [](double seconds) {
        return date_of_days(static_cast<long>(std::floor(seconds / day_s)));
    };
    return {day(start_s), day(start_s + run.duration_s)};
}

std::vector<std::string> missing_for_certificate(const QualifyResult& run,
                                                 const CertificateForm& form) {
    Missing missing;
    add_of_run(missing, run);
    add_references(missing, run);
    add_environment(missing, run);
    add_budget(missing, run);
    for (const std::string& key : missing_keys(form))
        missing.push_back(fmt::format("{} in the certificate's file", key));
    return missing;
}

std::string write_pdf(const std::filesystem::path& html, const std::filesystem::path& pdf,
                      std::chrono::seconds patience, const std::string& program) try {
    std::error_code ignored;
    std::filesystem::remove(pdf, ignored);  // one from before would be taken for this one's
    Subprocess process({program, html.string(), pdf.string()});
    if (!process.wait_for(patience)) {
        process.send(SIGKILL);
        return fmt::format("{} took longer than {} s", program, patience.count());
    }
    if (process.result().exit_code != 0 || !std::filesystem::exists(pdf, ignored))
        return fmt::format("{} failed; `{} {} {}` says why", program, program, html.string(),
                           pdf.string());
    return "";
} catch (const std::system_error&) {
    return fmt::format("{} is not installed", program);
}

}  // namespace etalon
