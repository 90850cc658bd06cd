#include "calib/files/pixel_origin.h"

namespace etalon {

// Sources:
//   OpenCV, ROS    pixel centres at integers; camera_calibration of ROS calls cv::calibrateCamera
//   Kalibr         its chessboards and tags end in cv::cornerSubPix, whose pixel centres are at
//                  integers (Kalibr's issue 115 tries both detectors on drawn images)
//   mrcal          "No changes to the content are made" from and to ROS' and Kalibr's models
//                  (mrcal-from-ros(1), mrcal-to-kalibr(1))
//   MATLAB         "specifies the pixel center at (1,1)" (documentation of
//                  cameraIntrinsicsToOpenCV, which subtracts 1 from the principal point)
//   BoofCV         its simulator takes a pixel's value from model coordinates x to x + 1
//                  (SimulatePlanarWorld.computeProjectionTable), and its chessboard detector adds
//                  0.5 to what it finds in samples at integers (DetectChessboardCornersX.process);
//                  no document says so
//   COLMAP         "the center of the upper left most pixel has coordinate (0.5, 0.5)"
//                  (its tutorial on features)
double first_pixel_centre(CalibrationTool tool) {
    switch (tool) {
        case CalibrationTool::opencv:
        case CalibrationTool::ros:
        case CalibrationTool::kalibr:
        case CalibrationTool::mrcal:
            break;
        case CalibrationTool::matlab:
            return 1.0;
        case CalibrationTool::boofcv:
        case CalibrationTool::colmap:
            return 0.5;
    }
    return 0.0;
}

Intrinsics from_pixels_of(CalibrationTool tool, Intrinsics intrinsics) {
    const double shift = first_pixel_centre(tool);
    intrinsics.cx -= shift;
    intrinsics.cy -= shift;
    return intrinsics;
}

Intrinsics to_pixels_of(CalibrationTool tool, Intrinsics intrinsics) {
    const double shift = first_pixel_centre(tool);
    intrinsics.cx += shift;
    intrinsics.cy += shift;
    return intrinsics;
}

}  // namespace etalon
