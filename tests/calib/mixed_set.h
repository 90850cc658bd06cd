// Sets of views that were taken with two cameras, or one camera at two zooms.
#pragma once

#include "tests/calib/synthetic_views.h"

namespace etalon::test {

inline constexpr double mixed_noise_px = 0.1;

inline CameraModel zoomed(double zoom, double distortion = 1.0) {
    CameraModel camera = calibration_truth();
    camera.intrinsics.fx *= zoom;
    camera.intrinsics.fy *= zoom;
    camera.distortion.k1 *= distortion;
    camera.distortion.k2 *= distortion;
    return camera;
}

// Twelve views, those of `aside` with another camera.
inline std::vector<CalibrationView> mixed(const std::vector<std::size_t>& aside,
                                          const CameraModel& other, int seed = 5) {
    auto views = synthetic_views(calibration_truth(), 12, mixed_noise_px, seed);
    for (const std::size_t i : aside)
        views[i] = synthetic_view(other, synthetic_pose(int(i)), mixed_noise_px, 500 + int(i));
    return views;
}

}  // namespace etalon::test
