#include "compare/detect/tag_board_match.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>

namespace etalon {
namespace {

Eigen::Vector2d centre_of(const std::array<Eigen::Vector2d, 4>& corners) {
    return 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
}

// Pixels from mm by least squares; nothing when the points do not determine it.
std::optional<Eigen::Matrix3d> homography(const std::vector<cv::Point2d>& mm,
                                          const std::vector<cv::Point2d>& px) {
    const cv::Mat h = cv::findHomography(mm, px, 0);
    if (h.empty())
        return std::nullopt;
    Eigen::Matrix3d matrix;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            matrix(row, column) = h.at<double>(row, column);
    return matrix;
}

std::optional<Eigen::Matrix3d> homography_of(const std::vector<const MatchedTag*>& tags) {
    std::vector<cv::Point2d> mm, px;
    for (const MatchedTag* tag : tags)
        for (std::size_t i = 0; i < 4; ++i) {
            mm.emplace_back(tag->placed.corners_mm[i].x(), tag->placed.corners_mm[i].y());
            px.emplace_back(tag->found.corners[i].x(), tag->found.corners[i].y());
        }
    return homography(mm, px);
}

bool meets(const MatchedTag& from, const MatchedTag& other) {
    const auto map = homography_of({&from});
    if (!map)
        return false;
    const auto& corners = other.found.corners;
    const double side =
        std::min((corners[2] - corners[0]).norm(), (corners[3] - corners[1]).norm()) *
        std::sqrt(0.5);
    for (std::size_t i = 0; i < 4; ++i) {
        const Eigen::Vector3d there = *map * other.placed.corners_mm[i].homogeneous();
        if (!(there.z() * map->operator()(2, 2) > 0) ||
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
    const auto map = near.empty() ? std::nullopt : homography_of(near);
    if (!map)
        return std::nullopt;
    const Eigen::Vector3d there = *map * point_mm.homogeneous();
    LocalView view;
    view.pixel = there.hnormalized();
    view.px_per_mm =
        (map->topLeftCorner<2, 2>() - view.pixel * map->bottomLeftCorner<1, 2>()) / there.z();
    if (!view.pixel.allFinite() || !view.px_per_mm.allFinite())
        return std::nullopt;
    return view;
}

}  // namespace etalon
