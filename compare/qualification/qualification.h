// The analysis of a run: registration, biases, fields, uncertainty budget, error signatures and
// verdict. Renders through a callback, touches no device or file. Method: docs/metrology.md.
#pragma once

#include <stop_token>

#include "compare/diagnosis/error_signatures.h"
#include "compare/diagnosis/image_agreement.h"
#include "compare/diagnosis/image_coherence.h"
#include "compare/qualification/acceptance.h"
#include "compare/qualification/joint_fit.h"
#include "compare/qualification/limits_file.h"
#include "compare/uncertainty/lack_of_fit.h"
#include "compare/uncertainty/length_error.h"
#include "compare/uncertainty/uncertainty_budget.h"

namespace etalon {

struct Qualification;

// A standard uncertainty that the station declares, with its stage error.
struct DeclaredStageTerm {
    StageError error;  // any small size; the field is scaled to the uncertainty
    // True: a term of the budget; without a value it is `unknown` and the verdict cannot be PASS.
    // False: only a signature (squareness that nobody has measured, say).
    bool in_budget = false;
    std::optional<double> standard_uncertainty;  // in error.unit
};

// Random errors of the stage: how far repeated approaches leave the marker's centre apart.
struct DeclaredRepeatability {
    std::string axis;
    // Standard deviation at the marker's centre, mm, of a rotary axis too. Nothing: unknown.
    std::optional<double> marker_mm;
    double reading_mm =
        0.0;  // the same of the declared noise of a single reading; 0: none declared
};

// What the uncertainty of an axis' error map leaves at the marker's centre, standard, mm. Its
// points may be wrong together, in the worst way.
struct DeclaredErrorMap {
    std::string axis;
    double marker_rms_mm = 0.0, marker_max_mm = 0.0;  // over the poses
};

// How far the temperature may be from that of the declared sizes.
struct DeclaredTemperature {
    double standard_uncertainty_k = 0.0;
    double marker_expansion_per_k = 0.0, stage_expansion_per_k = 0.0;     // relative
    double reference_c = 20.0;                                            // of these sizes (ISO 1)
    double degrees_of_freedom = std::numeric_limits<double>::infinity();  // of a measured one
    std::string basis = {};  // how it was measured; empty: declared
};

// What the station and the calibration under test say, and how a render of it is made.
struct DeclaredStation {
    const CameraModel* camera = nullptr;  // the calibration under test
    ObjectPoints points_mm;               // of the marker, as its detector reports them
    Rigid nominal_carriage_from_marker;   // as mounted by design: fixes the gauge freedoms only
    // The motion that the plan's volume allows (calib/registration/stage_motion.h), which training
    // poses need. Empty: not checked.
    std::vector<Rigid> stage_reach;
    // For poses without a known detector's bias: called once per training pose and round, then once
    // per hold-out pose; may throw Interrupted.
    RenderAndDetect render_and_detect;
    double render_noise_ratio = 0.0;  // variance of its corners over that of a pose's mean corners
    double render_edge_bound_px = 0.0;  // how far its edges may be off; 0 for exact ones
    std::vector<DeclaredStageTerm> stage_terms;
    std::vector<DeclaredRepeatability> repeatability;
    std::vector<DeclaredErrorMap> error_maps;
    // Relative standard uncertainty of the marker's printed size. Nothing: unknown.
    std::optional<double> marker_size_uncertainty;
    // Standard uncertainty of how far the marker's edge stands out of its plane. Nothing: unknown.
    std::optional<double> marker_flatness_mm = {};
    std::optional<DeclaredTemperature> temperature = {};  // nothing: unknown
    Limits limits;
};

struct RunMeasurements {
    // Without corner noise, photometric poses, times or repeats what rests on them is SKIPPED or
    // not checked.
    std::vector<VisitedPose> poses;
    // Of all poses, for backlash, bent guides and errors that repeat; empty: not looked for.
    std::vector<StageAxisMotion> axis_motions = {};
    std::vector<Rigid> expected_poses = {};     // camera_from_marker; empty: from the corners
    std::optional<ImageAgreement> pixels = {};  // of hold-out photographs; nothing: not compared
};

struct QualificationOptions {
    std::uint64_t seed = 1;  // of the simultaneous band's draws
    // For studies of thousands of runs: signatures and effects of errors from another run of the
    // same plan. Taken when they are of as many poses.
    const Qualification* known_run = nullptr;
    const NoiseDraws* known_draws = nullptr;  // for the same; nothing: drawn by `seed`
    bool measure_reported = true;             // also measure what has no limit
    bool monte_carlo = false;      // also propagate the budget by Monte Carlo. Some 0.3 s
    bool look_for_causes = false;  // some 0.5 s
    std::stop_token stop = {};
};

struct QualificationInput : DeclaredStation, RunMeasurements {
    QualificationOptions options = {};
};

struct DetectionCounts {
    int training = 0, training_detected = 0, hold_out = 0, hold_out_detected = 0;
    double rate() const;  // of all poses; 0 when there are none
};

// A pose that no registration and no field explains.
struct RejectedPose {
    int index = 0;
    std::string text;  // "pose 7 along x by 96.1 mm"
};

struct PhotometricField {
    BiasField position_field;
    FieldSummary position_summary;
    int poses = 0;  // hold-out poses that have B4
};

// What all corners together say of the camera (compare/qualification/joint_fit.h).
struct CornerFigures {
    JointFit fit;
    FieldSummary camera_alone;  // the field that the camera's errors make by themselves
    // Of edges that lie elsewhere in photographs than in renders, where there are any.
    std::optional<FieldSummary> edges_alone = {};
    ImageCoherence coherence;
    double coherent_rms_mm = 0.0;  // what correlated residuals make of the positions
};

struct Qualification {
    std::vector<AnalysedPose> poses;  // of the input, with what was found of each
    Outcome verdict = Outcome::inconclusive;
    // In the order of quantity_kinds(): those with a limit, and those without: SKIPPED, limit 0,
    // with value and U where they were measured.
    std::vector<JudgedQuantity> quantities, reported;
    DecisionRule rule;                 // that they are judged by
    FamilyWiseRisk risk;               // of the judged ones together
    std::vector<std::string> reasons;  // why the verdict is not PASS, one sentence each

