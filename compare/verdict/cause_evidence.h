// What a judged run lays before the search for causes: corners of photographs less expected ones,
// with the covariance of all that is stated for them (docs/causes.md).
#pragma once

#include "compare/verdict/causes.h"

namespace etalon {

struct QualificationInput;
struct Qualification;

// `chain` holds the used poses, `result` the registration. Throws NumericalError for sizes that do
// not agree and a marker point without a projection. `chain` must outlive it.
CauseEvidence cause_evidence(const QualificationInput& input, const SignatureChain& chain,
                             const Qualification& result);

}  // namespace etalon
