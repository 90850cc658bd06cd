// The cameras and scenes of the stability cases.
#pragma once

#include "calib/camera/camera_model.h"
#include "sim/scene/scene.h"

namespace etalon {

// A marker of 10 x 10 cells without symmetry.
struct StabilityMarker {
    double side_px = 70.0;  // of the grid, were it not tilted, at the image's depth
    double depth_mm = 400.0;
    double tilt_deg = 25.0;  // about an axis at 35 degrees in the image, after a turn of 20
    Eigen::Vector2d off_centre_px = {4.3, -2.7};
};

// 160 x 120 px of 10 um, f = 800 px (image distance 8 mm), 550 nm, no distortion.
CameraModel short_camera(double f_number, double focus_mm);

// All 14 coefficients, each of a size of its own.
Distortion every_distortion();

// The marker before the image's centre.
Scene marker_scene(const CameraModel& camera, const StabilityMarker& place);

// Cells of radiance 0 or 1 without a pattern.
cv::Mat random_cells(int rows, int columns, std::uint64_t seed);

}  // namespace etalon
