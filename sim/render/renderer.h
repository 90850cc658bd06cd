// Renders a planar marker as a camera sees it, in linear radiance: distortion, thin-lens defocus,
// diffraction, pixel integration (docs/rendering.md). The sensor: sim/sensor/sensor_model.h.
#pragma once

#include <stop_token>

#include "sim/scene/scene.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {

struct RenderOptions {
    RenderMethod method = RenderMethod::automatic;
    // Largest error aimed at, in gray = 1/255 of linear full scale.
    double tolerance_gray = 0.1;
    // Forces k of the closed-form methods, 1..48; 0: chosen from bounds.
    int samples_per_side = 0;
    // Part of the image to render; empty: all of it. The rest of the result is background.
    cv::Rect region;
    // What must not be left out even where the scene does not need it: to check the bounds.
    std::vector<NeglectedEffect> keep;
    bool keeps(NeglectedEffect what) const {
        return std::find(keep.begin(), keep.end(), what) != keep.end();
    }
    // Of RenderMethod::reference: at most this many samples a pixel, a power of two of at least 8;
    // a pixel stops early when its standard error is below tolerance_gray.
    int reference_samples = 1024;
    // Ends a reference or a wave-optical render, in less than 0.5 s: Interrupted is thrown.
    std::stop_token stop = {};
};

// One per camera: holds its undistortion map, filters and bounds. Safe from every thread.
class Renderer {
public:
    explicit Renderer(const CameraModel& camera);
    ~Renderer();
    Renderer(Renderer&&) noexcept;
    Renderer& operator=(Renderer&&) noexcept;

    // About a ms for a marker of 50 px in VGA (docs/performance.md); the first of a kind makes its
    // filter. Parallel, the same bytes for any number of threads. Throws NumericalError when a
    // marker's plane passes through the lens, a seen part is behind it, markers may hide each other
    // (sim/scene/scene.h), an input is not finite, or the tolerance cannot be met.
    RenderedImage render(const Scene& scene, const RenderOptions& options = {}) const;

    // The same pixels, of the part only that is not background: an eighth less time for a small
    // marker in a VGA image.
    RenderedPart render_part(const Scene& scene, const RenderOptions& options = {}) const;

    const CameraModel& camera() const;

private:
    struct Cache;
    class MarkerRender;

    // Gives the pixels to be drawn into, for the rectangle of those that see a marker.
    using Canvas = std::function<cv::Mat(const cv::Rect&)>;
    struct Drawn {
        cv::Rect region;
        cv::Mat pixels;
        RenderPlan plan;
    };

    RenderPlan draw(const Scene& scene, const RenderOptions& options, const Canvas& canvas) const;
    Drawn draw_markers(const Scene& scene, const RenderOptions& options, const cv::Rect& region,
                       const Canvas& canvas) const;
    Drawn draw_wave(const Scene& scene, const RenderOptions& options, const cv::Rect& region,
                    const Canvas& canvas) const;

    std::unique_ptr<const Cache> cache_;
};

// Markers before an image, M + (1 - C) B by pixel: M is the markers on black, C their coverage (all
// white on black), B the background as the camera sees it, blur included; CV_32FC1 of one size.
// Exact where B is even across an edge's blur. Throws NumericalError for different sizes or types,
// and B not finite.
Radiance placed_over(const Radiance& markers, const Radiance& coverage, const Radiance& background);

// The scene without its own background, and its markers as one white cell each.
Scene on_black(const Scene& scene);
Scene white_on_black(const Scene& scene);

// Two renders, each with its share of the tolerance, put together as above. `scene.background` is
// not used; the background must have the camera's size. The plan is that of M. Throws as render()
// and placed_over() do.
RenderedImage render_over(const Renderer& renderer, const Scene& scene, const Radiance& background,
                          const RenderOptions& options = {});

// The radiance before the sensor that gives these code values, relative response undone: what
// SensorModel::expose() turns into the same image again (to a code). A saturated code is full
// scale. Throws NumericalError unless the image has the sensor's size and bit depth.
Radiance background_from(const CodeImage& image, const SensorModel& sensor);

}  // namespace etalon
