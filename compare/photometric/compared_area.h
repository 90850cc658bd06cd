// The part of a marker on which photograph and rendering are compared: one half of its cells is for
// fitting the photometric model, the other for scoring it.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "calib/camera/projector.h"
#include "core/geometry/rigid.h"
#include "sim/marker/marker.h"

namespace etalon {

// How far outside the inner corners a chessboard is compared, in squares. Long prints are often cut
// in x.
struct ScoreMargin {
    double x = 0.3, y = 0.65;
};

// A rectangle of the marker's plane, made of cells.
struct ComparedArea {
    Eigen::Vector2d low_mm, high_mm;  // marker frame
    Eigen::Vector2d cell_mm;          // a chessboard's square, a tag's cell
    Eigen::Vector2d cell_corner_mm;   // where any four cells meet
};

// Of a chessboard: its inner corners and the margin around them. Of any other marker: all of its
// grid, a tag's white border included. Throws ConfigError (at `place`) for a margin that is not
// finite, leaves nothing, or reaches over one square, where the board ends.
ComparedArea compared_area(const Marker& marker, const ScoreMargin& margin,
                           const std::string& place);

// What a pixel's centre is used for. Blocks of 2 x 2 cells take turns, so that both halves hold
// light and dark cells all over the marker.
enum PixelUse : uchar { pixel_outside = 0, pixel_fitted = 1, pixel_scored = 2 };

// Where the pixels' rays meet the marker's plane. Between every fourth pixel in x and y (X, Y, 1) /
// depth is interpolated linearly: right to some 0.003 px. Perspective cameras. Safe from every
// thread.
class PlaneSight {
public:
    PlaneSight(const Projector& projector, const Rigid& camera_from_marker, const cv::Rect& region);

    // (X, Y) in the marker's frame and the depth z in the camera's, mm, of a pixel in the region;
    // nothing without a ray, where it meets the plane behind the camera, and edge-on.
    std::optional<Eigen::Vector3d> at(int x, int y) const;

private:
    Eigen::Vector3d exactly(int x, int y) const;  // (X, Y, 1) / depth; NaN without a ray

    static constexpr int spacing_px = 4;

    const Projector* projector_;
    cv::Rect region_;
    Eigen::Matrix3d plane_from_ray_;
    int nodes_per_row_;
    std::vector<Eigen::Vector3d> nodes_;  // row by row; empty for a plane seen edge-on
};

// CV_8UC1 of PixelUse, the camera's size. Pixels without a ray are outside, and all of a marker
// seen edge-on. 0.1 us per pixel of the marker's bounding box. Safe from every thread.
cv::Mat pixel_uses(const Projector& projector, const Rigid& camera_from_marker,
                   const ComparedArea& area);

// The pixels where the area may be seen: those of the whole image when a part of its outline has no
// image.
cv::Rect candidate_pixels(const Projector& projector, const Rigid& camera_from_marker,
                          const ComparedArea& area);

// The box with so many px more on every side, as far as an image of this size has them.
cv::Rect padded(const cv::Rect& box, int room_px, const cv::Size& image);

}  // namespace etalon
