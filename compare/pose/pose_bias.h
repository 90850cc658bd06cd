// Pose biases, kept apart (docs/metrology.md):
//
//     B1 = detector(render) - truth              absolute, all six components
//     B2 = detector(photo)  - X S(q) Y           relative: registration has removed the gauge
//     B3 = detector(photo)  - detector(render)   of the camera model and the stage alone
//     B4 = photometric pose - X S(q) Y           the same without any detector's corners
//
// X and Y are registered on corners less the detector's bias as a render shows it: else B3 would
// show that bias with its sign turned. It changes within a pixel, so the render is best made at the
// photograph's photometric pose; `detector(render)` is then the projected truth and that bias.
#pragma once

#include "calib/registration/registration.h"
#include "compare/detect/detector.h"

namespace etalon {

struct PoseError {
    Eigen::Vector3d translation_mm;  // t_estimated - t_true, camera frame
    Eigen::Vector3d rotation_rad;    // log(R_true^T R_estimated), marker frame
};

PoseError pose_error(const Rigid& estimated, const Rigid& truth);

// Renders the marker at this pose as the camera under test should see it, sensor included, and
// detects it as the photographs were detected. Nothing when not detected.
using RenderAndDetect = std::function<std::optional<ImagePoints>(const Rigid& camera_from_marker)>;

// Throws NumericalError for a point outside the camera's valid region.
ImagePoints projected(const Projector& projector, const ObjectPoints& points_mm,
                      const Rigid& camera_from_marker);

struct BiasCorrectedRegistration {
    Registration registration;
    std::vector<std::size_t> used;  // indices of the given poses: seen in photo and render
    // Of each of those, the photo's corners less the detector's bias of the last round.
    std::vector<ImagePoints> corrected_px;
    int rounds = 0;                  // of rendering poses whose bias is not known
    double last_change_px = 0.0;     // largest move of a predicted corner in the last round
    std::vector<double> changes_px;  // the same of each round
};

// Corners one after another, x and y of each.
inline Eigen::VectorXd stacked(const ImagePoints& corners) {
    return Eigen::Map<const Eigen::VectorXd>(corners.front().data(), 2 * std::ssize(corners));
}

// Corners less others, in order. Throws NumericalError for different numbers.
ImagePoints differences(const ImagePoints& corners, const ImagePoints& others);

// Registers on corners(photo) - bias. `known_bias`: of each pose, from a render where the
// photograph shows the marker; empty: not known. Then it is corners(render at the current X S Y) -
// projected truth, iterated until no predicted corner moves by more than 0.002 px (two rounds are
// usual). Calls `render_and_detect` once per such pose and round. Throws what register_stage
// throws, and NumericalError for sizes that do not agree.
BiasCorrectedRegistration register_bias_corrected(const Projector& projector,
                                                  const ObjectPoints& points_mm,
                                                  std::span<const RegistrationPose> poses,
                                                  const Rigid& nominal_carriage_from_marker,
                                                  const RenderAndDetect& render_and_detect,
                                                  std::span<const ImagePoints> known_bias = {},
                                                  int max_rounds = 3);

// One pose seen by the photograph and by the render at the predicted pose.
struct PoseBias {
    Rigid predicted;                            // X S(q) Y
    std::optional<PoseEstimate> photo, render;  // nothing: not detected, or no pose from corners
    std::optional<PoseError> b1, b2, b3;
    std::optional<PoseError> b4;  // where the photograph has a photometric pose
    // The photograph's corners less those expected at `predicted`, the detector's bias included.
    // Empty where one of the two is missing.
    ImagePoints difference_px = {};
};

// Of a planar marker's two solutions the one nearer to `predicted` is taken in both images. No
// corners: not detected.
PoseBias pose_bias(const Projector& projector, const ObjectPoints& points_mm,
                   const Rigid& predicted, const ImagePoints& photo_corners,
                   const ImagePoints& render_corners);

}  // namespace etalon
