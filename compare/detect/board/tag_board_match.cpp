#include "compare/detect/board/tag_board_match.h"

#include <opencv2/imgproc.hpp>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "compare/detect/apriltag/apriltag_finder.h"
#include "compare/detect/board/calibration_target.h"
#include "compare/detect/board/point_lattice.h"
#include "compare/detect/board/saddle_point.h"

namespace etalon {
namespace {

Eigen::Vector2d centre_of(const std::array<Eigen::Vector2d, 4>& corners) {
    return 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
}

std::optional<SeenPlane> view_of(const std::vector<const MatchedTag*>& tags) {
    std::vector<Eigen::Vector2d> mm, px;
    for (const MatchedTag* tag : tags) {
        mm.insert(mm.end(), tag->placed.corners_mm.begin(), tag->placed.corners_mm.end());
        px.insert(px.end(), tag->found.corners.begin(), tag->found.corners.end());
    }
    return SeenPlane::through(mm, px);
}

bool meets(const MatchedTag& from, const MatchedTag& other) {
    const auto view = view_of({&from});
    if (!view)
        return false;
    const auto& corners = other.found.corners;
    const double side =
        std::min((corners[2] - corners[0]).norm(), (corners[3] - corners[1]).norm()) *
        std::sqrt(0.5);
    for (std::size_t i = 0; i < 4; ++i) {
        const Eigen::Vector3d there =
            view->pixel_from_mm * other.placed.corners_mm[i].homogeneous();
        if (!(there.z() * view->pixel_from_mm(2, 2) > 0) ||
            !((there.hnormalized() - corners[i]).norm() < 0.5 * side))
            return false;
    }
    return true;
}

// Neighbours on the board: no farther than two tags' diagonals plus what lies between on common
// boards.
bool are_near(const BoardTag& a, const BoardTag& b) {
    const double diagonal = (a.corners_mm[2] - a.corners_mm[0]).norm();
    return (centre_of(a.corners_mm) - centre_of(b.corners_mm)).norm() < 2.2 * diagonal;
}

std::vector<MatchedTag> seen_once(const std::vector<BoardTag>& board,
                                  const std::vector<FoundTag>& found) {
    std::map<int, std::vector<const FoundTag*>> by_id;
    for (const FoundTag& tag : found)
        by_id[tag.id].push_back(&tag);
    std::vector<MatchedTag> tags;
    for (const BoardTag& placed : board) {
        const auto seen = by_id.find(placed.id);
        if (seen != by_id.end() && seen->second.size() == 1)
            tags.push_back({placed, *seen->second.front()});
    }
    return tags;
}

}  // namespace

std::vector<MatchedTag> match_tags(const std::vector<BoardTag>& board,
                                   const std::vector<FoundTag>& found) {
    const std::vector<MatchedTag> tags = seen_once(board, found);
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
                if (group[i] < 0 && are_near(tags[here].placed, tags[i].placed) &&
                    meets(tags[here], tags[i]) && meets(tags[i], tags[here])) {
                    group[i] = group[seed];
                    open.push_back(i);
                }
        }
    }
    const auto largest = std::max_element(sizes.begin(), sizes.end());
    if (largest == sizes.end() || *largest < 2)
        return {};
    std::vector<MatchedTag> matched;
    for (std::size_t i = 0; i < tags.size(); ++i)
        if (group[i] == largest - sizes.begin())
            matched.push_back(tags[i]);
    return matched;
}

double LocalView::least_px_per_mm() const {
    return px_per_mm.jacobiSvd().singularValues()[1];
}

std::optional<LocalView> local_view(const std::vector<MatchedTag>& tags,
                                    const Eigen::Vector2d& point_mm, double reach_mm) {
    std::vector<const MatchedTag*> near;
    for (const MatchedTag& tag : tags)
        if ((centre_of(tag.placed.corners_mm) - point_mm).norm() < reach_mm)
            near.push_back(&tag);
    const auto plane = near.empty() ? std::nullopt : view_of(near);
    if (!plane)
        return std::nullopt;
    const LocalView view{plane->at(point_mm), plane->px_per_mm(point_mm)};
    if (!view.pixel.allFinite() || !view.px_per_mm.allFinite())
        return std::nullopt;
    return view;
}

// Kalibr's aprilgrid: every corner of a tag touches a black square in the crossing of the gaps, so
// that it is a crossing of two edges and refined as one.

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
