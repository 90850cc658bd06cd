// Where two straight edges between dark and bright squares cross, to a few thousandths of a pixel:
// an inner corner of a chessboard, a ChArUco board, or a grid of tags with black squares between;
// or where they end in each other, a corner of a dark square on its own.
//
// The pixels around are fitted with the product of two blurred steps, (1 + d . x) (b + a g(u1)
// g(u2)): centre, the edges' directions, blur, the pattern's mean b and contrast a, the light's
// gradient d. No symmetric blur and no tone curve moves the centre. Error 0.01 px on sharp images,
// 0.002 px with the blur of a lens (docs/calibration.md, "Targets").
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>

namespace etalon {

// Where to look. The quadrant between the two directions is a dark one.
struct SaddleGuess {
    Eigen::Vector2d pixel;
    Eigen::Vector2d edges[2];  // directions of the edges from the centre, any length
    double room_px = 0.0;      // to the nearest other edge
    // Only that quadrant is dark, and a = 1/2 of its contrast multiplies (1 + g(u1)) (1 + g(u2)) /
    // 2 instead. A tone curve moves such a corner, outwards or inwards, as it does the edges.
    bool is_lone = false;
};

// `pixels`: CV_32FC1, full scale 1. Nothing for room below 2.5 px or beyond the image's border,
// contrast below 0.02, dark and bright exchanged, a misfit above a quarter of the contrast, or a
// fit that leaves the guess by more than half the room or turns an edge by more than 30 degrees.
// Safe from every thread; some 0.3 ms.
std::optional<Eigen::Vector2d> refine_saddle(const cv::Mat& pixels, const SaddleGuess& guess);

// The window's radius for that much room: 5.5 px or, on large squares, more; 0: too little room.
double saddle_window_px(double room_px);

}  // namespace etalon
