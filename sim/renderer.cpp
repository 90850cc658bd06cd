#include "sim/renderer.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "core/errors.h"
#include "sim/far_tail.h"
#include "sim/image_filter.h"
#include "sim/marker_view.h"
#include "sim/reference_integrator.h"
#include "sim/render_sampling.h"
#include "sim/tile_samples.h"
#include "sim/undistortion_map.h"

namespace etalon {
namespace {

constexpr int tile_px = UndistortionMap::tile_px;

// 255 where the pixel's centre has a ray.
cv::Mat valid_mask(const CameraModel& camera, const UndistortionMap& map) {
    cv::Mat valid(camera.height, camera.width, CV_8UC1);
    const cv::Rect image(0, 0, camera.width, camera.height);
    for (int j = 0; j * tile_px < camera.height; ++j)
        for (int i = 0; i * tile_px < camera.width; ++i) {
            const cv::Rect tile = cv::Rect(i * tile_px, j * tile_px, tile_px, tile_px) & image;
            const auto validity = map.validity(i, j);
            valid(tile).setTo(validity == UndistortionMap::Validity::all ? 255 : 0);
            if (validity != UndistortionMap::Validity::some)
                continue;
            for (int y = tile.y; y < tile.br().y; ++y)
                for (int x = tile.x; x < tile.br().x; ++x)
                    valid.at<uchar>(y, x) = map.projector().unproject({x, y}) ? 255 : 0;
        }
    return valid;
}

// The tiles that hold these pixels.
cv::Rect tiles_of(const cv::Rect& pixels) {
    const auto index = [](int px) {
        return px >= 0 ? px / tile_px : -((-px + tile_px - 1) / tile_px);
    };
    const int left = index(pixels.x), top = index(pixels.y);
    return {left, top, index(pixels.br().x - 1) - left + 1, index(pixels.br().y - 1) - top + 1};
}

cv::Rect grown(const cv::Rect& rect, int x, int y) {
    return {rect.x - x, rect.y - y, rect.width + 2 * x, rect.height + 2 * y};
}

// The pixels of all tiles that hold a pixel of the region.
cv::Rect tile_aligned(const cv::Rect& region) {
    const cv::Rect tiles = tiles_of(region);
    return {tiles.x * tile_px, tiles.y * tile_px, tiles.width * tile_px, tiles.height * tile_px};
}

// Scalar product in a fixed order, eight sums at a time so that it can be vectorised.
float dot(const float* a, const float* b, int n) {
    float sums[8] = {};
    int i = 0;
    for (; i + 8 <= n; i += 8)
        for (int q = 0; q < 8; ++q)
            sums[q] += a[i + q] * b[i + q];
    float sum = 0.0f;
    for (; i < n; ++i)
        sum += a[i] * b[i];
    for (const float s : sums)
        sum += s;
    return sum;
}

float filtered_pixel(const cv::Mat& samples, int x, int y, const cv::Mat& weights) {
    float sum = 0.0f;
    for (int row = 0; row < weights.rows; ++row)
        sum += dot(samples.ptr<float>(y + row) + x, weights.ptr<float>(row), weights.cols);
    return sum;
}

// Adds the core's part of every pixel of the region.
void add_core(const TileSamples& samples, const CoreKernel& core, const cv::Rect& region,
              cv::Mat& difference) {
    const int k = core.k;
    const int margin_x = (core.reach_x + k - 1) / k, margin_y = (core.reach_y + k - 1) / k;
    const auto energy = static_cast<float>(cv::sum(core.weights)[0]);
    const cv::Rect tiles = tiles_of(region);
    tbb::parallel_for(tbb::blocked_range<int>(tiles.y, tiles.br().y), [&](const auto& rows) {
        cv::Mat window((tile_px * k + 2 * core.reach_y), (tile_px * k + 2 * core.reach_x),
                       CV_32FC1);
        for (int j = rows.begin(); j < rows.end(); ++j)
            for (int i = tiles.x; i < tiles.br().x; ++i) {
                const cv::Rect tile(i * tile_px, j * tile_px, tile_px, tile_px);
                const cv::Rect part = tile & region;
                if (const auto value =
                        samples.constant(tiles_of(grown(tile, margin_x, margin_y)))) {
                    if (*value != 0.0f)
                        difference(part - region.tl()) += *value * energy;
                    continue;
                }
                const cv::Point first(tile.x * k - core.reach_x, tile.y * k - core.reach_y);
                samples.copy({first, window.size()}, window);
                for (int y = part.y; y < part.br().y; ++y)
                    for (int x = part.x; x < part.br().x; ++x)
                        difference.at<float>(y - region.y, x - region.x) += filtered_pixel(
                            window, (x - tile.x) * k, (y - tile.y) * k, core.weights);
            }
    });
}

// Averages over the pixels of some tiles.
cv::Mat pixel_means(const TileSamples& samples, const cv::Rect& tiles) {
    cv::Mat means(tiles.height * tile_px, tiles.width * tile_px, CV_32FC1);
    for (int j = 0; j < tiles.height; ++j)
        for (int i = 0; i < tiles.width; ++i) {
            const cv::Mat tile = means({i * tile_px, j * tile_px, tile_px, tile_px});
            samples.pixel_means(tiles.x + i, tiles.y + j, tile);
        }
    return means;
}

// Adds the part of the diffraction pattern between the core and the far tail, on pixel averages.
void add_near_tail(const TileSamples& samples, const cv::Mat& kernel, const cv::Rect& region,
                   cv::Mat& difference) {
    const cv::Rect tiles = samples.tiles_off_background();
    const cv::Rect sources(tiles.x * tile_px, tiles.y * tile_px, tiles.width * tile_px,
                           tiles.height * tile_px);
    const cv::Rect reached = grown(sources, kernel.cols / 2, kernel.rows / 2) & region;
    if (tiles.empty() || reached.empty())
        return;
    const cv::Rect all = sources | reached;
    cv::Mat means = cv::Mat::zeros(all.size(), CV_32FC1);
    pixel_means(samples, tiles).copyTo(means(sources - all.tl()));
    difference(reached - region.tl()) += convolve(means, kernel)(reached - all.tl());
}

}  // namespace

struct Renderer::Cache {
    explicit Cache(const CameraModel& model)
        : camera(model),
          aperture(aperture_of(model)),
          filter(model),
          map(Projector(model), filter.reach_px() + 2 * tile_px),
          valid(valid_mask(model, map)) {}

