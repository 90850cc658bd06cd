// Renders with the wave-optical point spread (`psf: wave`): what the chief rays see, by exact
// areas, convolved with the pattern for the local defocus. No aperture average: the pattern holds
// defocus and diffraction together.
//
// The defocus at an output pixel is that of the marker's plane where the pixel's chief ray meets
// it, taken at the centre of each tile of 4 x 4 px. The disk's own tilt within one pattern is not
// in the model.
#pragma once

#include "sim/psf/wave_point_spread.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

// For `psf: wave`. Throws NumericalError, naming the number, unless there is exactly one marker
// (the defocus is its plane's) and its blur radius stays within max_wave_blur_px.
void check_wave_scene(const Scene& scene, const CameraModel& camera);

// The marker's difference from the background over a region of the image, linear radiance, CV_32FC1
// of its size; 0 where a pixel has no ray. `filter` and `map` are of the camera that `view` was
// made for, of a scene that was checked. What the tail's finite reach leaves out is at most half
// the tolerance. Parallel, the same bytes for any number of threads. Takes about 50 ms of CPU time
// for each step of the blur radius on the first call (kernels), then some us a pixel that is not
// constant; the tail one FFT of twice the size of marker and region for each pixel of change in
// blur radius.
cv::Mat wave_difference(const MarkerView& view, const UndistortionMap& map,
                        const WaveFilter& filter, const cv::Rect& region, double tolerance_gray);

}  // namespace etalon