    DetectionCounts detection;

    // Nothing where the run did not get as far: too few detected poses.
    std::optional<BiasCorrectedRegistration> registration;
    std::optional<BiasField> position_field, rotation_field;  // of hold-out B3, camera frame
    FieldSummary position_summary, rotation_summary;          // over all poses and midpoints
    std::optional<LackOfFit> position_lack_of_fit;            // nothing without repeated frames
    std::optional<LengthErrors> lengths;
    std::optional<PhotometricField> photometric;  // nothing with too few photometric poses
    std::optional<ImageAgreement> pixels;         // nothing where not compared

    std::vector<RejectedPose> outlying;           // left out of registration and fields
    std::vector<AcceptanceCondition> conditions;  // one that is NOT MET withholds PASS

    std::vector<BudgetRow> budget;
    bool budget_complete = false;  // nothing that is unknown could change the verdict

    std::vector<ErrorSignature> signatures;
    std::optional<ErrorEffects> effects;
    std::optional<CornerFigures> corners;  // nothing where the run did not get as far
    std::optional<Causes> causes;          // nothing where not looked for
};

// Fewer detected poses give SKIPPED quantities and the verdict INCONCLUSIVE.
inline constexpr int min_training_poses = 8;
inline constexpr int min_hold_out_poses = 15;

// Throws NumericalError for inconsistent or non-finite input, a stage that did not move, and a
// registration that does not converge; Interrupted when `stop` is requested; whatever
// render_and_detect throws passes through. Single-threaded; its cost is that of the renders.
Qualification qualify(const QualificationInput& input);

}  // namespace etalon
