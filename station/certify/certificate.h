// A calibration certificate of a run, which states what a laboratory must (ISO/IEC 17025:2017,
// 7.8): as HTML on A4 and as Digital Calibration Certificate. docs/certificate.md. Every number is
// the record's. Text of files and devices is escaped.
#pragma once

#include "station/record/qualify_result.h"

namespace etalon {

// ---- what a certificate states and no record knows: certificate.yaml (`etalon: certificate/1`)
//
//     etalon: certificate/1
//     number: "2026-0042"                # or --number
//     laboratory: {name: "Optics Laboratory", street: "Main Road 1", postcode: "38116",
//                  city: "Braunschweig", country: DE}        # where the run was made
//     customer: {name: "A & B Robotics", street: "Wall 7", postcode: "1010", city: "Vienna",
//                country: AT}
//     signer: {name: "E. Example", role: "Head of the laboratory"}

struct PostalContact {
    std::string name, street, postcode, city;
    std::string country;  // two letters of ISO 3166-1
};

struct CertificateForm {
    std::string number;
    PostalContact laboratory, customer;
    std::string signer_name, signer_role;
};

// Any key may be missing and is then empty. Throws ConfigError with file, line and key for unknown
// keys, text that is empty or has line breaks, and countries that are not two capital letters.
CertificateForm read_certificate_form(const std::filesystem::path& path);

// As the file would name them.
std::vector<std::string> missing_keys(const CertificateForm& form);

// "Main Road 1, 38116 Braunschweig, DE".
std::string address_of(const PostalContact& contact);

// ---- whether a run can be certified

// First and last day of the measurements, UTC: "2026-03-07".
struct RunDays {
    std::string first, last;
};
RunDays days_of(const QualifyResult& run);

// A line each; none: the run can be certified. Every input of its budget must be traced to a
// certificate that was in force on its days, and the room must be measured. INCONCLUSIVE and
// resumed runs can be certified if they have measured.
std::vector<std::string> missing_for_certificate(const QualifyResult& run,
                                                 const CertificateForm& form);

// ---- the certificate

// Of a run from which nothing is missing. The run must outlive it.
struct Certificate {
    const QualifyResult& run;
    CertificateForm form;
    std::string issued;                  // "2026-03-09"
    std::string log_sha256, run_sha256;  // of the record's events.jsonl and run.json
};

std::string certificate_html(const Certificate& certificate);

// Schema 3.2.0 of the DCC, with units by D-SI 2.1 (Physikalisch-Technische Bundesanstalt).
std::string dcc_xml(const Certificate& certificate);

// Makes `pdf` of the HTML file by `program`, and returns nothing; or says why there is none: the
// program is missing, fails, or takes longer than `patience` and is killed.
std::string write_pdf(const std::filesystem::path& html, const std::filesystem::path& pdf,
                      std::chrono::seconds patience = std::chrono::seconds(60),
                      const std::string& program = "weasyprint");

// ---- what both forms say

// Whether the camera conforms.
std::string conformity_sentence(const Certificate& certificate);
// How it was measured.
std::vector<std::string> method_sentences(const Certificate& certificate);
// What limits this certificate: interruptions, what was not met, why there is no verdict.
std::vector<std::string> certificate_remarks(const Certificate& certificate);
// Who measured, each once.
std::string operators_of(const QualifyResult& run);
// Two-sided, of U with this coverage factor of a normal distribution: 0.9545 for 2.
double coverage_of(const JudgedQuantity& quantity);

inline constexpr const char* copying_sentence =
    "It is about this camera alone, with its lens as it was set, at the time and under the "
    "conditions stated. Copies of parts of it need the laboratory's written consent.";

}  // namespace etalon
