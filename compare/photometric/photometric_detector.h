// The pose at which a marker's rendering matches a photograph, by Gauss and Newton's method on the
// pixels with the photometric model alongside: for any marker or board, without corners.
//
// The approach takes one rendering a step, with central differences on it as gradient. Then the
// gradient is rendered and kept: the last steps bring J^T r to zero with that J.
//
// A planar marker has two poses that look alike: the tilt mirrored about the line of sight. The
// other one is rendered once, and fitted where its loss may come near the first one's. The one with
// the lower loss is the result.
//
// From a start whose edges are off by more than a blur width PhotometricDetector takes the shift
// that correlates best. Then it fits the pose to photograph and rendering blurred by 3 and 1.5 px.
#pragma once

#include <memory>

#include "compare/photometric/compared_area.h"
#include "compare/photometric/photometric_equations.h"

namespace etalon {

// The other planar solution, on the same pixels at the same noise. Not fitted where there is no
// doubt.
struct OtherPose {
    Rigid camera_from_marker;
    double loss = 0.0;
    // Of the better pose to this one: the difference of the losses. With 3 the other one is true in
    // 1 of 20 cases; beyond 20 there is no doubt.
    double log_likelihood_ratio = 0.0;
};

struct PhotometricPose {
    Rigid camera_from_marker;
    // Left perturbation, rot, trans; the photometric parameters marginalised. At the stated noise,
    // or the residuals' where the camera knows none or they are larger. Widened where parts of the
    // picture (10 x 10 of the marker's box) pull at the pose more than independent pixels would
    // (core/statistics/covariance.h). On a bent print deviations may be too small by half. A wrong
    // calibration and the size of the print are not in it.
    Matrix6d covariance;
    PhotometricModel photometry;
    double noise_scale = 1.0;      // noise_scale_of(), in units of the known noise, or gray
    double reduced_squares = 0.0;  // mean square of the limited residuals, 1 for pure noise
    double loss = 0.0;             // sum of Huber's function of the residuals over the noise
    int pixels = 0;
    int renderings = 0;  // that it took, both solutions together
    // The next step is below a hundredth of its formal uncertainty, or a tenth of the stated one.
    bool converged = false;
    // Nothing where both starts end in one pose: the marker is seen frontally.
    std::optional<OtherPose> other;
};

// `photo.use`: the pixels of pixel_uses() at the start pose, or a part of them. The start's edges
// are within about a blur width of the photograph's, as any detector's are. Throws NumericalError
// when the pixels do not determine pose and photometric model, or nothing can be rendered at the
// start. 3 to 30 ms of CPU time for a tag of 900 to 22 000 px
// (tests/evidence/photometric_pose.cpp).
PhotometricPose photometric_pose(const PhotoOfMarker& photo,
                                 std::shared_ptr<const PhotometricCamera> camera,
                                 const PhotoState& start, const PhotometricTerms& terms);

// The pose with the marker's tilt mirrored about the line of sight to the middle of its grid.
Rigid tilt_mirrored(const Rigid& camera_from_marker, const CellGrid& grid);

class PhotometricDetector {
public:
    // `background`: the radiance around the marker, whose white is 1. Throws ConfigError at `place`
    // for a camera or marker that cannot be used, NumericalError for a telecentric camera.
    PhotometricDetector(const CameraModel& camera, const Marker& marker, const std::string& place,
                        double background = 1.0);

    // Starts that displace the marker's image by up to this much are meant to be found. How often
    // they are: docs/photometric-pose.md.
    static constexpr double basin_px = 5.0;
    // By how much a detector's corners displace it at most.
    static constexpr double detector_error_px = 0.5;

    // `start_error_px`: how far the start's edges may be off. Throws NumericalError when the start
    // does not put the marker into the image, the pixels do not determine the pose, or photograph
    // and rendering correlate by less than 0.7. Cost of photometric_pose(). Safe from every thread.
    PhotometricPose find(const CodeImage& photo, const Rigid& start, double start_error_px) const;

    const std::shared_ptr<const PhotometricCamera>& camera() const { return camera_; }

    // What find() fits of a photograph (CV_32FC1, gray) with the marker at this pose. Throws
    // NumericalError where that is outside the image.
    PhotoOfMarker photo_at(const cv::Mat& gray, const Rigid& camera_from_marker) const;

private:
    Rigid from_afar(const cv::Mat& gray, const Rigid& start, double start_error_px) const;
    void require_shown(const PhotoOfMarker& photo, const Rigid& camera_from_marker) const;

    std::shared_ptr<const PhotometricCamera> camera_;
    CellGrid grid_;
    ComparedArea area_;
    double background_;
};

// What is fitted with the pose: planes of black and white, a Gaussian's width where the camera
// has no lens section, a tone where it has no sensor section.
PhotometricTerms detector_terms(const CameraModel& camera);

// Of a chessboard compared_area() with its margin, of any other marker all but the outer half of
// its outermost cells.
ComparedArea detector_area(const Marker& marker, const std::string& place);

}  // namespace etalon