    CameraModel camera;
    Aperture aperture;
    ImageFilter filter;
    UndistortionMap map;
    cv::Mat valid;
};

namespace {

cv::Rect checked_region(const CameraModel& camera, const RenderOptions& options) {
    if (!std::isfinite(options.tolerance_gray) || !(options.tolerance_gray > 0.0))
        throw NumericalError(
            fmt::format("a render cannot have the tolerance {} gray", options.tolerance_gray));
    const cv::Rect image(0, 0, camera.width, camera.height);
    if (options.region.empty())
        return image;
    if ((options.region & image) != options.region)
        throw NumericalError(fmt::format("the region {}x{} at ({}, {}) is not inside the image",
                                         options.region.width, options.region.height,
                                         options.region.x, options.region.y));
    return options.region;
}

const CameraModel& checked_camera(const CameraModel& camera) {
    if (camera.width < 1 || camera.height < 1)
        throw NumericalError(
            fmt::format("no camera has an image of {} x {} px", camera.width, camera.height));
    return camera;
}

}  // namespace

Renderer::Renderer(const CameraModel& camera)
    : cache_(std::make_unique<const Cache>(checked_camera(camera))) {}
Renderer::~Renderer() = default;
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;

const CameraModel& Renderer::camera() const {
    return cache_->camera;
}

namespace {

// Everything but the far tail's margin: how far samples beyond the region matter.
cv::Rect sampled_tiles(const cv::Rect& region, const CoreKernel& core, int near_reach_px) {
    const int x = std::max(near_reach_px, (core.reach_x + core.k - 1) / core.k);
    const int y = std::max(near_reach_px, (core.reach_y + core.k - 1) / core.k);
    return tiles_of(grown(tile_aligned(region), x, y));
}

cv::Mat reference_difference(const CameraModel& camera, const Scene& scene,
                             const RenderOptions& options, const cv::Rect& region) {
    ReferenceOptions reference;
    reference.scrambles = 8;
    reference.samples_per_scramble = options.reference_samples / reference.scrambles;
    reference.stop_at_gray = options.tolerance_gray;
    const ReferenceImage image = integrate_reference(camera, scene, region, reference);
    return image.mean - scene.background;
}

}  // namespace

RenderedImage Renderer::render(const Scene& scene, const RenderOptions& options) const {
    const cv::Rect region = checked_region(cache_->camera, options);
    check_scene(scene);
    const MarkerView view(scene.markers.at(0), scene.background, cache_->aperture);
    const BlurRange blur = blur_over_marker(view, cache_->camera.intrinsics);
    const RenderSampling chosen = choose_sampling(blur, view.contrast(), cache_->filter, options);

    cv::Mat difference;
    if (options.method == RenderMethod::reference)
        difference = reference_difference(cache_->camera, scene, options, region);
    else
        difference = render_difference(view, chosen, region);

    RenderedImage image;
    image.radiance = cv::Mat(cache_->camera.height, cache_->camera.width, CV_32FC1,
                             cv::Scalar(scene.background));
    cv::Mat part = image.radiance(region);
    cv::add(part, difference, part, cache_->valid(region));
    image.valid = cache_->valid.clone();
    image.plan = chosen.plan;
    return image;
}

cv::Mat Renderer::render_difference(const MarkerView& view, const RenderSampling& chosen,
                                    const cv::Rect& region) const {
    const ImageFilter& filter = cache_->filter;
    const CoreKernel& core = filter.core(chosen.sampling.k, chosen.sampling.kind);
    const int near_reach = chosen.plan.near_tail ? filter.near_reach_px() : 0;
    const TileSamples samples(view, cache_->map, sampled_tiles(region, core, near_reach),
                              chosen.sampling);
    cv::Mat difference = cv::Mat::zeros(region.size(), CV_32FC1);
    add_core(samples, core, region, difference);
    if (chosen.plan.near_tail)
        add_near_tail(samples, filter.near_kernel(), region, difference);
    if (chosen.plan.far_tail_reach_px > 0.0)
        add_far_tail(view, cache_->map, filter, chosen.plan.far_tail_reach_px, region, difference);
    return difference;
}

}  // namespace etalon
