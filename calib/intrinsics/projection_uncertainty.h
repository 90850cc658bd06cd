// An uncertain calibration in pixels: how far the image of a fixed ray may be off, everywhere,
// since the parameters' errors cancel. With the camera held, and after the rotation that takes back
// most of it, each place weighing by its certainty: what a measurement is left that finds the
// camera's orientation itself. After mrcal (its documentation, "Projection uncertainty"), for far
// points.
#pragma once

#include "calib/intrinsics/calibration_model.h"
#include "calib/intrinsics/calibration_view.h"

namespace etalon {

// Rays through a grid of pixel positions from border to border of the image; positions that no ray
// reaches are left out.
struct ImageRays {
    std::vector<Eigen::Vector2d> pixels;
    std::vector<Eigen::Vector3d> rays;  // Projector::ray()
    double step_x_px = 0.0, step_y_px = 0.0;
    double share_without_ray = 0.0;  // of the image, where the distortion folds over: 0 to 1
};
ImageRays image_rays(const CameraModel& camera);
std::vector<Eigen::Vector2d> all_pixels(std::span<const CalibrationView> views);
// Those within the convex hull of some pixels.
ImageRays rays_among(const ImageRays& rays, std::span<const Eigen::Vector2d> pixels);

// d pixel / d parameters and d pixel / d rotation (rad, left perturbation), two rows a ray.
// Telecentric rays have Z = 1 mm: a turn of 1 rad about x or y shifts them by 1 mm.
Eigen::MatrixXd parameter_jacobian(const CameraModel& camera, const ImageRays& rays,
                                   const CalibrationModel& model);
Eigen::MatrixXd rotation_jacobian(const CameraModel& camera, const ImageRays& rays);

// The rotations (rad, a column each) that move the rays most like the columns of `moved` do: least
// squares of rays divided by their deviation (px, one per ray). And what such rotations leave.
Eigen::MatrixXd best_rotation(const Eigen::MatrixXd& moved, const Eigen::MatrixXd& rotation,
                              const Eigen::VectorXd& deviations);
Eigen::MatrixXd less_best_rotation(const Eigen::MatrixXd& moved, const Eigen::MatrixXd& rotation,
                                   const Eigen::VectorXd& deviations);

// Of every ray, in the direction in which it is largest: one standard deviation, px.
Eigen::VectorXd ray_deviations(const Eigen::MatrixXd& jacobian, const Eigen::MatrixXd& covariance);

struct PixelUncertainty {
    Eigen::Vector2d pixel;
    double held = 0.0, rotated = 0.0;  // one standard deviation, px
    bool among_points = false;         // within the convex hull of the points calibrated from
};

struct ProjectionUncertainty {
    std::vector<PixelUncertainty> pixels;
    double step_x_px = 0.0, step_y_px = 0.0;  // between them
    double share_without_ray = 0.0;           // of the image: ImageRays

    double mean(double PixelUncertainty::*value) const;
    double worst(double PixelUncertainty::*value) const;
    double worst_among_points(double PixelUncertainty::*value) const;
    double share_among_points() const;  // of the image, 0 to 1
};

// `covariance` is of the model's parameters in their order, `points` the calibration's pixels. Some
// milliseconds. Throws NumericalError where Projector does, and when no ray reaches the image.
ProjectionUncertainty projection_uncertainty(const CameraModel& camera,
                                             const CalibrationModel& model,
                                             const Eigen::MatrixXd& covariance,
                                             std::span<const Eigen::Vector2d> points);

}  // namespace etalon
