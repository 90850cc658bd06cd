// Boards of tags, ChArUco and AprilTag grids: the tags tell which point is which and where about;
// the points are then refined on the image. OpenCV's interpolation of ChArUco corners differs
// between versions, and refines in a window that may hold a marker.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <opencv2/imgproc.hpp>

#include "compare/detect/board/calibration_target.h"
#include "compare/detect/board/saddle_point.h"
#include "compare/detect/detector_adaptors.h"
#include "core/file/text.h"
#include "sim/marker/board_pattern.h"

namespace etalon {
namespace {

// A tag of the board and where it is seen.
struct MatchedTag {
    BoardTag placed;
    DetectedCorners found;
};

Eigen::Vector2d centre_of(const auto& corners) {
    return 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
}

// Px from mm around these tags.
std::optional<Eigen::Matrix3d> view_of(const std::vector<const MatchedTag*>& tags) {
    std::vector<Eigen::Vector2d> mm, px;
    for (const MatchedTag* tag : tags) {
        mm.insert(mm.end(), tag->placed.corners_mm.begin(), tag->placed.corners_mm.end());
        px.insert(px.end(), tag->found.pixels.begin(), tag->found.pixels.end());
    }
    return homography(mm, px);
}

bool meets(const MatchedTag& from, const MatchedTag& other) {
    const auto view = view_of({&from});
    if (!view)
        return false;
    const std::vector<Eigen::Vector2d>& corners = other.found.pixels;
    const double side =
        std::min((corners[2] - corners[0]).norm(), (corners[3] - corners[1]).norm()) *
        std::sqrt(0.5);
    for (std::size_t i = 0; i < 4; ++i) {
        const Eigen::Vector3d there = *view * other.placed.corners_mm[i].homogeneous();
        if (!(there.z() * (*view)(2, 2) > 0) ||
            !((there.hnormalized() - corners[i]).norm() < 0.5 * side))
            return false;
    }
    return true;
}

// Neighbours on the board: no farther than two tags' diagonals plus what lies between on common
// boards.
bool agree(const MatchedTag& a, const MatchedTag& b) {
    const auto &one = a.placed.corners_mm, &other = b.placed.corners_mm;
    const double diagonal = (one[2] - one[0]).norm();
    return (centre_of(one) - centre_of(other)).norm() < 2.2 * diagonal && meets(a, b) &&
           meets(b, a);
}

// The largest set of tags that agree with their neighbours: each one's four corners, continued to
// the other's place on the board, must meet it to within half its side. No map holds for the whole
// board, because of distortion. Fewer than two tags are no board. An id seen twice is left out.
std::vector<MatchedTag> match_tags(const std::vector<BoardTag>& board,
                                   const std::vector<DetectedCorners>& found) {
    std::vector<MatchedTag> tags;
    for (const BoardTag& placed : board)
        if (std::ranges::count(found, placed.id, &DetectedCorners::id) == 1)
            tags.push_back({placed, *std::ranges::find(found, placed.id, &DetectedCorners::id)});
    std::vector<int> group(tags.size(), -1);  // connected by agreement
    std::vector<int> sizes;
    for (std::size_t seed = 0; seed < tags.size(); ++seed) {
        if (group[seed] >= 0)
            continue;
        std::vector<std::size_t> open{seed};
        group[seed] = static_cast<int>(sizes.size());
        sizes.push_back(0);
        while (!open.empty()) {
            const std::size_t here = open.back();
            open.pop_back();
            ++sizes.back();
            for (std::size_t i = 0; i < tags.size(); ++i)
                if (group[i] < 0 && agree(tags[here], tags[i])) {
                    group[i] = group[seed];
                    open.push_back(i);
                }
        }
    }
    const auto largest = std::ranges::max_element(sizes);
    if (largest == sizes.end() || *largest < 2)
        return {};
    std::vector<MatchedTag> matched;
    for (std::size_t i = 0; i < tags.size(); ++i)
        if (group[i] == largest - sizes.begin())
            matched.push_back(tags[i]);
    return matched;
}

// How the board's plane is seen around a point of it.
struct LocalView {
    Eigen::Vector2d pixel;
    Eigen::Matrix2d px_per_mm;  // derivative

