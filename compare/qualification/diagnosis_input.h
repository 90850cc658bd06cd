// What a judged run lays before the search for causes: corners of photographs less expected ones,
// with the covariance of all that is stated for them (docs/causes.md).
#pragma once

#include "compare/diagnosis/causes.h"

namespace etalon {

struct QualificationInput;
struct Qualification;

// `chain` holds the used poses, `result` the registration. Throws NumericalError for sizes that do
// not agree and a marker point without a projection. `chain` must outlive it.
DiagnosisInput diagnosis_input(const QualificationInput& input, const SignatureChain& chain,
                               const Qualification& result);

// Of the used poses (`chain`), with a word on each that was left out; unless an error that explains
// the used ones explains those, too, as a distortion that is far off does near the image's corners.
// Throws as diagnosis_input(). Some 0.5 s, twice that where poses were left out.
Causes causes_of_run(const QualificationInput& input, SignatureChain chain, Qualification result);

}  // namespace etalon
