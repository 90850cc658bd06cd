// Where a distortion model may be used: the points that a ray from the axis reaches before the
// first fold (det J = 0), pole of the rational part, horizon of the tilt or end of the projection.
// Beyond, two rays share a pixel, or none has it.
//
// The border is found along 256 directions (one for a radial model) by marching in geometric steps
// through the radii at which two terms are equally large, then by bisection, and interpolated
// between: good to about 1e-4 of its radius.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

// Between radii in equally spaced directions, from the x axis on, by straight lines.
double radius_in_direction(const std::vector<double>& radii, const Eigen::Vector2d& direction);

class ValidRegion {
public:
    // Costs a few milliseconds, 0.05 ms for purely radial models. Coefficients must be finite.
    // `limit`: the radius on the plane at which the projection ends (plane_limit()).
    ValidRegion(const Distortion& distortion, double limit);

    // Whether an undistorted point of the plane lies inside the border. False for NaN.
    bool contains(const Eigen::Vector2d& undistorted) const {
        return undistorted.squaredNorm() < safe_radius_ * safe_radius_ ||
               undistorted.norm() < border(undistorted);
    }

    // No point of the region has a distorted point (before a tilt) farther from the axis: what lies
    // farther needs no search for its preimage. Infinite where the border is.
    double image_radius() const { return image_radius_; }

    // Radius of the border in the direction of this point; infinity where there is none.
    double border(const Eigen::Vector2d& direction) const;

private:
    double safe_radius_ = 0.0;  // smallest radius of the border
    double image_radius_ = 0.0;
    std::vector<double> border_;  // by direction, equally spaced from the x axis; one if symmetric
};

}  // namespace etalon
