// Grids of dark squares: the lattice of their middles says which is which; their corners are then
// refined on the image.
#include <fmt/format.h>

#include "compare/detect/board/calibration_target.h"
#include "compare/detect/board/saddle_point.h"
#include "compare/detect/board/shape_grid.h"
#include "compare/detect/detector_adaptors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

// Of a square's four corners, from the top left clockwise.
std::array<int, 4> ids_of(const Marker& board, const Eigen::Vector2i& place) {
    const int across = 2 * board.columns, first = 2 * place.y() * across + 2 * place.x();
    return {first, first + 1, first + across + 1, first + across};
}

std::optional<Eigen::Matrix3d> view_of(const Marker& board,
                                       const std::vector<Eigen::Vector2i>& places,
                                       const std::vector<std::optional<DarkShape>>& squares) {
    const double pitch = board.size_mm + board.part_mm;
    std::vector<Eigen::Vector2d> mm, px;
    for (std::size_t i = 0; i < squares.size(); ++i)
        if (squares[i]) {
            mm.push_back((places[i].cast<double>() * pitch).array() + 0.5 * board.size_mm);
            px.push_back(squares[i]->centre);
        }
    return homography(mm, px);
}

using Corners = std::array<Eigen::Vector2d, 4>;  // from the board's top left one clockwise

// The corners of the shape that was found, in the order of those `by_plane`.
Corners in_order(const DarkShape& square, const Corners& by_plane) {
    Corners corners;
    std::ranges::copy(square.corners, corners.begin());
    const auto nearest = std::ranges::min_element(
        corners, {}, [&](const Eigen::Vector2d& corner) { return (corner - by_plane[0]).norm(); });
    std::rotate(corners.begin(), nearest, corners.end());
    return corners;
}

// The shorter of a square's two heights around a corner.
double height_at(const Corners& corners, std::size_t k) {
    const Eigen::Vector2d after = corners[(k + 1) % 4] - corners[k],
                          before = corners[(k + 3) % 4] - corners[k];
    return std::abs(cross(after, before)) / std::max(after.norm(), before.norm());
}

// Of a square's shape from the one expected, as a part of its side; where it is does not matter.
double misfit(const Corners& seen, const Corners& expected) {
    const auto middle = [](const Corners& c) { return 0.25 * (c[0] + c[1] + c[2] + c[3]); };
    const Eigen::Vector2d apart = middle(seen) - middle(expected);
    double largest = 0.0;
    for (std::size_t k = 0; k < 4; ++k)
        largest =
            std::max(largest, (seen[k] - expected[k] - apart).norm() / height_at(expected, k));
    return largest;
}

// The corners of the shape that was found, or else of the others' plane. Nothing where most shapes
// are not the board's squares.
std::vector<Corners> guessed_corners(const Marker& board, const Eigen::Matrix3d& view,
                                     const std::vector<std::optional<DarkShape>>& squares,
                                     const std::vector<Eigen::Vector2i>& places) {
    constexpr double max_misfit = 0.25;
    std::vector<Corners> guesses;
    std::vector<double> misfits;
    for (std::size_t i = 0; i < squares.size(); ++i) {
        Corners by_plane;
        std::ranges::transform(ids_of(board, places[i]), by_plane.begin(), [&](int id) {
            return seen_at(view, board.points_mm[static_cast<std::size_t>(id)].head<2>());
        });
        guesses.push_back(squares[i] ? in_order(*squares[i], by_plane) : by_plane);
        if (squares[i])
            misfits.push_back(misfit(guesses.back(), by_plane));
    }
    if (!(median(std::move(misfits)) < max_misfit))
        return {};
    return guesses;
}

}  // namespace

FoundBoard find_square_corners(const Marker& board, const BoardPhoto& photo) {
    std::vector<Eigen::Vector2i> places;
    for (int i = 0; i < board.rows * board.columns; ++i)
        places.emplace_back(i % board.columns, i / board.columns);
    const auto [squares, reason] = find_shape_grid(ShapeKind::square, photo.eight_bit, places);
    const auto view = squares.empty() ? std::nullopt : view_of(board, places, squares);
    if (!view)
        return {{}, reason};
    const std::vector<Corners> guesses = guessed_corners(board, *view, squares, places);
    if (guesses.empty())
        return {{},
                fmt::format("a grid of squares is seen, but not of squares of {} mm with {} mm "
                            "between them",
                            board.size_mm, board.part_mm)};
    const double gap_share = std::min(1.0, board.part_mm / board.size_mm);
    FoundBoard found;
    for (std::size_t i = 0; i < guesses.size(); ++i)
        for (std::size_t k = 0; k < 4; ++k) {
            const Corners& at = guesses[i];
            found.add(
                ids_of(board, places[i])[k],
                refine_saddle(photo.pixels, {at[k],
                                             {at[(k + 1) % 4] - at[k], at[(k + 3) % 4] - at[k]},
                                             gap_share * height_at(at, k),
                                             true}));
        }
    return found;
}

}  // namespace etalon
