// Kalibr's aprilgrid: every corner of a tag touches a black square in the crossing of the gaps, so
// that it is a crossing of two edges and refined as one.
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "compare/detect/apriltag/apriltag_finder.h"
#include "compare/detect/board/board_points.h"
#include "compare/detect/board/saddle_point.h"
#include "compare/detect/board/tag_board_match.h"

namespace etalon {
namespace {

constexpr int border_cells = 2;

std::vector<MatchedTag> read_tags(const Marker& board, const cv::Mat& image) {
    const auto layout = aprilgrid_tags(board.columns, board.rows, board.size_mm, board.part_mm);
    ApriltagFinder finder(board.family, border_cells);
    std::vector<FoundTag> found;
    std::vector<bool> known(layout.size(), false);
    for (const int shrink_px : {1, 2, 0}) {
        cv::Mat brightened;  // of its own: the photograph stays as it is
        cv::dilate(image, brightened, cv::Mat(), {-1, -1}, shrink_px);
        std::vector<FoundTag> more;
        for (const FoundTag& tag : finder.find(brightened))
            if (tag.id < static_cast<int>(known.size()) && !known[tag.id])
                more.push_back(tag);
        for (const FoundTag& tag : more)
            known[tag.id] = true;
        found.insert(found.end(), more.begin(), more.end());
    }
    return match_tags(layout, found);
}

// The tag is on the side of the corner where the quadrant is black.
SaddleGuess guess_of(const LocalView& view, bool is_left, bool is_upper, double room_mm) {
    const Eigen::Vector2d along = view.px_per_mm.col(0), down = view.px_per_mm.col(1);
    return {view.pixel,
            {is_left ? along : Eigen::Vector2d(-along), is_upper ? down : Eigen::Vector2d(-down)},
            room_mm * view.least_px_per_mm()};
}

}  // namespace

FoundBoard find_tag_grid_corners(const Marker& board, const BoardPhoto& photo) {
    const double tag = board.size_mm, gap = board.part_mm, pitch = tag + gap;
    const std::vector<MatchedTag> tags = read_tags(board, photo.eight_bit);
    // A tag's data begin behind its border, across the corner; the small square ends after a gap.
    const double border_mm = border_cells * board.detail_mm;
    const double room_mm = std::min(gap, std::sqrt(2.0) * border_mm);
    std::vector<BoardPoint> points;
    for (const MatchedTag& matched : tags) {
        const Eigen::Vector2d centre_mm =
            0.5 * (matched.placed.corners_mm[0] + matched.placed.corners_mm[2]);
        const int row = static_cast<int>(std::floor(centre_mm.y() / pitch)),
                  column = static_cast<int>(std::floor(centre_mm.x() / pitch));
        for (const int lower : {0, 1})
            for (const int right : {0, 1}) {
                const int id = (2 * row + lower) * 2 * board.columns + 2 * column + right;
                const auto view = local_view(tags, board.points_mm[id].head<2>(), 1.3 * pitch);
                if (!view)
                    continue;
                const SaddleGuess guess = guess_of(*view, right == 0, lower == 0, room_mm);
                if (const auto pixel = refine_saddle(photo.pixels, guess))
                    points.push_back({id, *pixel});
            }
    }
    std::sort(points.begin(), points.end(),
              [](const BoardPoint& a, const BoardPoint& b) { return a.id < b.id; });
    return {std::move(points)};
}

}  // namespace etalon
