// A camera's intrinsics from views of a planar target, and what they are worth: the model that the
// views support, points that do not fit, uncertainties of parameters and image, and whether two
// halves of the views agree. docs/calibration.md.
#pragma once

#include "calib/intrinsics/board_shape.h"
#include "calib/intrinsics/calibration_covariance.h"
#include "calib/intrinsics/model_advice.h"

namespace etalon {

struct CalibratedView {
    // Nothing, and no residuals, of a view that was left out and that no pose explains.
    std::optional<Rigid> camera_from_target;
    std::vector<Eigen::Vector2d> residuals_px;  // photo minus model, of all its points
    std::vector<bool> left_out;                 // of each point: did not fit, was not used
    // Over the points that were used, of the distance in the image; of a view that was left out as
    // a whole, over all of its points with only the pose fitted.
    double rms_px = 0.0;
    // The same with the camera calibrated without this view.
    std::optional<double> left_out_rms_px = std::nullopt;

    bool used() const;
};

struct CameraCalibration {
    // With the stated covariance of the model's parameters.
    CameraModel camera;
    CalibrationModel model;
    double rms_px = 0.0;                         // over the points that were used
    std::optional<double> leave_one_out_rms_px;  // over the same points; needs four views
    double condition_number = 0.0;               // see CameraFit
    std::vector<CalibratedView> views;           // as given
    ModelAdvice advice;                          // of the views that were used
    CalibrationCovariances covariances;
    std::vector<ParameterDeviation> deviations;
    // 95 %, in the order of the parameters; of a board fitted with them for the board found.
    std::vector<std::optional<ProfileInterval>> intervals;
    ProjectionUncertainty uncertainty;
    std::optional<CrossValidation> halves;  // needs six views that determine the camera in halves
    // Of the model that was taken with the board as drawn; nothing: these views, or a telecentric
    // camera, cannot tell.
    std::optional<BoardFlatness> flatness;
    // When it was asked for: everything above is of views shaped by it. leave_one_out_rms_px and
    // the views' own are of boards fitted without the view, the advice holds this one.
    std::optional<BoardShape> board;

    std::size_t points() const, points_left_out() const;  // of all views
    // Parameters whose interval is skewed, so that a deviation does not describe it.
    std::vector<std::size_t> skewed_intervals() const;
    // The chosen model is richer than the advised one and overfits.
    bool overfits() const;
};

struct CalibrationOptions {
    std::optional<std::string> model = std::nullopt;  // nothing: the advised one
    // Of every model that may follow the lens (calib/intrinsics/calibration_start.h), of a named
    // one those of its kind; without it "standard", or "kannala_brandt", when no model is named.
    bool leave_one_out = true;
    int resamples = bootstrap_resamples;  // 0: no bootstrap
    bool fit_board = false;               // the board's shape with the camera
    std::stop_token stop = {};            // ends it between two fits: Interrupted is thrown
};

// A ratio of the stated standard deviation to the formal one that is worth a warning.
inline constexpr double suspicious_deviation_ratio = 1.5;
// Of all points, more than this share of outliers is refused.
inline constexpr double max_outlier_share = 0.1;

// Needs three views of at least four points each, not collinear, in different orientations. Throws
// ConfigError for an unknown model; NumericalError, naming the view by its index from 0, for what
// check_view() refuses, undetermined parameters, a model that folds inside a view, too many
// outliers, and a board's shape with a telecentric model. Some seconds for 13 views of 54 points;
// runs on all cores, with the same result for any number of them.
CameraCalibration calibrate_camera(const std::vector<CalibrationView>& views, cv::Size image_size,
                                   const CalibrationOptions& options = {});

}  // namespace etalon
