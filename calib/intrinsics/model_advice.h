// Which set of parameters these views support. A richer model always fits its own photos better:
// every view is left out in turn, the camera calibrated from the others, and only the left-out
// view's pose fitted (Stone, "Cross-validatory choice and assessment of statistical predictions",
// 1974).
//
// Advised is the simplest within one standard error of the best (Breiman et al., "Classification
// and Regression Trees", 1984, 3.4.3), paired by view, not more than a quarter above it; not where
// the projection is undetermined, or two halves disagree about it. More: docs/calibration.md.
#pragma once

#include <stop_token>

#include "calib/intrinsics/camera_fit.h"
#include "calib/intrinsics/projection_uncertainty.h"

namespace etalon {

// Two calibrations of one camera that share no photo: every second view each. Their projections'
// difference over the convex hull of the points, after the rotation that takes back most of it,
// weighted by certainty. The halves' covariances say what it should be.

inline constexpr std::size_t min_cross_validation_views = 6;

struct CrossValidation {
    std::array<std::size_t, 2> views{};  // in each half
    // Second minus first camera.
    std::vector<Eigen::Vector2d> pixels, differences_px;
    double rms_px = 0.0, worst_px = 0.0;  // of the distance
    // The RMS that the halves' covariances lead to expect, formal and cluster-robust.
    double expected_formal_px = 0.0, expected_robust_px = 0.0;
};

// `fit` is that of all views and the start of both searches. Throws NumericalError for less than
// six views, and when a half does not determine the camera. Some milliseconds.
CrossValidation cross_validate(std::span<const CalibrationView> views, const CameraFit& fit);

// Second minus first where both see the first's rays, after the rotation (telecentric: about the
// axis, and shifted) that takes back most. `deviations` (px) weigh the rays.
struct ProjectionDifference {
    std::vector<Eigen::Vector2d> pixels, differences_px;
};
ProjectionDifference projection_difference(const CameraModel& second,
                                           const ImageRays& rays_of_first,
                                           const Eigen::VectorXd& deviations);

// One model on one set of views.
struct ModelScore {
    std::string model;
    int parameters = 0;            // without the poses
    std::optional<CameraFit> fit;  // to all views; nothing when there is none
    double rms_px = 0.0;           // of the fit, over all points, of the distance in the image
    // The same for views that were left out; both empty when a view could not be.
    std::vector<double> left_out_squares;  // per view, sum over its points, px^2
    std::optional<double> leave_one_out_rms_px;
    std::string failure;                     // why the fit or a left-out view is missing
    std::optional<std::size_t> failed_view;  // the view that is not predicted

    // Where the points are, after the best rotation: the largest stated deviation, and the RMS
    // difference of two halves (six views or more); px. Nothing where there is none.
    std::optional<double> projection_deviation_px, halves_px;

    // Why it is not advised, however well it predicts: "two halves of the photos differ by 2.5 px";
    // empty for the others. Set by compare_models(), and by score_models() where it is of the other
    // kind, perspective or wide, than the lens.
    std::string doubt = {};
    // Set by compare_models(). How much the mean left-out square is above the best model's, and
    // the standard error of that difference; px^2.
    double above_best = 0.0, above_best_error = 0.0;
    bool overfits = false;
};

struct ModelAdvice {
    std::vector<ModelScore> models;      // from the simplest on
    std::optional<std::size_t> best;     // the smallest leave-one-out error of those without doubt
    std::optional<std::size_t> advised;  // nothing when no view was left out, or all are in doubt
};

// A richer model than the advised one overfits when it predicts worse by more than this share, or
// by more than a standard error, or not at all.
inline constexpr double overfit_share = 0.05;
// The advised model's leave-one-out error over the best one's, at most.
inline constexpr double max_above_best = 1.25;
// A projection is undetermined where it is this much less certain, and halves disagree where they
// differ by this much more, than the best model's or, if larger, the best leave-one-out error.
inline constexpr double max_projection_deviation = 2.0, max_halves_difference = 3.0;
// A model leaves this many times what one of the other kind, perspective or wide, does: such a lens
// it is not, and no view is left out of it.
inline constexpr double max_above_other_kind = 2.0;

// Fits and, from four views on, leaves every view out under each model. A model that cannot be
// fitted has a failure for a score. Needs checked views. A stop throws Interrupted. About 1 ms
// times models times views squared (54 points); on all cores, with the same result for any number
// of them.
std::vector<ModelScore> score_models(std::span<const CalibrationView> views, cv::Size image_size,
                                     std::span<const CalibrationModel> models,
                                     bool leave_out_views = true, const std::stop_token& stop = {});

// The rule of one standard error on such scores, which stand from the simplest model on.
ModelAdvice compare_models(std::vector<ModelScore> scores, std::span<const CalibrationView> views);

}  // namespace etalon
