// Inner corners of a chessboard in a photograph, in the order of sim/marker/marker.h: found by
// OpenCV's quad-linking finder, refined to sub-pixel by compare/detect/board/saddle_point.h.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "core/image/image.h"

namespace etalon {

struct ChessboardCorners {
    std::vector<Eigen::Vector2d> pixels;  // row by row as Marker::points_mm, columns * rows
    std::vector<bool> refined;  // of each corner; else it is where the finder put it, to 0.5 px
    // Black and white are exchanged: it is the board of `rows` columns and `columns` rows.
    bool lies_on_its_side = false;
};

// Nothing when the whole board is not seen. columns and rows count inner corners, at least 3 each
// way (ConfigError otherwise). The order is right-handed as seen from the front. Of the two that a
// half turn leaves:
//  - columns + rows odd: the colours tell (black at the top left as in sim/marker/marker.h);
//  - even: OpenCV's (the first corner towards the image's top left for a board that is roughly
//    upright); of square boards the colours give the quarter turn.
// Safe from every thread. Some 50 ms for a 640x480 photo, up to a second where there is no board
// (half a minute in pure noise).
std::optional<ChessboardCorners> find_chessboard_corners(const CodeImage& image, int columns,
                                                         int rows);

}  // namespace etalon
