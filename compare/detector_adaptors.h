// The adaptors behind make_detector(), one per library. Only compare/detector.cpp and the tests of
// single adaptors need this header.
#pragma once

#include <memory>
#include <string>

#include "compare/detector.h"

namespace etalon {

// libapriltag, by default at full resolution (no decimation) and with edges refined. ConfigError at
// `place` for a marker that is no AprilTag or of a family that the library does not have, and for
// an option out of its range.
//
// TABLE
std::unique_ptr<Detector> make_apriltag_detector(const Marker& marker, const std::string& place,
                                                 const DetectorOptions& options = {});

// How OpenCV's ArUco places the corners. Mean offset towards the tag's centre on exact renderings
// of 120 px tags, OpenCV 4.6 (tests/compare/aruco_detector_test.cpp measures and prints it again).
// It is left in: it belongs to the detector, and a comparison meets it in photograph and rendering.
enum class ArucoRefinement {
    none,      // the contour's own pixels: 0.55 px
    subpixel,  // cv::cornerSubPix in a 7x7 px window, the default: 0.14 px
    contour,   // lines through the contour's pixels: 0.64 px
    apriltag,  // OpenCV's copy of the AprilTag 2 quads: 0.00 px once its half pixel is undone, but
               // -0.08 px in x and in y
};

// OpenCV's ArUco with a dictionary of its own. ConfigError at `place` for any other marker, and for
// a window out of its range.
//
// TABLE
std::unique_ptr<Detector> make_aruco_detector(const Marker& marker, ArucoRefinement refinement,
                                              const std::string& place,
                                              const DetectorOptions& options = {});

// Our own finder of STag markers (compare/stag_finder.h), all of whose edges place the corners: a
// marker that is too small or too hidden for that is not found. ConfigError for any other marker.
std::unique_ptr<Detector> make_stag_detector(const Marker& marker, const std::string& place);

// The TopoTag finder of compare/topotag_finder.h. ConfigError at `place` for any other marker.
std::unique_ptr<Detector> make_topotag_detector(const Marker& marker, const std::string& place);

// The corner finder of compare/chessboard_corners.h for a marker of kind chessboard.
std::unique_ptr<Detector> make_chessboard_detector(const Marker& marker, const std::string& place);

// The ChArUco corners that a calibration finds (compare/calibration_target.h), at least six of
// them: a board may be seen in part. Tags whose id is seen twice count as not seen, so that of two
// boards alike nothing is found. ConfigError at `place` for any other marker and for a board with
// fewer than 2x3 inner corners.
std::unique_ptr<Detector> make_charuco_detector(const Marker& marker, const std::string& place);

// The image with its full scale at 255, rounded: what the libraries expect. 8-bit images are not
// copied.
cv::Mat as_8_bit(const CodeImage& image);

}  // namespace etalon
