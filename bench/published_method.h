// The published way to render a marker through a lens, as a baseline for speed and accuracy; the
// errors that it has by design are kept (docs/performance.md names them).
//
// Source: the renderer of the FMAC paper, as its text describes it.
//   1. One ray per pixel, through the pixel's centre and the lens' centre, undistorted with
//      OpenCV's five fixed-point steps, finds the nearest marker's cell or the background.
//   2. A pixel that differs from one of its four neighbours is an edge pixel, and so is everything
//      within 1 + ceil(R) px of it; R is the blur radius there.
//   3. An edge pixel becomes the mean over n rays, a four-dimensional Sobol set: two dimensions in
//      the pixel's square, two mapped concentrically to the aperture.
//   4. The image is convolved with pixel box (*) Airy pattern, sampled at the pixel pitch and cut
//      at 5 px.
//
// Made as fast as it goes without changing what it computes: vectorised over rays and pixels in
// single precision (a ray is off by less than 1e-3 px), with dispatch to the widest instruction set
// of the machine. Kept between frames, per camera: the ray set (one Owen scramble of it, which is
// nearer to the truth than the plain one) and the kernel's weights.
#pragma once

#include "calib/camera/camera_model.h"
#include "sim/scene/scene.h"

namespace etalon {

namespace published {

struct Camera {
    float inverse_fx, inverse_fy, cx, cy;
    float k[12];  // k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4
};

// One number per ray of a pixel: its offset in px, its lens point in mm.
struct Rays {
    std::vector<float> pixel_x, pixel_y, lens_x, lens_y;
};

// The sum over the taps t of weight[t] * image[i + offset[t]].
struct Taps {
    std::vector<std::ptrdiff_t> offset;
    std::vector<float> weight;
};

}  // namespace published

struct PublishedImage {
    Radiance radiance;    // CV_32FC1, the camera's size
    int edge_pixels = 0;  // each cost n rays; those just outside the image included
};

// One per camera and number of rays. Any number of threads may call render(), which starts none.
class PublishedMethod {
public:
    // Undistorts each ray by the five steps, or all by the derivative at the pixel's centre.
    enum class Undistortion { per_ray, linearised };

    // Throws NumericalError for a camera without an image, a tilted sensor (tau_x, tau_y), a number
    // of rays that is not a power of two from 64 to 65536, and as thin_lens() and
    // PointSpreadFunction::of() do. Takes about 10 ms.
    PublishedMethod(const CameraModel& camera, int rays_per_pixel, Undistortion undistortion);

    // Markers that turn their back to the lens are not seen; parts behind it neither.
    // Throws NumericalError as check_scene() does. Cost: a few ns per pixel and about 2 ns per ray.
    PublishedImage render(const Scene& scene) const;

    // OpenCV's undistortion of the pixels (x[i], y): five fixed-point steps.
    struct Points {
        std::vector<float> x, y;
    };
    Points undistorted(std::vector<float> x, float y) const;

private:
    struct Frame;
    void make_rays(int count);
    void make_kernel();
    void mark_row(Frame& frame, int y) const;
    int refine(Frame& frame) const;
    void refine_linearised(Frame& frame, int y, const std::vector<int>& columns) const;
    Radiance convolved(const Frame& frame) const;

    CameraModel camera_;
    Undistortion undistortion_;
    published::Camera kernel_camera_;
    double lens_radius_mm_ = 0.0, inverse_focus_per_mm_ = 0.0;
    published::Rays rays_;
    published::Taps taps_;
};

}  // namespace etalon
