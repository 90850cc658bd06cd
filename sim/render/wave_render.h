// Renders with the wave-optical point spread (`psf: wave`): exact areas of what the chief rays see,
// convolved with the pattern of the local defocus, which holds the aperture too. That defocus is
// the plane's at the centre of each tile of 4 x 4 px; the disk's tilt within one pattern is not in
// the model.
#pragma once

#include <stop_token>

#include "sim/psf/wave_point_spread.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

// For `psf: wave`. Throws NumericalError, naming the number, unless there is exactly one marker
// (the defocus is its plane's) and its blur radius stays within max_wave_blur_px.
void check_wave_scene(const Scene& scene, const CameraModel& camera);

// The marker's difference from the background over a region, linear radiance, CV_32FC1 of its size;
// 0 where a pixel has no ray. `filter` and `map` are of the camera of `view`, of a checked scene.
// The tail's finite reach leaves out at most half the tolerance. Parallel, the same bytes for any
// number of threads. 50 ms of CPU time for each step of the blur radius on the first call, some us
// a pixel that is not constant, and an FFT of twice marker and region for each pixel of change in
// blur radius. A stop throws Interrupted.
cv::Mat wave_difference(const MarkerView& view, const UndistortionMap& map,
                        const WaveFilter& filter, const cv::Rect& region, double tolerance_gray,
                        const std::stop_token& stop = {});

}  // namespace etalon
