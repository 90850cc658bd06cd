// What each error of camera, marker or stage that has a name does to the corners of a run's poses,
// to first order: central differences of the projection, no pixels.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/projector.h"
#include "calib/registration/registration.h"
#include "compare/pose/pose.h"

namespace etalon {

// The run as named errors need it: geometry only. X and Y are the registered ones. Of the poses
// only where the stage was and which are held out counts.
struct SignatureChain {
    const Projector& projector;  // the calibration under test
    std::vector<Eigen::Vector3d> points_mm;
    Rigid camera_from_base, carriage_from_marker;
    std::vector<AnalysedPose> poses;

    Rigid camera_from_marker(std::size_t pose) const {
        return camera_from_base * poses[pose].base_from_carriage * carriage_from_marker;
    }
    // d pixels / d left perturbation of camera_from_marker: 2 rows per point, 6 columns (rad, mm).
    // Throws NumericalError when a point has no projection.
    Eigen::MatrixXd pose_jacobian(std::size_t pose) const;
};

// A stage error: where the carriage would truly stand at each read-back position.
struct StageError {
    std::string name;  // "stage scale z"
    std::string unit;  // "1" (relative), "rad", "mm", "px"; empty: a coefficient's own number
    double size = 0.0;
    std::vector<Rigid> base_from_carriage;  // per pose, at this size
};

// A camera error: the true camera differs from the calibration by it. What it does belongs to
// `size`, small enough for first order.
struct CameraError {
    std::string name;  // "focal length", "c_x", "k1"...
    std::string unit;
    double size = 0.0;
    std::function<void(CameraModel&, double)> change;  // makes the camera wrong by this much
};
// Those that have a signature in every report, and those that only causes are looked for among:
// aspect, rational, prism and tilt terms. A wide lens has no tilt; among the first are its k7 and
// the projection's own parameters, unless one is at the end of its range.
std::vector<CameraError> named_camera_errors(const CameraModel& camera);
std::vector<CameraError> further_camera_errors(const CameraModel& camera);

// The corners of a square, in order, when each of its edges is seen moved inwards by `by_px`: each
// corner goes to where its two edges then meet.
std::vector<Eigen::Vector2d> edges_moved_inwards(const std::vector<Eigen::Vector2d>& corners,
                                                 double by_px);

// The direction in which the error "constant pose offset" moves every pose, camera frame; unit.
Eigen::Vector3d pose_offset_direction();

// What a named error does to the corners: the pixels of pose i when the error has `size`.
struct NamedError {
    std::string name, unit;
    double size;
    std::function<Eigen::VectorXd(std::size_t pose, double size)> pixels;
    bool one_sided = false;  // only `size` and 0 can be asked for (stage errors come at one size)

    // At `size`, 2 numbers per point: from central differences there, or that part of what the
    // error does when it is `at` so large (of stage errors the same).
    Eigen::VectorXd displacement(std::size_t pose) const;
    Eigen::VectorXd secant(std::size_t pose, double at) const;
};

// The chain must outlive this and its errors. All throw NumericalError when a corner has no
// projection.
class NamedErrors {
public:
    explicit NamedErrors(const SignatureChain& chain);

    // The camera's and marker's own (compare/diagnosis/error_signatures.h), then the stage's.
    std::vector<NamedError> with_signatures(std::span<const StageError> stage_errors) const;
    // further_camera_errors(), and skew: x moves with y.
    std::vector<NamedError> further() const;

    NamedError camera_error(const CameraError& error) const;
    NamedError stage_error(const StageError& error) const;

private:
    std::vector<NamedError> marker_errors() const;
    NamedError out_of_plane(std::string name,
                            const std::function<double(const Eigen::Vector3d&)>& shape) const;
    Eigen::VectorXd nominal(std::size_t pose) const;

    const SignatureChain& chain_;
    std::vector<Rigid> truth_;  // camera_from_marker per pose, without any error
};

}  // namespace etalon
