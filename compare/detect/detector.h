// Fiducial detectors behind one interface, in our conventions: pixel (0, 0) is the centre of the
// top-left pixel; corners from the marker's top left clockwise as seen from the front; the marker
// frame of sim/marker/marker.h.
#pragma once

#include <functional>
#include <optional>

#include "calib/camera/projector.h"
#include "core/geometry/rigid.h"
#include "sim/marker/marker.h"

namespace etalon {

using ImagePoints = std::vector<Eigen::Vector2d>;   // px
using ObjectPoints = std::vector<Eigen::Vector3d>;  // mm, marker frame

// The corners of one marker in one image.
struct DetectedCorners {
    int id = 0;
    ImagePoints pixels;  // in the order of Marker::points_mm
    // Of a board that is seen in part: each pixel's index into Marker::points_mm, ascending. Empty
    // when all points are seen.
    std::vector<int> points = {};

    bool is_whole() const { return points.empty(); }
};

// The points of the marker that these pixels show: what estimate_pose() needs with them.
ObjectPoints seen_points_mm(const Marker& marker, const DetectedCorners& corners);

struct Detection {
    std::optional<DetectedCorners> corners;
    std::string reason = {};  // why there are none, in words: "marker not found"
    // All that look alike, where the marker is seen more than once; `corners` is empty then.
    std::vector<DetectedCorners> several = {};
    // The marker's name where the corners are its own and the squares are not: a ChArUco board in
    // the other of its two layouts, a chessboard that lies on its side.
    std::string shown_as = {};
};

// Why a marker that is drawn otherwise than it is named cannot be compared with its rendering.
std::string drawn_otherwise(const std::string& shown_as);

// Which detectors there are: compare/make_detector.h.
class Detector {
public:
    using Detect = std::function<Detection(const CodeImage& image)>;

    // `library_offset_px`: what was taken off both coordinates that the library gives.
    Detector(std::string name, Detect detect, double library_offset_px = 0.0)
        : name_(std::move(name)),
          detect_(std::move(detect)),
          library_offset_px_(library_offset_px) {}

    const std::string& name() const { return name_; }  // "apriltag"

    // 0.5 where the library counts from the corner of the top-left pixel.
    double library_offset_px() const { return library_offset_px_; }

    // The marker's corners in the image. Tags with another id do not count; the marker's own id
    // seen twice gives no corners. The same image gives the same result. One detector per thread.
    Detection detect(const CodeImage& image) { return detect_(image); }

private:
    std::string name_;
    Detect detect_;
    double library_offset_px_;
};

// A pose from corners. Planar targets have two local solutions; both are kept unless they are the
// same pose. RMS is of the distance in pixels, sqrt(sum |e|^2 / points).
struct PoseEstimate {
    Rigid camera_from_marker;  // the better one
    double reprojection_rms_px = 0.0;
    std::optional<Rigid> alternative;  // the other planar solution
    double alternative_rms_px = 0.0;
    // Times sigma_px^2 (of each coordinate of a corner): left perturbation, rot, trans.
    Matrix6d covariance_per_px2 = Matrix6d::Zero();
};

// Least squares on the pixels, distortion included, from the planar closed-form solutions. At least
// 4 coplanar points and as many pixels. Throws NumericalError for a telecentric lens. Nothing for
// degenerate points (collinear, not coplanar, not finite), a pixel without a ray, pixels that do
// not fix all six components, or no solution in front of the camera. Safe from every thread; about
// 0.1 ms for four points.
std::optional<PoseEstimate> estimate_pose(const Projector& projector, const ObjectPoints& points_mm,
                                          const ImagePoints& pixels);

// The one solution that least squares reach from `start`, in a fifth of the time. Nothing also when
// a point cannot be seen from there.
std::optional<PoseEstimate> estimate_pose_near(const Projector& projector,
                                               const ObjectPoints& points_mm,
                                               const ImagePoints& pixels, const Rigid& start);

}  // namespace etalon
