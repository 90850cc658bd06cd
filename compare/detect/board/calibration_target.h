// Targets that a camera is calibrated with, the boards of sim/marker/marker.h, and their points in
// photographs, to sub-pixel (docs/conventions.md), each with its index on the target. How far off
// the points are, by kind: docs/calibration.md, "Targets".
#pragma once

#include <opencv2/core.hpp>

#include <map>
#include <optional>

#include "calib/camera/camera_model.h"
#include "calib/intrinsics/calibration_view.h"
#include "core/geometry/rigid.h"
#include "sim/marker/marker.h"

namespace etalon {

struct CalibrationTarget {
    Marker board;
};

// Throws ConfigError at `place` for what sim/marker/marker.h cannot parse, a marker that is no
// board, and boards with less than 3x3 inner corners, circles or squares of ChArUco, or 2x2 tags.
CalibrationTarget parse_calibration_target(const std::string& spec, const std::string& place);
// The same of a marker that is at hand.
CalibrationTarget calibration_target(const Marker& board, const std::string& place);

struct ObservedTarget {
    std::optional<CalibrationView> view;
    std::string reason;         // why there is none, in words
    std::string shown_as = {};  // as in Detection
};

// The target's points in a photograph, each with its index into Marker::points_mm in `ids`; nothing
// when less than six are seen (four of a board of 3x3 squares), or only some in one line.
// Chessboards and circles must be whole in the picture but for single points that dirt or glare
// hides; boards of tags may be seen in part. Of circles these are the centroids of their images:
// with_circle_centres(). Never throws for what an image holds. The same image gives the same
// result; safe from every thread. 50 to 250 ms for 640x480 px, up to a second without a target.
ObservedTarget observe(const CalibrationTarget& target, const CodeImage& image);

// Where the centres of the circles are seen: each centroid less the distance from the projected
// centre to the centroid of the projected disk (Mallon and Whelan, Pattern Recognition Letters 28,
// 2007). `observed` is what observe() gave. Camera and pose need be known only about: the bias is a
// pixel at most, its error some 1e-3 of it. Points without a projection stay as they are, and so do
// the views of all other kinds.
CalibrationView with_circle_centres(const CalibrationTarget& target,
                                    const CalibrationView& observed, const CameraModel& camera,
                                    const Rigid& camera_from_target);

// Views of one camera, all that observe() gave, corrected by a first calibration of them with this
// model (nothing: the advised one). Throws as calibrate_camera() does; free for other targets.
std::vector<CalibrationView> with_circle_centres(const CalibrationTarget& target,
                                                 std::vector<CalibrationView> views,
                                                 cv::Size image_size,
                                                 const std::optional<std::string>& model = {});

// Whether with_circle_centres() has anything to correct.
bool has_circles(const CalibrationTarget& target);

// The points of boards with tags, circles and squares, none where the board is not seen
// (tag_boards.cpp, circle_grid.cpp, square_grid.cpp). Safe from every thread.

struct FoundBoard {
    std::map<int, Eigen::Vector2d> points = {};  // by the index into Marker::points_mm
    std::string reason = {};    // why there are none, where something of the board is seen
    std::string shown_as = {};  // as in Detection

    void add(int id, const std::optional<Eigen::Vector2d>& pixel) {
        if (pixel)
            points.emplace(id, *pixel);
    }
};

struct BoardPhoto {
    cv::Mat pixels;     // CV_32FC1, full scale 1
    cv::Mat eight_bit;  // CV_8UC1, what the libraries expect
};

// Inner corners beside at least one marker that was read, in whichever of the two layouts the
// markers agree with.
FoundBoard find_charuco_corners(const Marker& board, const BoardPhoto& photo);

// Corners of the tags that were read, also in copies with dark parts shrunk by one and two pixels:
// blur joins tags and the squares between them to one outline.
FoundBoard find_tag_grid_corners(const Marker& board, const BoardPhoto& photo);

// Centroids of 1 - brightness / background, the background a plane through what is seen halfway to
// the neighbours. A quarter of the circles may be hidden.
FoundBoard find_circle_centroids(const Marker& board, const BoardPhoto& photo);

// Corners of dark squares on their own; a quarter of the squares may be hidden.
FoundBoard find_square_corners(const Marker& board, const BoardPhoto& photo);

}  // namespace etalon
