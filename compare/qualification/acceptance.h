// The conditions under which a PASS is accepted: that the run is what its uncertainty takes it for,
// and that nothing cancels in the judged field. One that is not met withholds PASS. So does one
// that could not be checked, unless the limits let it (may_be_unchecked).
#pragma once

#include <string>

#include "compare/uncertainty/bias_field.h"

namespace etalon {

struct AnalysedPose;
struct DeclaredStation;
struct QualificationInput;
struct Qualification;

struct AcceptanceCondition {
    enum class State { met, not_met, not_checked, not_asked };  // not_asked: not in the plan
    std::string name;                                           // "volume coverage"
    State state = State::not_checked;
    double value = 0.0, limit = 0.0;  // of what is compared; meaningless when it was not
    std::string unit;
    std::string text;  // what was found in words, or why it was not checked

    bool is_compared() const { return state == State::met || state == State::not_met; }
};
// "met", "NOT MET", "not checked", "not asked for".
const char* name(AcceptanceCondition::State state);

//     volume coverage       in each octant with two or more planned hold-out poses at least half of
//                           them were used
//     residuals             their pooled chi-square does not show (99.9 %) that they are more than
//                           the noise of frames, renders and declared repeatability
//     over the image        those of different poses do not agree at the same place in the image
//     declared inputs       none is off by more than 4 standard uncertainties
//     camera, edges alone   the field of these by themselves (joint_fit.h) is within the limits
//     drift                 a change linear in time, beyond the field, is not shown to exceed the
//                           limit of the position field's RMS; in a run with a long pause nor one
//                           linear in time without it, nor one from before to after it
//     rest within poses     the stage's readings during a pose do not scatter by more than a
//                           quarter of that limit, or than is declared
//     repeatability         differences of poses visited again, by chi-square
//
// `samples` are those of result.position_field. Throws NumericalError for sizes that do not agree.
std::vector<AcceptanceCondition> acceptance_conditions(const QualificationInput& input,
                                                       const Qualification& result,
                                                       std::span<const FieldSample> samples);

// Of a pose's measured position: by `times` the noise of its frames and by the stage as declared.
// The pose has corner noise and B2.
Eigen::Matrix3d position_covariance(const DeclaredStation& station, const AnalysedPose& pose,
                                    double times = 1.0);

}  // namespace etalon
