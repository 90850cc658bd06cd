// Grids of dark squares: the lattice of their middles says which is which; their corners are then
// refined on the image.
#include <algorithm>
#include <array>

#include "compare/detect/board_points.h"
#include "compare/detect/point_lattice.h"
#include "compare/detect/saddle_point.h"
#include "compare/detect/seen_plane.h"

namespace etalon {
namespace {

std::vector<Eigen::Vector2i> places_of(const Marker& board) {
    std::vector<Eigen::Vector2i> places;
    for (int row = 0; row < board.rows; ++row)
        for (int column = 0; column < board.columns; ++column)
            places.emplace_back(column, row);
    return places;
}

// Of a square's four corners, from the top left clockwise.
std::array<int, 4> ids_of(const Marker& board, const Eigen::Vector2i& place) {
    const int across = 2 * board.columns, first = 2 * place.y() * across + 2 * place.x();
    return {first, first + 1, first + across + 1, first + across};
}

std::optional<SeenPlane> view_of(const Marker& board, const std::vector<Eigen::Vector2i>& places,
                                 const std::vector<std::optional<DarkShape>>& squares) {
    const double pitch = board.size_mm + board.part_mm;
    std::vector<Eigen::Vector2d> mm, px;
    for (std::size_t i = 0; i < squares.size(); ++i)
        if (squares[i]) {
            mm.push_back((places[i].cast<double>() * pitch).array() + 0.5 * board.size_mm);
            px.push_back(squares[i]->centre);
        }
    return SeenPlane::through(mm, px);
}

// The square's corners from the board's top left one on.
std::array<Eigen::Vector2d, 4> in_order(const DarkShape& square, const Eigen::Vector2d& first) {
    std::array<Eigen::Vector2d, 4> corners;
    std::ranges::copy(square.corners, corners.begin());
    const auto nearest = std::ranges::min_element(
        corners, {}, [&](const Eigen::Vector2d& corner) { return (corner - first).norm(); });
    std::ranges::rotate(corners, nearest);
    return corners;
}

}  // namespace

FoundBoard find_square_corners(const Marker& board, const BoardPhoto& photo) {
    const std::vector<Eigen::Vector2i> places = places_of(board);
    const auto [squares, reason] = find_board_of(find_dark_squares, photo.eight_bit, places);
    const auto view = squares.empty() ? std::nullopt : view_of(board, places, squares);
    if (!view)
        return {{}, reason};
    const double gap_share = std::min(1.0, board.part_mm / board.size_mm);
    FoundBoard found;
    for (std::size_t i = 0; i < squares.size(); ++i) {
        if (!squares[i])
            continue;
        const std::array<int, 4> ids = ids_of(board, places[i]);
        const auto corners = in_order(*squares[i], view->at(board.points_mm[ids[0]].head<2>()));
        for (std::size_t k = 0; k < 4; ++k) {
            const Eigen::Vector2d after = corners[(k + 1) % 4] - corners[k],
                                  before = corners[(k + 3) % 4] - corners[k];
            const double side = std::abs(after.x() * before.y() - after.y() * before.x()) /
                                std::max(after.norm(), before.norm());
            if (const auto pixel = refine_saddle(
                    photo.pixels, {corners[k], {after, before}, gap_share * side, true}))
                found.points.push_back({ids[k], *pixel});
        }
    }
    std::ranges::sort(found.points, {}, &BoardPoint::id);
    return found;
}

}  // namespace etalon
