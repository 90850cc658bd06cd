// How the image of a target that stands still moves: as a shift, a growth and a turn about the
// middle of its points, by least squares, and what these three do not explain.
//
// A growth is a change of focal length or of distance, a turn one of the camera or the target about
// the optical axis: a target alone cannot tell which of the two moved.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "core/image/image.h"

namespace etalon {

// Of a target that is to be followed.
inline constexpr std::size_t min_target_points = 4;

// Pixel by the point's index on the target.
using TargetPoints = std::map<int, Eigen::Vector2d>;

// Shift x, shift y, growth, turn, all in px: growth and turn (clockwise as seen) are what they move
// a point by that is one `radius` from the middle. With equal noise of every coordinate of every
// point the four are uncorrelated and equally noisy.
using Movement = Eigen::Vector4d;

// The target as it was seen first.
class TargetReference {
public:
    // Throws NumericalError for fewer than 4 points or points that are all in one place.
    explicit TargetReference(TargetPoints points);

    const TargetPoints& points() const { return points_; }
    const Eigen::Vector2d& centre() const { return centre_; }
    double radius() const { return radius_; }  // root mean square distance from the middle, px

    struct Look {
        Movement movement;
        TargetPoints residuals;  // what the movement leaves of each point's displacement
    };
    // From the points that both have. Nothing when these are fewer than 4 or than half of the
    // reference, or in one place.
    std::optional<Look> look(const TargetPoints& points) const;

    // What a movement does at a pixel: displacement = at(pixel) * movement.
    Eigen::Matrix<double, 2, 4> at(const Eigen::Vector2d& pixel) const;

    // The largest displacement among the reference's points, px.
    double largest(const Movement& movement) const;

private:
    TargetPoints points_;
    Eigen::Vector2d centre_ = Eigen::Vector2d::Zero();
    double radius_ = 0.0;
};

// Root mean square of a coordinate of the residuals that a movement left, px, with its 4 degrees of
// freedom taken off; 0 for no more than two points.
double misfit(const TargetPoints& residuals);

// The points of a target in a photograph, whatever detector of ours finds them.

// Empty where the target is not seen. For one thread.
using TargetFinder = std::function<TargetPoints(const CodeImage&)>;

// For every marker and board that has a detector (sim/marker/marker.h,
// compare/detect/board/calibration_target.h). Throws ConfigError at `place` for any other.
TargetFinder make_target_finder(const std::string& spec, const std::string& place);

}  // namespace etalon