    // A dark quadrant to the right and below, or flipped; `room_mm` to the next edge.
    SaddleGuess guess(bool flip_x, bool flip_y, double room_mm) const {
        const Eigen::Vector2d along = px_per_mm.col(0), down = px_per_mm.col(1);
        return {pixel,
                {flip_x ? Eigen::Vector2d(-along) : along, flip_y ? Eigen::Vector2d(-down) : down},
                room_mm * px_per_mm.jacobiSvd().singularValues()[1]};
    }
};

// From the corners of the matched tags within `reach_mm`; nothing without them.
std::optional<LocalView> local_view(const std::vector<MatchedTag>& tags,
                                    const Eigen::Vector2d& point_mm, double reach_mm) {
    std::vector<const MatchedTag*> near;
    for (const MatchedTag& tag : tags)
        if ((centre_of(tag.placed.corners_mm) - point_mm).norm() < reach_mm)
            near.push_back(&tag);
    const auto plane = near.empty() ? std::nullopt : view_of(near);
    if (!plane)
        return std::nullopt;
    const LocalView view{seen_at(*plane, point_mm), jacobian_at(*plane, point_mm)};
    if (!view.pixel.allFinite() || !view.px_per_mm.allFinite())
        return std::nullopt;
    return view;
}

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
                   const std::vector<DetectedCorners>& found) {
    return {layout, match_tags(charuco_tags(board.columns, board.rows, board.size_mm, board.part_mm,
                                            layout),
                               found)};
}

// The layout of most of the tags, the named one in doubt. An odd number of rows has only one.
SeenLayout best_layout(const Marker& board, int first_id,
                       const std::vector<DetectedCorners>& found) {
    SeenLayout named = seen_in(board, {first_id, board.white_corner}, found);
    if (board.rows % 2 == 1)
        return named;
    SeenLayout other = seen_in(board, {first_id, !board.white_corner}, found);
    return other.tags.size() > named.tags.size() ? other : named;
}

std::vector<DetectedCorners> with_ids_from(int first_id, const Marker& board,
                                           std::vector<DetectedCorners> found) {
    const int last_id = first_id + board.columns * board.rows / 2 - 1;
    std::erase_if(
        found, [&](const DetectedCorners& tag) { return tag.id < first_id || tag.id > last_id; });
    return found;
}

// Tags of another board agree here and there, too: a row of them may be a row shifted by a square.
bool is_the_board(const SeenLayout& seen, std::size_t tags_of_board) {
    return !seen.tags.empty() && 3 * seen.tags.size() > 2 * tags_of_board;
}

// Why tags that were found are not the board.
std::string why_not(const Marker& board, const std::vector<DetectedCorners>& found) {
    if (found.empty())
        return "no marker of " + board.family + " is seen";
    const auto [first, last] = std::ranges::minmax(found, {}, &DetectedCorners::id);
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

void add_corners_beside(const SeenLayout& seen, const Marker& board, const cv::Mat& pixels,
                        FoundBoard& found) {
    const double square = board.size_mm;
    // The nearest other edge is the corner of a marker in a white square.
    const double room_mm = std::sqrt(0.5) * (square - board.part_mm);
    constexpr double beside = 0.75, around = 1.6;  // squares from a corner to a marker's centre
    for (std::size_t i = 0; i < board.points_mm.size(); ++i) {
        const Eigen::Vector2d point_mm = board.points_mm[i].head<2>();
        if (!local_view(seen.tags, point_mm, beside * square))
            continue;
        const auto view = local_view(seen.tags, point_mm, around * square);
        const int id = static_cast<int>(i), inner = board.columns - 1;
        // Squares at the upper left and lower right: black where row and column add to an even
        // number.
        const bool is_even = (id / inner + id % inner) % 2 == 0;
        if (view)
            found.add(
                id, refine_saddle(
                        pixels, view->guess(false, is_even == seen.layout.white_corner, room_mm)));
    }
}

// Kalibr's aprilgrid: every corner of a tag touches a black square in the crossing of the gaps, so
// that it is a crossing of two edges and refined as one.

constexpr int border_cells = 2;

std::vector<MatchedTag> read_tags(const Marker& board, const cv::Mat& image) {
    const auto layout = aprilgrid_tags(board.columns, board.rows, board.size_mm, board.part_mm);
    ApriltagFinder finder(board.family, border_cells);
    std::vector<DetectedCorners> found;
    std::vector<bool> known(layout.size(), false);
    for (const int shrink_px : {1, 2, 0}) {
        cv::Mat brightened;  // of its own: the photograph stays as it is
        cv::dilate(image, brightened, cv::Mat(), {-1, -1}, shrink_px);
        const std::vector<bool> before = known;
        for (const DetectedCorners& tag : finder.find(brightened))
            if (tag.id < static_cast<int>(known.size()) && !before[tag.id]) {
                known[tag.id] = true;
                found.push_back(tag);
            }
    }
    return match_tags(layout, found);
}

}  // namespace

FoundBoard find_charuco_corners(const Marker& board, const BoardPhoto& photo) {
    const auto tags = find_aruco_tags(photo.eight_bit, board.family, ArucoRefinement::none);
    const auto of_board = with_ids_from(board.id, board, tags);
    const SeenLayout seen = best_layout(board, board.id, of_board);
    FoundBoard found;
    if (!is_the_board(seen, of_board.size())) {
        found.reason = why_not(board, tags);
        return found;
    }
    add_corners_beside(seen, board, photo.pixels, found);
    if (seen.layout.white_corner != board.white_corner)
        found.shown_as = name_of(board, seen.layout);
    return found;
}

FoundBoard find_tag_grid_corners(const Marker& board, const BoardPhoto& photo) {
    const double tag = board.size_mm, gap = board.part_mm, pitch = tag + gap;
    const std::vector<MatchedTag> tags = read_tags(board, photo.eight_bit);
    // A tag's data begin behind its border, across the corner; the small square ends after a gap.
    const double border_mm = border_cells * board.detail_mm;
    const double room_mm = std::min(gap, std::sqrt(2.0) * border_mm);
    FoundBoard found;
    for (const MatchedTag& matched : tags) {
        const Eigen::Vector2d centre_mm =
            0.5 * (matched.placed.corners_mm[0] + matched.placed.corners_mm[2]);
        const int row = static_cast<int>(std::floor(centre_mm.y() / pitch)),
                  column = static_cast<int>(std::floor(centre_mm.x() / pitch));
        for (const int lower : {0, 1})
            for (const int right : {0, 1}) {
                const int id = (2 * row + lower) * 2 * board.columns + 2 * column + right;
                const auto view = local_view(tags, board.points_mm[id].head<2>(), 1.3 * pitch);
                // The tag is on the side of the corner where the quadrant is black.
                if (view)
                    found.add(id, refine_saddle(photo.pixels,
                                                view->guess(right == 1, lower == 1, room_mm)));
            }
    }
    return found;
}

}  // namespace etalon
