// A marker's pose from a photograph and a pose nearby, where the stage or a detector puts it: no
// corner is looked for, so that any marker or board will do. What is fitted, and where, is chosen
// here; the fit is compare/photometric/photometric_pose.h.
//
// A start that is off by some px would leave most edges without an edge to go to. So photograph and
// rendering are blurred first, by a Gaussian of 3 px and of 1.5 px, and the pose is found there by
// least squares on all pixels. Before that, the shift that correlates best is taken.
#pragma once

#include <memory>

#include "compare/photometric/compared_area.h"
#include "compare/photometric/photometric_pose.h"
#include "core/image/image.h"
#include "sim/marker/marker.h"

namespace etalon {

class PhotometricDetector {
public:
    // `marker` as parse_marker() makes it; `background` is the radiance beside it, whose white
    // is 1. Throws ConfigError for a camera or marker that cannot be used, with `place`, and
    // NumericalError for a telecentric camera.
    PhotometricDetector(const CameraModel& camera, const Marker& marker, const std::string& place,
                        double background = 1.0);

    // Starts that displace the marker's image by up to this much are meant to be found. Measured
    // with that shift, half of it again by turn and by scale, and 3 degrees of tilt: a tag of 50 mm
    // in a VGA image 24 of 24 times at 300 and at 500 mm, 19 of 24 at 700 mm, where its cells are
    // below 5 px; a chessboard of 10 mm squares, which looks alike one square on, 22, 18 and 13 of
    // 24 (docs/photometric-pose.md). What is not found is mostly refused.
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

// What is fitted beside the pose: planes of black and white, a Gaussian's width where the camera
// has no lens section, a tone where it has no sensor section.
PhotometricTerms detector_terms(const CameraModel& camera);

// What counts of a marker: of a chessboard compared_area() with its margin, of any other marker all
// but the outer half of its outermost cells, beside which anything may be seen.
ComparedArea detector_area(const Marker& marker, const std::string& place);

}  // namespace etalon
