// The conditions under which a PASS is accepted: that the run is what its uncertainty takes it for.
// A condition that is not met withholds PASS; it never makes a FAIL of one or of a FAIL something
// else. One that could not be checked says why.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "compare/uncertainty/bias_field.h"

namespace etalon {

struct Pose;
struct QualificationInput;
struct Qualification;

struct AcceptanceCondition {
    enum class State { met, not_met, not_checked };
    std::string name;  // "volume coverage"
    State state = State::not_checked;
    double value = 0.0, limit = 0.0;  // of what is compared; meaningless when not checked
    std::string unit;
    std::string text;  // what was found in words, or why it was not checked
};
const char* name(AcceptanceCondition::State state);  // "met", "NOT MET", "not checked"

// Volume coverage: in each octant of the visited volume with two or more planned hold-out poses at
// least half of them were used. Residuals: their pooled chi-square does not show (99.9 %) that they
// are more than the noise of repeated frames, renders and declared repeatability. Drift: what
// changed linearly with time over the run, beyond the field, is not shown to exceed the limit of
// the position field's RMS. Repeatability: the differences of poses that were visited again, by
// chi-square like the residuals.
//
// `samples` are those of result.position_field. Throws NumericalError for sizes that do not agree.
std::vector<AcceptanceCondition> acceptance_conditions(const QualificationInput& input,
                                                       const Qualification& result,
                                                       std::span<const FieldSample> samples);

// What noise makes of a pose's measured position: that of its frames, of which there are `times` as
// much as in the photographs, and of the stage as declared. The pose has corner noise and B2.
Eigen::Matrix3d position_covariance(const QualificationInput& input, const Pose& pose,
                                    double times = 1.0);

}  // namespace etalon
