// The inner loops of the published method (bench/published_method.h), vectorised with run-time
// dispatch to the widest instruction set of the machine. Single precision: a ray is off by less
// than 1e-3 px. Plain numbers only, because everything included here is compiled once per
// instruction set.
#pragma once

#include <cstddef>

namespace etalon::published {

// Loops may read and write this many floats past the count they are given.
constexpr std::size_t slack = 64;

struct KernelCamera {
    float inverse_fx, inverse_fy, cx, cy;
    float k[12];  // k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4
};

// A marker: h takes an undistorted sensor point (x, y, 1) times its depth to grid coordinates.
struct KernelGrid {
    float h[9];
    const float* cells;  // rows x columns without gaps
    int columns, rows;
};

struct KernelScene {
    const KernelGrid* grids;
    std::size_t grid_count;
    float background;
    float inverse_focus;  // 1/z_f, 1/mm
};

// n rays of a pixel: offsets in px, lens points in mm.
struct KernelRays {
    const float *pixel_x, *pixel_y, *lens_x, *lens_y;
    std::size_t n;  // a multiple of 64
};

// An undistorted sensor point with its derivative by the pixel.
struct LinearisedPoint {
    float x, y, x_by_px, x_by_py, y_by_px, y_by_py;
};

// OpenCV's undistortion of `count` pixels of a row (pixel_x[i], pixel_y): five fixed-point steps.
void undistort(const KernelCamera& camera, const float* pixel_x, float pixel_y, std::size_t count,
               float* x, float* y);

// Radiance on the rays through the lens centre, of the pixels (first_x + i, y).
void trace_centre_rays(const KernelCamera& camera, const KernelScene& scene, float first_x, float y,
                       std::size_t count, float* radiance);

// Mean radiance of a pixel's rays, each undistorted; or all by the derivative at the pixel.
float mean_of_rays(const KernelCamera& camera, const KernelScene& scene, const KernelRays& rays,
                   float pixel_x, float pixel_y);
float mean_of_linearised_rays(const KernelScene& scene, const KernelRays& rays,
                              const LinearisedPoint& point);

// Indices i in [0, count) where row[i] differs from one of its four neighbours, ascending; returns
// how many. Reads row[-1] and, in all three rows, the slack.
std::size_t find_edges(const float* above, const float* row, const float* below, std::size_t count,
                       int* indices);

// sums[i] = sum over the taps t of weight[t] * image[i + offset[t]].
struct KernelTaps {
    const std::ptrdiff_t* offset;
    const float* weight;
    std::size_t count;
};
void convolve_row(const float* image, const KernelTaps& taps, std::size_t count, float* sums);

}  // namespace etalon::published
