// What each error of camera, marker or stage that has a name does to the corners of a run's poses,
// to first order: central differences of the projection, no pixels.
#pragma once

#include <functional>
#include <span>

#include "compare/pose/pose.h"

namespace etalon {

// The run's geometry. X and Y are the registered ones. Of the poses only base_from_carriage and
// hold_out count.
struct SignatureChain {
    const Projector& projector;  // the calibration under test
    ObjectPoints points_mm;
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
    bool is_linear_scale = false;           // the scale of a linear axis
};

// An error as what it changes. What it does belongs to `size`, small enough for first order.
template <class Changed>
struct ChangingError {
    std::string name;  // "focal length", "c_x", "marker twist"...
    std::string unit;
    double size = 0.0;
    std::function<void(Changed&, double)> change;  // makes it wrong by this much
};

using CameraError = ChangingError<CameraModel>;
// Those that have a signature, and those that only causes are looked for among: aspect, rational,
// prism and tilt terms. A wide lens has no tilt; among the first are its k7 and the projection's
// own parameters, unless one is at the end of its range.
std::vector<CameraError> named_camera_errors(const CameraModel& camera);
std::vector<CameraError> further_camera_errors(const CameraModel& camera);

// The marker as it is printed and bent, and what moves its corners in photographs alone.
struct TrueMarker {
    ObjectPoints points_mm;
    Eigen::Vector3d offset_mm = Eigen::Vector3d::Zero();  // of every pose, camera frame
    Eigen::Vector2d corner_shift_px = Eigen::Vector2d::Zero();
    double edges_inwards_px = 0.0;  // of a single tag; 0: none

    void scale(double factor);
    // Out of its plane, by `size` at the highest point: opposite corners up, or all edges alike.
    void twist(double size_mm);
    void bow(double size_mm);
    // The corners in an image. Throws NumericalError when one has no projection.
    ImagePoints seen(const Projector& projector, Rigid camera_from_marker) const;
};
using MarkerError = ChangingError<TrueMarker>;
// Of a marker of so many points: print size, half pixel, edge shrink (a single tag), twist, bow
// (any other), constant pose offset.
std::vector<MarkerError> marker_errors(std::size_t points);

// The corners of a square, in order, when each of its edges is seen moved inwards by `by_px`.
ImagePoints edges_moved_inwards(const ImagePoints& corners, double by_px);

// What a named error does to the corners of a chain, which must outlive it: the pixels of pose i
// when the error has `size`. Throws NumericalError when a corner has no projection.
struct NamedError {
    std::string name, unit;
    double size;
    std::function<Eigen::VectorXd(std::size_t pose, double size)> pixels;
    bool one_sided = false;  // only `size` and 0 can be asked for (stage errors come at one size)

    // Of the corners of the first `poses`, stacked, at `size`: by central differences, or that part
    // of what the error does at size `at` (of stage errors the same).
    Eigen::VectorXd motion(std::size_t poses, std::optional<double> at = std::nullopt) const;
};
NamedError named_error(const SignatureChain& chain, const CameraError& error);
NamedError named_error(const SignatureChain& chain, const StageError& error);

// The camera's and marker's own, then the stage's: those that have a signature.
std::vector<NamedError> named_errors(const SignatureChain& chain,
                                     std::span<const StageError> stage_errors);
// further_camera_errors(), and skew: x moves with y.
std::vector<NamedError> further_errors(const SignatureChain& chain);

}  // namespace etalon
