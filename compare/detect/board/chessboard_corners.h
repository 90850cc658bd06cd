// Inner corners of a chessboard in a photograph, to sub-pixel, in the order of sim/marker/marker.h.
//
// Found by OpenCV's quad-linking finder, refined by compare/detect/board/saddle_point.h. The
// refinement window decides the accuracy: one that reaches the neighbouring corners pulls a corner
// towards them. It is chosen for each corner from the size of the squares around it.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "core/image/image.h"

namespace etalon {

struct ChessboardCorners {
    std::vector<Eigen::Vector2d> pixels;  // row by row as Marker::points_mm, columns * rows
    // Of each corner: whether it was refined. Where dirt, glare or the image's border is in the way
    // it stays where the finder put it, to half a pixel or worse.
    std::vector<bool> refined;
    // The squares are black where a board of these columns and rows has white ones: it is the board
    // of `rows` columns and `columns` rows that lies on its side.
    bool lies_on_its_side = false;
    double smallest_spacing_px = 0.0;   // between neighbouring corners
    int refinement_half_window_px = 0;  // of the smallest window, whole pixels
};

// Nothing when the whole board is not seen. columns and rows count inner corners, at least 3 each
// way (ConfigError otherwise). The order is right-handed as seen from the front; a board turned by
// 180 degrees in the image looks the same in outline:
//  - columns + rows odd: the colours tell, and the first inner corner is the one between two black
//    squares as in sim/marker/marker.h (black at the top left);
//  - even: nothing tells; the order is OpenCV's (the first corner towards the image's top left for
//    a board that is roughly upright), but for square boards, of which a quarter turn tells.
// Safe from every thread. Some 50 ms for a 640x480 photo, up to a second where there is no board
// (half a minute in pure noise).
std::optional<ChessboardCorners> find_chessboard_corners(const CodeImage& image, int columns,
                                                         int rows);

}  // namespace etalon
