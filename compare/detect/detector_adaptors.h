// What detectors are made of: libraries' finders in our pixel convention, their options, and what
// all finders share.
#pragma once

#include <memory>
#include <opencv2/core.hpp>

#include "compare/detect/detector.h"

namespace etalon {

struct ApriltagOptions {
    double quad_decimate = 1.0;  // in an image reduced by 1, 1.5, or a whole number up to 8
    bool refine_edges = true;    // fitted again to the whole image
};

// All tags of a family in an image, by libapriltag 3. Not thread-safe: one per thread. Some 10 ms
// to make for a family of hundreds of codes.
class ApriltagFinder {
public:
    // The library puts (0, 0) at the corner of the top-left pixel: taken off its coordinates.
    static constexpr double library_offset_px = 0.5;

    // Families of sim/marker/tag_pattern.h; Kalibr prints the classic ones with a border of two
    // cells. Throws ConfigError for an unknown family.
    explicit ApriltagFinder(const std::string& family, int border_cells = 1,
                            const ApriltagOptions& options = {});

    // `image`: CV_8UC1. Four corners of each black square, from the top left clockwise. The same
    // image gives the same result.
    std::vector<DetectedCorners> find(cv::Mat image) const;

private:
    struct Handles;
    std::shared_ptr<Handles> handles_;
};

// libapriltag for one tag. Throws ConfigError at `place` for another marker and for options out of
// range. What the options do to corners: docs/study.md.
std::unique_ptr<Detector> make_apriltag_detector(const Marker& marker, const std::string& place,
                                                 const ApriltagOptions& options = {});

// How OpenCV's ArUco places the corners, with the mean offset towards the tag's centre on exact
// renderings of 120 px tags, OpenCV 4.6 (tests/compare/detect/tag_detectors_test.cpp). It is left
// in.
enum class ArucoRefinement {
    none,      // the contour's own pixels: 0.55 px
    subpixel,  // cv::cornerSubPix in a 7x7 px window, the default: 0.14 px
    contour,   // lines through the contour's pixels: 0.64 px
    apriltag,  // OpenCV's copy of the AprilTag 2 quads, 0.5 px taken off: 0.00 px, but -0.08 px in
               // x and in y
};

struct ArucoOptions {
    ArucoRefinement refinement = ArucoRefinement::subpixel;
    std::optional<int> subpixel_half_window_px = {};  // of `subpixel`: 1 to 30, 3 when not given
};

// OpenCV's ArUco for one tag, named "aruco", or "aruco-none" and so on. Throws as
// make_apriltag_detector() does. What the sub-pixel window does: docs/study.md.
std::unique_ptr<Detector> make_aruco_detector(const Marker& marker, const std::string& place,
                                              const ArucoOptions& options = {});

// All tags of a dictionary of sim/marker/tag_pattern.h in a CV_8UC1 image, by OpenCV's ArUco: four
// corners each, as above. With ArucoRefinement::subpixel they are unrefined.
std::vector<DetectedCorners> find_aruco_tags(const cv::Mat& image, const std::string& dictionary,
                                             ArucoRefinement refinement);

// For a marker of kind chessboard: compare/detect/board/chessboard_corners.h.
std::unique_ptr<Detector> make_chessboard_detector(const Marker& marker);

// The points of a board as observe() gives them (compare/detect/board/calibration_target.h).
// ConfigError at `place` for a board too small to calibrate with.
std::unique_ptr<Detector> make_board_detector(const std::string& name, const Marker& marker,
                                              const std::string& place);

// The only one with this id; no corners when there is none, or more than one.
Detection only_one(int id, const std::vector<DetectedCorners>& found);

// CV_8UC1, full scale 255, rounded. 8-bit images are not copied.
cv::Mat as_8_bit(const CodeImage& image);

// CV_32FC1, full scale 1.
cv::Mat as_float(const CodeImage& image);

// By least squares through at least four points; nothing where they do not determine one.
std::optional<Eigen::Matrix3d> homography(const std::vector<Eigen::Vector2d>& from,
                                          const std::vector<Eigen::Vector2d>& to);

// Where a homography takes a place, and the derivative there.
Eigen::Vector2d seen_at(const Eigen::Matrix3d& homography, const Eigen::Vector2d& place);
Eigen::Matrix2d jacobian_at(const Eigen::Matrix3d& homography, const Eigen::Vector2d& place);

// Above 0 where b is clockwise of a as seen, the image's y down.
inline double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() * b.y() - a.y() * b.x();
}

// Spread of points along their principal axes, largest first, mm.
Eigen::Vector3d principal_spreads(const std::vector<Eigen::Vector3d>& points_mm);

}  // namespace etalon
