// Renders a planar marker as a given camera would see it, in linear radiance: full distortion,
// thin-lens defocus, diffraction, pixel integration. The sensor is in sim/sensor_model.h.
//
// Two closed-form methods and the brute-force reference (sim/reference_integrator.h):
//   exact_lens  (E): the aperture average at a point of the sensor is exact; k x k points a pixel,
//                    then one filter, pixel box convolved with the diffraction pattern.
//   exact_area  (C): the pixel's area in each cell is exact, at a few lens points; for (nearly)
//                    sharp images.
// Method and errors: docs/rendering.md.
#pragma once

#include <limits>
#include <memory>
#include <string>

#include "calib/camera_model.h"
#include "core/image.h"
#include "sim/scene.h"

namespace etalon {

class MarkerView;
struct RenderSampling;

enum class RenderMethod { automatic, exact_lens, exact_area, reference };

struct RenderOptions {
    RenderMethod method = RenderMethod::automatic;
    // Largest error aimed at, in gray = 1/255 of linear full scale.
    double tolerance_gray = 0.1;
    // Forces k of the closed-form methods, 1..32; 0: chosen from bounds.
    int samples_per_side = 0;
    // Part of the image to render; empty: all of it. The rest of the result is background.
    cv::Rect region;
    // Of RenderMethod::reference: at most this many samples a pixel, a power of two of at least 8;
    // a pixel stops early when its standard error is below tolerance_gray. Statistical error of a
    // whole image and time: docs/rendering.md.
    int reference_samples = 1024;
};

// What was done, for the record. Each omission stands with the bound that justified it.
struct RenderPlan {
    RenderMethod method = RenderMethod::automatic;  // the one used: never automatic
    int points_per_pixel_side = 1;                  // k
    int lens_points = 1;                            // of exact_area
    double min_blur_radius_px = 0.0;                // over the marker; 0 where it is in focus
    double max_blur_radius_px = 0.0;
    // exact_area where the marker's plane of sharp focus crosses the marker: tiles blurred by more
    // than this take exact lens averages instead; infinite: none does.
    double exact_lens_from_px = std::numeric_limits<double>::infinity();
    bool near_tail = false;          // diffraction beyond the core, on a 1-px grid
    double far_tail_reach_px = 0.0;  // and beyond that, on an 8-px grid; 0: left out
    double omitted_tail_gray = 0.0;  // no pixel is off by more for the tail that was left out

    std::string describe() const;  // one line for people
};

struct RenderedImage {
    Radiance radiance;  // CV_32FC1, the camera's size
    // CV_8UC1: 255 where the pixel's ray exists, 0 outside the distortion model's valid region
    // (there the radiance is the background's).
    cv::Mat valid;
    RenderPlan plan;
};

// One per camera: holds its undistortion map and filters. Safe from every thread once built.
class Renderer {
public:
    explicit Renderer(const CameraModel& camera);
    ~Renderer();
    Renderer(Renderer&&) noexcept;
    Renderer& operator=(Renderer&&) noexcept;

    // Takes tens of ms for a marker of 100 px in a VGA image; parallel, and the same bytes for any
    // number of threads.
    // Throws NumericalError when the marker's plane passes through the lens or part of the marker
    // that would be seen is behind it, when an input is not finite, or the tolerance cannot be met.
    RenderedImage render(const Scene& scene, const RenderOptions& options = {}) const;

    const CameraModel& camera() const;

private:
    struct Cache;
    cv::Mat render_difference(const MarkerView& view, const RenderSampling& chosen,
                              const cv::Rect& region) const;

    std::unique_ptr<const Cache> cache_;
};

}  // namespace etalon
