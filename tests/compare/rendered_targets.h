// Calibration targets rendered exactly at poses that spread over the image, and how far the points
// that observe() finds are from the truth.
#pragma once

#include "compare/detect/board/calibration_target.h"
#include "tests/compare/rendered_tags.h"

namespace etalon::test {

// A webcam's lens without distortion, its diffraction and defocus replaced by a Gaussian.
inline CameraModel blurred_camera(double sigma_px) {
    CameraModel camera = sharp_camera();
    camera.sensor = Sensor{.pixel_pitch_um = 5.0};
    camera.lens = Lens{.f_number = 4.0, .focus_distance_mm = 300.0, .wavelength_nm = 550.0};
    camera.lens->psf = {.kind = PointSpread::Kind::gaussian, .sigma_px = sigma_px};
    return camera;
}

inline Eigen::Vector3d middle_of(const Marker& board) {
    Eigen::Vector3d low = board.points_mm.front(), high = low;
    for (const Eigen::Vector3d& point : board.points_mm) {
        low = low.cwiseMin(point);
        high = high.cwiseMax(point);
    }
    return 0.5 * (low + high);
}

// The board's middle at (x, y, z), turned.
inline Rigid board_pose(const Marker& board, const Eigen::Vector3d& rotation,
                        const Eigen::Vector3d& middle) {
    Rigid pose{rotation_from_vector(rotation), middle};
    pose.translation -= pose.rotation * middle_of(board);
    return pose;
}

// Tilts to `largest_tilt` rad about any axis in the image, any roll up to 0.5 rad, the first one
// square to the camera and its edges along the pixels.
inline Rigid random_board_pose(const Marker& board, int n, double largest_tilt,
                               double distance_mm) {
    RandomStream random(31, 7, static_cast<std::uint64_t>(n));
    const auto between = [&](double low, double high) {
        return low + (high - low) * random.uniform();
    };
    if (n == 0)
        return board_pose(board, {0, 0, 0}, {1.3, -2.7, distance_mm});
    const double axis = between(-3.14, 3.14), tilt = between(0.0, largest_tilt);
    const Rigid tilted{
        rotation_from_vector(tilt * Eigen::Vector3d(std::cos(axis), std::sin(axis), 0)), {}};
    const Rigid rolled{rotation_from_vector({0, 0, between(-0.5, 0.5)}), {}};
    return board_pose(board, rotation_vector((tilted * rolled).rotation),
                      {between(-12, 12), between(-8, 8), distance_mm * between(1.0, 1.15)});
}

struct PointErrors {
    int found = 0;                     // boards
    std::size_t points = 0, seen = 0;  // of the boards that were found
    double sum_of_squares = 0.0, largest = 0.0;
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();

    double rms() const { return std::sqrt(sum_of_squares / std::max<double>(1, double(seen))); }
};

// Errors of a view's points. A board that looks the same after half a turn may be seen either way.
inline void add_errors(const Marker& board, const CalibrationView& view, const Projector& projector,
                       const Rigid& pose, bool half_turn, PointErrors& errors) {
    const auto error_of = [&](std::size_t i, bool turned) {
        const auto id = static_cast<std::size_t>(view.ids[i]);
        const Eigen::Vector3d& point =
            board.points_mm[turned ? board.points_mm.size() - 1 - id : id];
        return Eigen::Vector2d(view.pixels[i] - projector.project(pose * point).value());
    };
    const bool turned = half_turn && error_of(0, true).norm() < error_of(0, false).norm();
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const Eigen::Vector2d error = error_of(i, turned);
        errors.sum_of_squares += error.squaredNorm();
        errors.largest = std::max(errors.largest, error.norm());
        errors.sum += error;
    }
    errors.seen += view.pixels.size();
    errors.points += board.points_mm.size();
    ++errors.found;
}

}  // namespace etalon::test
