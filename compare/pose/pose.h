// One pose of a run. Each stage of the run adds to the type before it: PlannedPose, VisitedPose,
// AnalysedPose. Times are seconds since the run began.
#pragma once

#include "capture/frame/frame_log.h"
#include "compare/pose/pose_bias.h"

namespace etalon {

// How far repeated frames leave a corner apart: of one coordinate of the mean over the frames.
struct CornerNoise {
    double variance_px2 = 0.0;
    double degrees_of_freedom = 0.0;  // (frames - 1) x coordinates
};

// A pose that was read from the photographs' pixels (compare/photometric/photometric_detector.h).
struct PhotometricReading {
    Rigid camera_from_marker;
    Matrix6d covariance;  // left perturbation, rot, trans
};

// Photograph (its first whole frame) minus render, after a photometric model is fitted, scored on
// the cells that were not fitted (compare/photometric/photo_match.h).
struct PhotoResidual {
    double rms_gray = 0.0, p99_gray = 0.0;
    double psf_sigma_px = 0.0;  // of the model
};

// As the plan has it (station/setup/plan.h).
struct PlannedPose {
    std::vector<double> target = {};          // per axis, mm or rad
    bool hold_out = false;                    // decided before anything is solved
    int index = 0;                            // in the plan, from 0; names the frames
    std::optional<std::size_t> repeats = {};  // the earlier pose that has the same target
};

// The stage was there and the camera took its frames (station/qualify/runner.h).
struct VisitedPose : PlannedPose {
    // Side from which each axis came: +1 upwards, -1 downwards, 0 did not move.
    std::vector<int> approach = {};
    double move_start_s = 0.0, done_s = 0.0;
    std::optional<double> settled_s = {};
    // One after settling and one after each frame; of each axis, mm or rad.
    std::vector<std::vector<double>> readings = {};
    // Per axis, mm or rad: mean of the n readings, their standard deviation s, and the mean's
    // standard uncertainty, the larger of s and the axis' declared noise over sqrt(n).
    std::vector<double> read_back = {}, read_back_deviation = {}, read_back_uncertainty = {};
    // Of the mean; its covariance as in stage/axes/kinematics.h.
    Rigid base_from_carriage = {};
    Matrix6d stage_covariance = Matrix6d::Zero();

    std::vector<FrameRecord> frames = {};
    ImagePoints corners = {};  // mean over the frames that saw it; empty: none did
    int detections = 0;        // number of such frames
    // Nothing with a single such frame, and when all are alike, as rounding hides the noise.
    std::optional<CornerNoise> corner_noise = {};
    std::optional<CornerNoise> stated_noise = {};  // by the sensor section, for as many frames
    std::optional<PhotometricReading> photometric = {};  // of hold-out poses
    // The photometric pose, and of a render there the corners less the truth; nothing, empty: not
    // known.
    std::optional<Rigid> seen_at = {};
    ImagePoints detector_bias_px = {};

    bool is_detected() const { return !corners.empty(); }
};

// What qualify() found of it (compare/qualification/qualification.h).
struct AnalysedPose : VisitedPose {
    bool used = false;      // in the registration (training) or in the field (hold-out)
    bool outlying = false;  // left out of both (compare/diagnosis/outlier_poses.h)
    std::optional<CornerNoise> noise = {};  // that counts (find_noise)
    PoseBias bias = {};  // of training poses B2 alone, for the record; never judged
    bool is_judged() const { return hold_out && used; }
    // Of hold-out poses: the noise-free render at the registered pose ("renders/0007.png"), and the
    // photograph against it.
    std::string render_file = {};
    std::optional<PhotoResidual> residual = {};
};

// Sets `noise` of each detected pose: that of its own frames, else of the other poses' frames,
// pooled by degrees of freedom, else what the sensor states for it or, pooled, for others, else
// nothing. A variance of 0 counts as not known.
void find_noise(std::span<AnalysedPose> poses);

// Indices in the plan of poses whose frames left the corners at the same places to the last bit.
std::vector<int> poses_of_equal_frames(std::span<const VisitedPose> poses);

}  // namespace etalon
