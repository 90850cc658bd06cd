// Which pattern a photograph shows where a marker should be: the marker's own, its negative, the
// marker turned or mirrored, another id of its family, or none. By the levels of its cells, which
// blur, noise and a pose that is a third of a cell wrong leave as they are.
//
// A pattern is fitted to the cells' mean gray values beside smooth light (a surface of second
// order); what it explains of the variance that smooth light leaves is its score, 1 for the right
// pattern in an ideal photograph. A pattern of random cells explains 1/n of n cells on average, and
// the best of 5000 in 64 cells about a quarter.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "calib/camera/projector.h"
#include "compare/photometric/compared_area.h"
#include "core/geometry/rigid.h"
#include "sim/marker/marker.h"

namespace etalon {

struct PatternScore {
    double explained = 0.0;      // 0 .. 1
    double contrast_gray = 0.0;  // of white over black; below 0: light and dark are exchanged
};

struct ShownPattern {
    double visible = 0.0;         // share of the compared area that is inside the image
    double cell_px = 0.0;         // side of a square with the mean area of a cell in the image
    double white_gray = 0.0;      // mean of the expected pattern's light cells
    double clipped_white = 0.0;   // share of their samples at the end of the scale
    PatternScore expected, best;  // the best is the expected one unless another explains more
    int quarter_turns = 0;        // of the best, clockwise
    bool mirrored = false;        // of the best, before it is turned
    int id = 0;                   // of the best; only tags
    // Cells on the other side of the middle between light and dark than the expected pattern's.
    int flipped_to_light = 0, flipped_to_dark = 0;
    bool is_another() const;  // best is not expected, or its negative
};

// `saturation_gray`: from where on samples count as clipped. Ids are searched, in families of up to
// 5000, only where the marker itself in any position explains little. Throws NumericalError when
// the photograph is not CV_32FC1 of the camera's size. `marker` must have light and dark cells in
// the area. Safe from every thread.
ShownPattern shown_pattern(const cv::Mat& photo_gray, double saturation_gray,
                           const Projector& projector, const Marker& marker,
                           const ComparedArea& area, const Rigid& camera_from_marker);

// A single square tag, which has an id, and not a board.
bool is_tag(const Marker& marker);

}  // namespace etalon
