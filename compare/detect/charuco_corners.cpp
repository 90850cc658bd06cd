// ChArUco: markers tell which corner is which and where about; the corners are then refined on the
// image like any chessboard's. OpenCV's own interpolation is not used: it differs between versions,
// and refines in a window that may hold a marker.
#include <cmath>

#include "compare/detect/board_points.h"
#include "compare/detect/saddle_point.h"
#include "compare/detect/tag_board_match.h"

namespace etalon {
namespace {

// Between the squares of the corner's upper left and lower right, which are black where its row and
// column add to an even number.
SaddleGuess guess_of(const LocalView& view, bool lower_right_is_black, double room_mm) {
    const Eigen::Vector2d along = view.px_per_mm.col(0), down = view.px_per_mm.col(1);
    return {view.pixel,
            {along, lower_right_is_black ? down : Eigen::Vector2d(-down)},
            room_mm * view.least_px_per_mm()};
}

}  // namespace

std::vector<BoardPoint> find_charuco_corners(const Marker& board, const BoardPhoto& photo) {
    const double square = board.size_mm, marker = board.part_mm;
    const auto tags =
        match_tags(charuco_tags(board.columns, board.rows, square, marker),
                   find_aruco_tags(photo.eight_bit, board.family, ArucoRefinement::none));
    // The nearest other edge is the corner of a marker in a white square.
    const double room_mm = std::sqrt(0.5) * (square - marker);
    constexpr double beside = 0.75, around = 1.6;  // squares from a corner to a marker's centre
    std::vector<BoardPoint> points;
    for (std::size_t i = 0; i < board.points_mm.size(); ++i) {
        const Eigen::Vector2d point_mm = board.points_mm[i].head<2>();
        if (!local_view(tags, point_mm, beside * square))
            continue;
        const auto view = local_view(tags, point_mm, around * square);
        const int id = static_cast<int>(i), inner = board.columns - 1;
        const bool is_even = (id / inner + id % inner) % 2 == 0;
        if (!view)
            continue;
        if (const auto pixel = refine_saddle(photo.pixels, guess_of(*view, is_even, room_mm)))
            points.push_back({id, *pixel});
    }
    return points;
}

}  // namespace etalon
