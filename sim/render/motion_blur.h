// Markers that move while the shutter is open: the mean of still images along the way, by the
// midpoint rule of n parts. A straight edge of contrast C that sweeps a pixel by L px errs by at
// most sqrt(2) C L / (8 n^2). Allowed are 255 C L / (4 n^2) gray, for a way that curves; m edges
// that sweep the same pixel may add up to m times that.
#pragma once

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

// Parts of the exposure that keep the midpoint rule's error within the tolerance (gray) for edges
// of this contrast (radiance): the least n with 255 contrast path / (4 n^2) <= tolerance.
int parts_of_exposure(double path_px, double contrast, double tolerance_gray);

struct MovingImage {
    RenderedImage image;  // its plan is the last part's
    int parts = 1;
    // The fastest of 9 x 9 points of each marker in the image, at the exposure's beginning, middle
    // and end, times the exposure and 5/4. Points that are not seen do not count; 0 if none is.
    double path_px = 0.0;
};

// Half of options.tolerance_gray is for time. Takes `parts` renders. Throws NumericalError as
// render() for any part, for more than 10 000, and for an impossible velocity or exposure.
MovingImage render_moving(const Renderer& renderer, const Scene& scene,
                          const MotionDuringExposure& motion, const RenderOptions& options = {});

}  // namespace etalon
