// Which of the tags found in a photograph are those of a board, and where the board's points are by
// them, to start refining from. Shared by ChArUco boards and grids of tags.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "compare/detect/detector_adaptors.h"
#include "sim/marker/board_pattern.h"

namespace etalon {

// A tag of the board and where it is seen.
struct MatchedTag {
    BoardTag placed;
    FoundTag found;
};

// The largest set of tags that agree with their neighbours: each one's four corners, continued to
// the other's place on the board, must meet it there to within half its side. No single map is
// asked to hold for the whole board, so that strong distortion does no harm. Tags of a board with
// another layout, of other things in the picture and misread ones do not agree; fewer than two tags
// are no board. An id seen twice is left out.
std::vector<MatchedTag> match_tags(const std::vector<BoardTag>& board,
                                   const std::vector<FoundTag>& found);

// How the board's plane is seen around a point of it.
struct LocalView {
    Eigen::Vector2d pixel;
    Eigen::Matrix2d px_per_mm;  // derivative

    // Of mm in the direction that is seen shortest.
    double least_px_per_mm() const;
};

// From the corners of the matched tags whose centres are within `reach_mm` of the point, by a
// homography; nothing without one.
std::optional<LocalView> local_view(const std::vector<MatchedTag>& tags,
                                    const Eigen::Vector2d& point_mm, double reach_mm);

}  // namespace etalon
