// Whether a run can be certified: every input of its uncertainty budget traced to a certificate
// that was in force on its days, the room measured, and everything known that a certificate must
// state (ISO/IEC 17025:2017, 7.8).
#pragma once

#include <string>
#include <vector>

#include "station/certify/certificate_form.h"
#include "station/record/qualify_result.h"

namespace etalon {

// First and last day of the measurements, UTC: "2026-03-07".
struct RunDays {
    std::string first, last;
};
RunDays days_of(const QualifyResult& run);

// What is missing, a line each; none: the run can be certified. INCONCLUSIVE runs and resumed ones
// can, if they have measured: the certificate says so.
std::vector<std::string> missing_for_certificate(const QualifyResult& run,
                                                 const CertificateForm& form);

}  // namespace etalon
