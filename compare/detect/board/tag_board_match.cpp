#include "compare/detect/board/tag_board_match.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "compare/detect/board/seen_plane.h"

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

}  // namespace etalon
