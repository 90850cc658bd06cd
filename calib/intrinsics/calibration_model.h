// Which parameters a calibration leaves free: named sets, each containing the one before. The
// others keep their values. Names: calib/camera/camera_model.h.
#pragma once

#include "calib/camera/camera_model.h"
#include "calib/camera/pixel_model.h"

namespace etalon {

// The order is that of covariances and of vectors of parameters.
struct CalibrationModel {
    std::string name;
    std::vector<std::string> parameters;
    Projection projection = Projection::perspective;
};

// Perspective ones, from the simplest on: pinhole (fx fy cx cy), radial (and k1 k2), standard (and
// p1 p2 k3, what OpenCV fits unless told otherwise), rational (and k4 k5 k6), prism (and s1 s2 s3
// s4), tilted (and tau_x tau_y).
const std::vector<CalibrationModel>& calibration_models();

// Of wide lenses (calib/camera/lens_projection.h), those with fewer parameters first:
// field_of_view, double_sphere and extended_unified without distortion, kannala_brandt
// (equidistant with k1 k2 k3 k7) and omnidirectional (unified with k1 k2 p1 p2).
const std::vector<CalibrationModel>& wide_calibration_models();

// Of telecentric lenses: telecentric (fx fy; without distortion the centre has no effect, and is
// held), telecentric_radial (and cx cy k1 k2) and telecentric_standard (and p1 p2 k3).
const std::vector<CalibrationModel>& telecentric_calibration_models();

// Those that are compared with a model of this projection: the list that it is in.
const std::vector<CalibrationModel>& calibration_models_beside(Projection projection);

// In the order in which the first that predicts well is advised: wide ones behind rational and
// before prism, which is for lenses and sensors that are not centred.
const std::vector<CalibrationModel>& perspective_and_wide_models();

// How many parameters of a pose pixels depend on: 6, telecentric 5, all but the distance.
int pose_parameters(Projection projection);

// Of any kind. Throws ConfigError, listing the names there are.
const CalibrationModel& calibration_model(std::string_view name);

// All parameters, of which a model has some: calib/camera/pixel_model.h. The kind of the projection
// stays as it is.
using CameraParameters = Eigen::Matrix<double, camera_parameter_count, 1>;
CameraParameters all_parameters(const CameraModel& camera);
void set_all_parameters(CameraModel& camera, const CameraParameters& values);

// Where a name stands among them. Throws ConfigError for a name that is none of them.
int parameter_index(std::string_view name);

// The parameters of the model, in its order.
Eigen::VectorXd parameters_of(const CameraModel& camera, const CalibrationModel& model);
void set_parameters(CameraModel& camera, const CalibrationModel& model,
                    const Eigen::VectorXd& values);

}  // namespace etalon
