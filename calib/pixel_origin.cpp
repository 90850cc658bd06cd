#include "calib/pixel_origin.h"

namespace etalon {

// Sources:
//   OpenCV, ROS    pixel centres at integers; camera_calibration of ROS calls cv::calibrateCamera
//   Kalibr         pixel centres at integers as OpenCV's (COLMAP's FAQ on reusing OpenCV/Kalibr
//                  parameters); its corners come from cv::cornerSubPix
//   mrcal          "No changes to the content are made" from ROS/OpenCV models (mrcal-from-ros(1))
//   MATLAB         "specifies the pixel center at (1,1)" (documentation of
//                  cameraIntrinsicsToOpenCV, which subtracts 1 from the principal point)
//   BoofCV         its chessboard detector finds corners in samples at integers and then adds 0.5
//                  (DetectChessboardCornersX.process); no document says so
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
