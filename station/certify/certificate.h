// A calibration certificate of a run: what a laboratory must state (ISO/IEC 17025:2017, 7.8), for
// people as HTML on A4, and for machines as Digital Calibration Certificate. docs/certificate.md.
//
// Every number is the record's. Text of files and devices is escaped.
#pragma once

#include <string>
#include <vector>

#include "station/certify/certificate_form.h"
#include "station/record/qualify_result.h"

namespace etalon {

// Of a run from which nothing is missing (station/certify/traceability.h). The run must outlive it.
struct Certificate {
    const QualifyResult& run;
    CertificateForm form;
    std::string issued;                  // "2026-03-09"
    std::string log_sha256, run_sha256;  // of the record's events.jsonl and run.json
};

std::string certificate_html(const Certificate& certificate);

// Schema 3.2.0 of the DCC, with units by D-SI 2.1 (Physikalisch-Technische Bundesanstalt).
std::string dcc_xml(const Certificate& certificate);

// ---- what both say

// Whether the camera conforms, a sentence.
std::string conformity_sentence(const Certificate& certificate);
// How it was measured, sentences.
std::vector<std::string> method_sentences(const Certificate& certificate);
// What limits this certificate: interruptions, what was not met, why there is no verdict.
std::vector<std::string> certificate_remarks(const Certificate& certificate);
// Who measured, each once.
std::string operators_of(const QualifyResult& run);
// Two-sided, of U with this coverage factor of a normal distribution: 0.9545 for 2.
double coverage_of(const JudgedQuantity& quantity);

inline constexpr const char* copying_sentence =
    "It is about this camera alone, with its lens as it was set, at the time and under the "
    "conditions "
    "stated. Copies of parts of it need the laboratory's written consent.";

}  // namespace etalon
