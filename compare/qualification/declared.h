// What a station declares, in the form that a run's figures are held against it: stage errors of
// the used poses, standard uncertainties by name, variances of positions.
#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <vector>

#include "compare/diagnosis/error_candidates.h"
#include "compare/diagnosis/error_signatures.h"

namespace etalon {

struct DeclaredStation;

// Of the used poses. Throws NumericalError when one has not a transform for each pose of the
// station.
std::vector<StageError> stage_errors_of(const DeclaredStation& station,
                                        const std::vector<AnalysedPose>& poses);
std::vector<StageAxisMotion> axis_motions_of(const std::vector<StageAxisMotion>& all,
                                             const std::vector<AnalysedPose>& poses);

// Variance of the marker's centre in each direction, mm^2: by random errors of the stage, and by
// what the uncertainty of its error maps leaves.
double repeatability_mm2(const DeclaredStation& station);
double error_maps_mm2(const DeclaredStation& station);

// The widest plausible standard values of what a station may leave undeclared: how far the
// temperature is off, and by how much more than the stage the marker grows (aluminium: 23e-6).
inline constexpr double max_temperature_k = 5.0, max_expansion_per_k = 25e-6;

// Standard uncertainties by the names that signatures and error_candidates have, in their units.
// Temperature changes the sizes of marker and stage, one that is not declared by the widest
// plausible.
std::map<std::string, double> declared_uncertainties(const DeclaredStation& station);

// What each of them does to the position errors of the used hold-out poses (3 rows per pose, camera
// frame, mm); a column each.
Eigen::MatrixXd declared_fields(const DeclaredStation& station,
                                const std::vector<ErrorSignature>& signatures);

}  // namespace etalon
