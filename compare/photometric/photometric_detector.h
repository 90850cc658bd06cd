// The pose at which a marker's rendering matches a photograph, by Gauss and Newton's method on the
// pixels with the photometric model alongside: for any marker or board, without corners.
//
// The approach takes one rendering a step and central differences on it as gradient (wrong by some
// 10 %). At its end the gradient is rendered (compare/photometric/photometric_equations.h) and
// kept: the last steps bring J^T r to zero with that J, and the covariance is made of (J^T J)^-1.
//
// A planar marker has two poses that look alike: the tilt mirrored about the line of sight. The
// other one is found by geometry and rendered once; it is fitted where a step promises to bring its
// loss near the first one's. The one with the lower loss is the result, the other is stated with
// it.
//
// From a start whose edges are off by more than a blur width PhotometricDetector takes the shift
// that correlates best, then blurs photograph and rendering by a Gaussian of 3 px and of 1.5 px and
// finds the pose there by least squares on all pixels.
#pragma once

#include <memory>
#include <optional>

#include "compare/photometric/compared_area.h"
#include "compare/photometric/photometric_equations.h"
#include "core/image/image.h"
#include "sim/marker/marker.h"

namespace etalon {

// The other planar solution, on the same pixels at the same noise; where there is no doubt, as
// geometry has it.
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
    // or the residuals' where the camera knows none or they are larger; widened where the residuals
    // of parts of the picture (10 x 10 of the marker's box) pull at the pose more than independent
    // pixels would (core/statistics/covariance.h). On a bent print, whose neighbouring parts pull
    // alike, deviations may be too small by half. What pulls all parts alike is not in it: a wrong
    // calibration, or the size of the print.
    Matrix6d covariance;
    PhotometricModel photometry;
    // In units of the known noise, or gray. 1.4826 times the median size of the residuals; 1 where
    // the camera knows its noise and that is not larger by three of its own standard errors.
    double noise_scale = 1.0;
    double reduced_squares = 0.0;  // mean square of the limited residuals, 1 for pure noise
    double loss = 0.0;             // sum of Huber's function of the residuals over the noise
    int pixels = 0;
    int renderings = 0;  // that it took, both solutions together
    // The next step is below a hundredth of its formal uncertainty, or below a tenth of the stated
    // one.
    bool converged = false;
    // Nothing where both starts end in one pose: the marker is seen frontally.
    std::optional<OtherPose> other;
};

// `photo.use`: the pixels of pixel_uses() at the start pose, or a part of them. The start's edges
// are within about a blur width of the photograph's (any detector's are); starting_state() makes it
// of a pose. Throws NumericalError when the pixels do not determine pose and photometric model, or
// nothing can be rendered at the start. For a tag of 900 to 22 000 px in a VGA image 3 to 30 ms of
// CPU time (tests/evidence/photometric_pose.cpp).
PhotometricPose photometric_pose(const PhotoOfMarker& photo,
                                 std::shared_ptr<const PhotometricCamera> camera,
                                 const PhotoState& start, const PhotometricTerms& terms);

// The pose with the marker's tilt mirrored about the line of sight to the middle of its grid.
Rigid tilt_mirrored(const Rigid& camera_from_marker, const CellGrid& grid);

class PhotometricDetector {
public:
    // `background`: the radiance around the marker, whose white is 1. Throws ConfigError for a
    // camera or marker that cannot be used, with `place`, and NumericalError for a telecentric
    // camera.
    PhotometricDetector(const CameraModel& camera, const Marker& marker, const std::string& place,
                        double background = 1.0);

    // Starts that displace the marker's image by up to this much are meant to be found; how often
    // they are: docs/photometric-pose.md. What is not found is mostly refused.
    static constexpr double basin_px = 5.0;

    // `start_error_px`: how far the start's edges may be off. Throws NumericalError when the start
    // does not put the marker into the image, the pixels do not determine the pose, or the
    // photograph does not show the marker there (correlation with the rendering below 0.7). CPU
    // time: see photometric_pose(). Safe from every thread.
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
