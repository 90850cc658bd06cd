// What the search for causes takes of a judged run: corners of photographs less expected ones, with
// the covariance of all that is stated for them (docs/causes.md), and what the station declares.
#pragma once

#include "compare/diagnosis/causes.h"
#include "compare/diagnosis/error_signatures.h"

namespace etalon {

struct DeclaredStation;
struct QualificationInput;
struct Qualification;

// Of the used poses. Throws NumericalError when one has not a transform for each pose.
std::vector<StageError> stage_errors_of(const DeclaredStation& station,
                                        const std::vector<AnalysedPose>& poses);

// Variance of the marker's centre in each direction, mm^2: by random errors of the stage, and by
// what the uncertainty of its error maps leaves.
double repeatability_mm2(const DeclaredStation& station);
double error_maps_mm2(const DeclaredStation& station);

// The widest plausible standard values of what is undeclared: how far the temperature is off, and
// how much more than the stage the marker grows (aluminium: 23e-6).
inline constexpr double max_temperature_k = 5.0, max_expansion_per_k = 25e-6;

// Standard uncertainties by the names that signatures and candidates have, in their units; marker
// and stage sizes with that of the temperature.
std::map<std::string, double> declared_uncertainties(const DeclaredStation& station);

// What each of them does to the position errors of the used hold-out poses (3 rows per pose, camera
// frame, mm); a column each.
Eigen::MatrixXd declared_fields(const DeclaredStation& station,
                                const std::vector<ErrorSignature>& signatures);

// `chain` holds the used poses and must outlive it, `result` the registration. Throws
// NumericalError for sizes that do not agree and a marker point without a projection.
DiagnosisInput diagnosis_input(const QualificationInput& input, const SignatureChain& chain,
                               const Qualification& result);

// Of the used poses (`chain`), with a misplaced pose for each that was left out, unless what
// explains the used ones explains those as well. Throws as diagnosis_input(). Some 0.5 s, twice
// that where poses were left out.
Causes causes_of_run(const QualificationInput& input, SignatureChain chain, Qualification result);

}  // namespace etalon
