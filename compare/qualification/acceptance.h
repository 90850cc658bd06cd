// The conditions under which a PASS is accepted: that the run is what its uncertainty takes it for,
// and that nothing cancels in the judged field. A condition that is not met withholds PASS; it
// never makes a FAIL of one or of a FAIL something else. One that could not be checked says why and
// withholds PASS as well, unless the limits let it (may_be_unchecked).
#pragma once

#include <span>
#include <string>
#include <vector>

#include "compare/uncertainty/bias_field.h"

namespace etalon {

struct AnalysedPose;
struct DeclaredStation;
struct QualificationInput;
struct Qualification;

struct AcceptanceCondition {
    // not_asked: the plan leaves out what would check it.
    enum class State { met, not_met, not_checked, not_asked };
    std::string name;  // "volume coverage"
    State state = State::not_checked;
    double value = 0.0, limit = 0.0;  // of what is compared; meaningless when it was not
    std::string unit;
    std::string text;  // what was found in words, or why it was not checked

    bool is_compared() const { return state == State::met || state == State::not_met; }
};
// "met", "NOT MET", "not checked", "not asked for".
const char* name(AcceptanceCondition::State state);

// Volume coverage: in each octant of the visited volume with two or more planned hold-out poses at
// least half of them were used. Residuals: their pooled chi-square does not show (99.9 %) that they
// are more than the noise of frames, renders and declared repeatability. Residuals over the image:
// those of different poses do not agree where they share a place in the image. Declared inputs:
// none is off by more than 4 standard uncertainties. Camera alone, edges alone: the field that
// these make by themselves is within the limits by the decision rule
// (compare/qualification/joint_fit.h). Drift: what changed linearly with time over the run, beyond
// the field, is not shown to exceed the limit of the position field's RMS. Repeatability: the
// differences of poses that were visited again, by chi-square like the residuals.
//
// `samples` are those of result.position_field. Throws NumericalError for sizes that do not agree.
std::vector<AcceptanceCondition> acceptance_conditions(const QualificationInput& input,
                                                       const Qualification& result,
                                                       std::span<const FieldSample> samples);

// What noise makes of a pose's measured position: that of its frames, of which there are `times` as
// much as in the photographs, and of the stage as declared. The pose has corner noise and B2.
Eigen::Matrix3d position_covariance(const DeclaredStation& station, const AnalysedPose& pose,
                                    double times = 1.0);

}  // namespace etalon
