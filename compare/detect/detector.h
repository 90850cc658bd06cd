// Fiducial detectors behind one interface, in our conventions: pixel (0, 0) is the centre of the
// top-left pixel; corners from the marker's top left clockwise as seen from the front; the marker
// frame of sim/marker/marker.h. Each adaptor undoes its library's own convention in one named
// function.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/projector.h"
#include "core/image.h"
#include "core/rigid.h"
#include "sim/marker/marker.h"

namespace etalon {

// The corners of one marker in one image.
struct DetectedCorners {
    int id = 0;
    std::vector<Eigen::Vector2d> pixels;  // in the order of Marker::points_mm
    // Of a marker that is seen in part: the index into Marker::points_mm of each pixel, ascending.
    // Empty when all points are seen. Only boards of tags can be seen in part.
    std::vector<int> points = {};

    bool is_whole() const { return points.empty(); }
};

// The points of the marker that these pixels show: what estimate_pose() needs beside them.
std::vector<Eigen::Vector3d> seen_points_mm(const Marker& marker, const DetectedCorners& corners);

class Detector {
public:
    virtual ~Detector() = default;
    virtual const std::string& name() const = 0;  // "apriltag"

    // The marker's corners in the image, or nothing when it is not seen: failure() says why. Tags
    // with another id are no concern; the marker's own id seen twice is a failure, as nothing tells
    // which of them is on the stage (of a ChArUco board, the tags that are; a chessboard has no
    // id). The same image gives the same result. Not thread-safe: one detector per thread.
    virtual std::optional<DetectedCorners> detect(const CodeImage& image) = 0;

    // Why the last detect() returned nothing, in words: "marker not found".
    const std::string& failure() const { return failure_; }

protected:
    // For detect(): records the failure and returns nothing; only_one() does so unless exactly one
    // candidate was found.
    std::optional<DetectedCorners> failed(const std::string& why);
    std::optional<DetectedCorners> not_found();
    std::optional<DetectedCorners> only_one(const std::vector<DetectedCorners>& found);

private:
    std::string failure_;
};

// What a study may change of how a library places corners. What is not given is as in the adaptor.
// How far off the corners are with each: compare/detect/detector_adaptors.h.
struct DetectorOptions {
    // "aruco": half the side of the window that cv::cornerSubPix sees around a corner, as OpenCV's
    // cornerRefinementWinSize: 2 half + 1 pixels a side. 1 to 30; 3 when not given.
    std::optional<int> subpixel_half_window_px;
    // "apriltag": outlines are looked for in an image reduced by this factor. 1, 1.5, or a whole
    // number up to 8; 1 when not given (the library's own default is 2).
    std::optional<double> quad_decimate;
    // "apriltag": whether edges are then fitted anew to the whole image. True when not given.
    std::optional<bool> refine_edges;
};

// A detector for this marker: "apriltag", "aruco", "topotag", "chessboard", "charuco" or "stag";
// "auto" takes the one that belongs to the marker. ArUco's other ways to place corners, for studies
// of their bias, are "aruco-none", "aruco-contour" and "aruco-apriltag". Throws ConfigError (at
// `place`) when there is no such detector, it cannot see the marker, or an option is out of its
// range or belongs to another detector.
std::unique_ptr<Detector> make_detector(const std::string& name, const Marker& marker,
                                        const std::string& place,
                                        const DetectorOptions& options = {});

// A pose from corners. Planar targets have two local solutions; both are kept unless they end in
// the same pose. RMS is that of the distance in pixels, sqrt(sum |e|^2 / points).
struct PoseEstimate {
    Rigid camera_from_marker;  // the better one
    double reprojection_rms_px = 0.0;
    std::optional<Rigid> alternative;  // the other planar solution
    double alternative_rms_px = 0.0;
    // Times sigma_px^2 (of each coordinate of a corner): left perturbation, rot, trans.
    Matrix6d covariance_per_px2 = Matrix6d::Zero();
};

// Least squares on the pixels, distortion included, from the planar closed-form solutions.
// Needs at least 4 coplanar points and as many pixels. Nothing when the points are degenerate
// (collinear, not coplanar, not finite), a pixel has no ray, the pixels do not fix all six
// components, or no solution has the marker in front of the camera. Safe from every thread; about
// 0.1 ms for four points.
std::optional<PoseEstimate> estimate_pose(const Projector& projector,
                                          const std::vector<Eigen::Vector3d>& points_mm,
                                          const std::vector<Eigen::Vector2d>& pixels);

// The same from `start`, a pose known well enough to tell the two planar solutions apart: gives the
// one that least squares reach from there, without the other, in a fifth of the time. Nothing also
// when a point cannot be seen from the start.
std::optional<PoseEstimate> estimate_pose_near(const Projector& projector,
                                               const std::vector<Eigen::Vector3d>& points_mm,
                                               const std::vector<Eigen::Vector2d>& pixels,
                                               const Rigid& start);

}  // namespace etalon
