// Markers that move while the shutter is open: the mean of still images along the way.
//
// Midpoint rule: n equal parts of the exposure, each by the pose at its middle. While a straight
// edge of contrast C sweeps a pixel along its normal by L px, the pixel's slope is at most sqrt(2)
// C per px. In a part of length h = L/n the rule then errs by at most sqrt(2) C h^2 / (8 L). We
// allow
//     255 C h^2 / (4 L) = 255 C L / (4 n^2) gray,
// for a way that curves (the speed along the normal may vary by 7/8 of itself). For one edge at a
// time: m edges that sweep the same pixel within one exposure may add up to m times that.
#pragma once

#include "core/geometry/rigid.h"
#include "sim/render/renderer.h"

namespace etalon {

// In the camera frame, all markers as one body. The scene's poses are those at the middle of the
// exposure.
struct MotionDuringExposure {
    // Angular velocity (rad/s), then the velocity of the first marker's origin (mm/s).
    Vector6d velocity = Vector6d::Zero();
    double exposure_s = 0.0;
};

// The scene at a time from the middle of the exposure: turned at a constant angular velocity about
// the first marker's origin, which moves on a straight line.
Scene scene_at(const Scene& scene, const MotionDuringExposure& motion, double time_s);

// How long the way of a marker's point in the image is, px: the fastest of 9 x 9 points of each
// marker, at the beginning, middle and end of the exposure, times the exposure and 5/4 for what
// lies between them. Points that are not seen do not count; 0 if none is. Throws NumericalError for
// a velocity or exposure that is not finite or an exposure below 0.
double longest_path_px(const CameraModel& camera, const Scene& scene,
                       const MotionDuringExposure& motion);

// Parts of the exposure that keep the midpoint rule's error within the tolerance (gray) for edges
// of this contrast (radiance): the least n with 255 contrast path / (4 n^2) <= tolerance.
int parts_of_exposure(double path_px, double contrast, double tolerance_gray);

struct MovingImage {
    RenderedImage image;  // its plan is the last part's
    int parts = 1;
    double path_px = 0.0;
};

// Half of options.tolerance_gray is for time, half for each still image. Takes `parts` renders.
// Throws NumericalError as Renderer::render for any part, and when more than 10 000 are needed.
MovingImage render_moving(const Renderer& renderer, const Scene& scene,
                          const MotionDuringExposure& motion, const RenderOptions& options = {});

}  // namespace etalon
