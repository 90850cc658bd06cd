// Every error that a run's differences may be attributed to, with what it does to the corners of
// every used pose, to first order. One with several numbers (a sine and a cosine, the components of
// a drift) has several columns.
#pragma once

#include <array>
#include <map>

#include "compare/diagnosis/error_catalogue.h"

namespace etalon {

// One axis at the poses of a chain, and where the carriage would be with it `step` further than it
// read, or `step` aside.
struct StageAxisMotion {
    std::string name;
    bool is_linear = true;
    double step = 0.0;             // mm, or rad of a rotary axis
    std::vector<double> position;  // as read back, mm or rad
    std::vector<int> approach;  // side that the axis came from, as in VisitedPose; empty: not known
    std::vector<Rigid> advanced;  // base_from_carriage
    // Two ways across a linear axis, at `step`; empty for a rotary one.
    std::array<std::vector<Rigid>, 2> aside;
};

// "mm", or "rad" of a rotary axis.
const char* unit_of(const StageAxisMotion& axis);

// Positions or times from -1 to 1 over what was visited; all zero where nothing moved.
Eigen::VectorXd normalised(const std::vector<double>& of);

struct ErrorCandidate {
    std::string name, unit;
    std::string remedy;  // what to do first: "look at the stage's axis z: backlash"
    double size = 0.0;   // that one unit of a column stands for
    // 2 rows per point and pose, px at `size`; of that of `only_pose` alone where there is one.
    Eigen::MatrixXd corners_px;
    Eigen::MatrixXd pixels = {};        // the request's pixel errors at `size`, by column; empty: 0
    int tried = 1;                      // of how many like it (periods, poses) this is the best
    std::optional<int> only_pose = {};  // of the chain's: it does nothing to the others
};

struct CandidateRequest {
    const SignatureChain& chain;  // the used poses
    std::vector<StageError> stage_errors;
    std::vector<StageAxisMotion> axes;           // of the chain's poses; may be empty
    std::vector<double> times_s;                 // of the chain's poses; may be empty
    std::vector<std::string> pixel_errors = {};  // PixelEvidence::errors (image_agreement.h)
};

// Camera, marker, detector, stage, drift; those named in `sizes` are linearised at that size.
// Throws NumericalError when a corner has no projection or sizes do not agree. Milliseconds.
std::vector<ErrorCandidate> error_candidates(const CandidateRequest& request,
                                             const std::map<std::string, double>& sizes = {});

// That the marker was elsewhere at one of the poses: a candidate for each.
std::vector<ErrorCandidate> misplaced_poses(const CandidateRequest& request);
std::string misplaced_pose_name(int index);
std::string misplaced_pose_remedy(const std::string& pose);  // "pose 7 along x by 96.1 mm"

// Random errors: every pose moves on its own, by columns of 1 mm (rad).
struct RandomErrorCandidate {
    std::string name, unit, remedy;
    std::vector<Eigen::MatrixXd> corners_px;  // per pose
};

// Of each axis along itself, and of the marker in all directions.
std::vector<RandomErrorCandidate> random_error_candidates(const CandidateRequest& request);

// Of the corners, 2 rows per point and pose, when the axis goes one step further than it reads.
Eigen::VectorXd sensitivity_px(const CandidateRequest& request, const StageAxisMotion& axis);

// An axis whose error repeats with the first of these periods (mm or rad), or as well the others:
// on a grid of positions frequencies that differ by that of the grid look alike.
ErrorCandidate repeating_error(const StageAxisMotion& axis, const Eigen::VectorXd& sensitivity_px,
                               const std::vector<double>& periods, int tried);

}  // namespace etalon
