// Chessboards and slanted edges for the tests of what is measured along edges.
#pragma once

#include <numbers>

#include "compare/edges/edge_spread.h"
#include "sim/render/reference_integrator.h"
#include "tests/calib/cameras.h"

namespace etalon::test {

// 12 bit, black level 64, a few thousand electrons: signal to noise of 50 in the white.
inline CameraModel edge_camera(int width, int height) {
    return camera_with(width, height, {900.0, 905.0, 0.5 * width - 1.7, 0.5 * height + 1.1},
                       {.k1 = -0.2},
                       Sensor{.pixel_pitch_um = 5.0,
                              .bits = 12,
                              .black_dn = 64.0,
                              .gain_e_per_dn = 0.8,
                              .read_noise_e = 7.0},
                       Lens{.f_number = 8.0, .focus_distance_mm = 500.0, .wavelength_nm = 550.0});
}

inline void set_gaussian(CameraModel& camera, double sigma_px) {
    camera.lens->psf = {.kind = PointSpread::Kind::gaussian, .sigma_px = sigma_px};
}

// A board whose print is neither black nor white: nothing is clipped.
inline Marker gray_board(const std::string& spec) {
    Marker board = parse_marker(spec, "test");
    for (float& cell : cv::Mat_<float>(board.grid.cells))
        cell = 0.06f + 0.75f * cell;
    return board;
}

inline Rigid pose_of(double rx, double ry, double rz, double x, double y, double z) {
    return rigid_from_vector((Vector6d() << rx, ry, rz, x, y, z).finished());
}

struct EdgeScene {
    CameraModel camera;
    Marker board;
    Rigid pose;

    Scene scene() const { return {{{board.grid, pose}}, 0.3}; }
    // By the closed-form renderer.
    Radiance rendered() const { return Renderer(camera).render(scene(), {}).radiance; }
    // By brute force; flat pixels, which any number of samples gives exactly, are stopped early.
    Radiance reference(int samples) const {
        return integrate_reference(camera, scene(), {0, 0, camera.width, camera.height},
                                   {.samples_per_scramble = samples, .stop_at_gray = 0.01})
            .mean;
    }
    std::vector<StraightEdge> edges(const CodeImage& photo,
                                    const EdgeSelection& selection = {}) const {
        return target_edges(linear_photo(photo, camera), Projector(camera), board.grid, pose,
                            compared_area(board, {}, "test"), selection);
    }
};

// About 20 squares of 27 px, turned and tilted.
inline EdgeScene small_board(double sigma_px) {
    EdgeScene scene{edge_camera(190, 150), gray_board("chessboard:5x4@15mm"),
                    pose_of(0.15, -0.2, 0.09, -30.0, -22.0, 500.0)};
    set_gaussian(scene.camera, sigma_px);
    return scene;
}

// A tilted board through the plane of focus: blur disks of up to 1.8 px on both sides.
inline EdgeScene defocused_board() {
    EdgeScene scene{edge_camera(260, 170), gray_board("chessboard:8x5@10mm"),
                    pose_of(0.25, -0.8, 0.12, -26.0, -22.0, 273.0)};
    scene.camera.sensor->pixel_pitch_um = 17.0;
    scene.camera.lens->f_number = 1.4;
    scene.camera.lens->focus_distance_mm = 303.0;
    set_gaussian(scene.camera, 0.5);
    return scene;
}

// Errors over their stated deviations.
struct Pulls {
    double sum = 0.0, squares = 0.0;
    int count = 0;
    void add(double error, double standard_uncertainty) {
        const double pull = error / standard_uncertainty;
        sum += pull;
        squares += pull * pull;
        ++count;
    }
    double mean() const { return sum / count; }
    double square() const { return squares / count; }
};

inline double sinc(double x) {
    const double q = std::numbers::pi * x;
    return q == 0.0 ? 1.0 : std::sin(q) / q;
}

// Of a square pixel, across an edge at this angle to its columns.
inline double pixel_transfer_across(double degrees, double cycles_per_px) {
    const double angle = degrees * std::numbers::pi / 180.0;
    return std::abs(sinc(cycles_per_px * std::cos(angle)) * sinc(cycles_per_px * std::sin(angle)));
}

inline double gaussian_transfer(double sigma_px, double cycles_per_px) {
    const double q = std::numbers::pi * sigma_px * cycles_per_px;
    return std::exp(-2.0 * q * q);
}

// Integral of the normal distribution function: what a box's end sees of a Gaussian edge.
inline double gaussian_ramp(double x, double sigma) {
    const double u = x / sigma;
    return x * 0.5 * std::erfc(-u / std::numbers::sqrt2) +
           sigma * std::exp(-0.5 * u * u) / std::sqrt(2.0 * std::numbers::pi);
}

// An edge behind a Gaussian and a square pixel, by its definition: the pixel's other width is
// integrated by the midpoint rule, whose error with 400 steps is below 1e-6.
inline double gaussian_edge(double distance, const Eigen::Vector2d& normal, double sigma) {
    constexpr int steps = 400;
    const double a = std::abs(normal.x()), b = std::abs(normal.y());
    double sum = 0.0;
    for (int i = 0; i < steps; ++i) {
        const double d = distance + b * ((i + 0.5) / steps - 0.5);
        sum += (gaussian_ramp(d + 0.5 * a, sigma) - gaussian_ramp(d - 0.5 * a, sigma)) / a;
    }
    return sum / steps;
}

}  // namespace etalon::test
