// ChArUco: markers tell which corner is which and where about; the corners are then refined on the
// image like any chessboard's. OpenCV's own interpolation is not used: it differs between versions,
// and refines in a window that may hold a marker.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compare/detect/board/calibration_target.h"
#include "compare/detect/board/saddle_point.h"
#include "compare/detect/board/tag_board_match.h"
#include "core/file/text.h"

namespace etalon {
namespace {

std::string name_of(const Marker& board, const CharucoLayout& layout) {
    const std::string first = layout.first_id > 0 ? fmt::format(":{}", layout.first_id) : "";
    return fmt::format(
        "{}:{}:{}x{}{}@{}mm/{}mm", layout.white_corner ? "charuco-legacy" : "charuco", board.family,
        board.columns, board.rows, first, exact(board.size_mm), exact(board.part_mm));
}

// A board drawn in one of its layouts, as far as it is seen.
struct SeenLayout {
    CharucoLayout layout;
    std::vector<MatchedTag> tags;
};

SeenLayout seen_in(const Marker& board, const CharucoLayout& layout,
                   const std::vector<FoundTag>& found) {
    return {layout, match_tags(charuco_tags(board.columns, board.rows, board.size_mm, board.part_mm,
                                            layout),
                               found)};
}

// The layout with which most of the tags agree; the named one where both do as well, as when a
// single row of tags is seen. With an odd number of rows there is only one.
SeenLayout best_layout(const Marker& board, int first_id, const std::vector<FoundTag>& found) {
    SeenLayout named = seen_in(board, {first_id, board.white_corner}, found);
    if (board.rows % 2 == 1)
        return named;
    SeenLayout other = seen_in(board, {first_id, !board.white_corner}, found);
    return other.tags.size() > named.tags.size() ? other : named;
}

std::vector<FoundTag> with_ids_from(int first_id, const Marker& board,
                                    const std::vector<FoundTag>& found) {
    const int last_id = first_id + board.columns * board.rows / 2 - 1;
    std::vector<FoundTag> of_board;
    std::ranges::copy_if(found, std::back_inserter(of_board), [&](const FoundTag& tag) {
        return tag.id >= first_id && tag.id <= last_id;
    });
    return of_board;
}

// Tags of another board agree here and there, too: a row of them may be a row shifted by a square.
bool is_the_board(const SeenLayout& seen, std::size_t tags_of_board) {
    return !seen.tags.empty() && 3 * seen.tags.size() > 2 * tags_of_board;
}

// Why tags that were found are not the board.
std::string why_not(const Marker& board, const std::vector<FoundTag>& found) {
    if (found.empty())
        return "no marker of " + board.family + " is seen";
    const auto [first, last] = std::ranges::minmax(found, {}, &FoundTag::id);
    if (first.id != board.id) {
        const auto of_board = with_ids_from(first.id, board, found);
        const SeenLayout seen = best_layout(board, first.id, of_board);
        if (is_the_board(seen, found.size()))
            return "the board that is seen is " + name_of(board, seen.layout);
    }
    return fmt::format(
        "{} markers of {} are seen, ids {} to {}, but not where {}x{} squares in "
        "either of the layouts would have them",
        found.size(), board.family, first.id, last.id, board.columns, board.rows);
}

// Between the squares of the corner's upper left and lower right, which are black where its row and
// column add to an even number, or white.
SaddleGuess guess_of(const LocalView& view, bool lower_right_is_black, double room_mm) {
    const Eigen::Vector2d along = view.px_per_mm.col(0), down = view.px_per_mm.col(1);
    return {view.pixel,
            {along, lower_right_is_black ? down : Eigen::Vector2d(-down)},
            room_mm * view.least_px_per_mm()};
}

std::vector<BoardPoint> corners_beside(const SeenLayout& seen, const Marker& board,
                                       const cv::Mat& pixels) {
    const double square = board.size_mm;
    // The nearest other edge is the corner of a marker in a white square.
    const double room_mm = std::sqrt(0.5) * (square - board.part_mm);
    constexpr double beside = 0.75, around = 1.6;  // squares from a corner to a marker's centre
    std::vector<BoardPoint> points;
    for (std::size_t i = 0; i < board.points_mm.size(); ++i) {
        const Eigen::Vector2d point_mm = board.points_mm[i].head<2>();
        if (!local_view(seen.tags, point_mm, beside * square))
            continue;
        const auto view = local_view(seen.tags, point_mm, around * square);
        const int id = static_cast<int>(i), inner = board.columns - 1;
        const bool is_even = (id / inner + id % inner) % 2 == 0;
        if (!view)
            continue;
        if (const auto pixel = refine_saddle(
                pixels, guess_of(*view, is_even != seen.layout.white_corner, room_mm)))
            points.push_back({id, *pixel});
    }
    return points;
}

}  // namespace

FoundBoard find_charuco_corners(const Marker& board, const BoardPhoto& photo) {
    const auto found = find_aruco_tags(photo.eight_bit, board.family, ArucoRefinement::none);
    const auto of_board = with_ids_from(board.id, board, found);
    const SeenLayout seen = best_layout(board, board.id, of_board);
    if (!is_the_board(seen, of_board.size()))
        return {{}, why_not(board, found)};
    const bool is_as_named = seen.layout.white_corner == board.white_corner;
    return {corners_beside(seen, board, photo.pixels),
            {},
            is_as_named ? std::string() : name_of(board, seen.layout)};
}

}  // namespace etalon
