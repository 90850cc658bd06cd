// Intrinsics from views of a planar target: OpenCV's calibrateCamera (Zhang, "A flexible new
// technique for camera calibration", PAMI 2000) with free fx, fy, cx, cy and k1 k2 p1 p2 k3, and
// what it does not tell: whether the model predicts a view that it has not seen (leave-one-out),
// and how far the formal standard deviations can be trusted.
//
// Takes observations, never photos; corners come from compare/chessboard_corners.h.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "calib/calibration_view.h"
#include "calib/camera_model.h"
#include "core/rigid.h"

namespace etalon {

struct CalibratedView {
    Rigid camera_from_target;
    double rms_px = 0.0;  // over the view's points, of the distance in the image
    // The same with the camera calibrated without this view and only its pose fitted to it.
    std::optional<double> left_out_rms_px;
};

// One standard deviation of a parameter, three ways. Errors of corners in one photo are not
// independent, which the formal one assumes; the other two only assume independent views.
struct ParameterDeviation {
    std::string name;                 // "fx"
    double formal = 0.0;              // from J^T J and the residuals' variance
    double cluster_robust = 0.0;      // sandwich over views (Liang and Zeger, 1986)
    std::optional<double> jackknife;  // over views, from the leave-one-out calibrations

    double largest() const;
};

struct CameraCalibration {
    // With the covariance of all nine parameters: the formal correlations, scaled to the largest of
    // the standard deviations.
    CameraModel camera;
    double rms_px = 0.0;                         // over all points
    std::optional<double> leave_one_out_rms_px;  // over all points; needs four views
    std::vector<CalibratedView> views;           // as given
    std::vector<ParameterDeviation> deviations;  // in the order of the covariance
};

struct CalibrationOptions {
    bool leave_one_out = true;  // one more calibration per view
};

// Needs three views of at least six points each that are not collinear, and different orientations.
// Throws NumericalError, naming the view by its index from 0, for fewer, for points and pixels that
// do not match, are not finite or not in the plane z = 0, for geometry that does not determine the
// parameters, and for a model that folds over inside a view.
// Costs some 10 ms per view of 54 points, times the number of views when leaving out; runs on all
// cores, with the same result for any number of them.
CameraCalibration calibrate_camera(const std::vector<CalibrationView>& views, cv::Size image_size,
                                   const CalibrationOptions& options = {});

}  // namespace etalon
