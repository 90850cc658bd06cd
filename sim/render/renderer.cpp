#include "sim/render/renderer.h"

#include <fmt/format.h>
#include <sys/mman.h>

#include "core/program/errors.h"
#include "sim/render/reference_integrator.h"
#include "sim/render/render_sampling.h"
#include "sim/render/sensor_map.h"
#include "sim/render/wave_render.h"

namespace etalon {

// A wide lens is evaluated for every marker.
struct Renderer::Cache {
    explicit Cache(const CameraModel& model)
        : camera(model),
          projector(model),
          aperture(aperture_of(model)),
          filter(is_wave(model) ? without_lens(model) : model),
          box_filter(without_lens(model)),
          bound(filter.point_spread()) {
        if (model.projection.is_flat())
            along_axis.emplace(filter, projector, cv::Rect(0, 0, model.width, model.height));
        valid = along_axis ? valid_mask(model, along_axis->rays) : valid_mask(projector);
        invalid_pixels = static_cast<int>(valid.total()) - cv::countNonZero(valid);
        if (is_wave(model))
            wave.emplace(model);
    }

    static bool is_wave(const CameraModel& model) {
        return model.lens && model.lens->psf.kind == PointSpread::Kind::wave;
    }

    static CameraModel without_lens(CameraModel model) {
        model.lens.reset();
        return model;
    }

    CameraModel camera;
    Projector projector;
    Aperture aperture;
    ImageFilter filter, box_filter;
    std::optional<WaveFilter> wave;  // in place of both
    SamplingBound bound;
    std::optional<SensorMap> along_axis;  // of a flat projection
    cv::Mat valid;
    int invalid_pixels;
};

namespace {

cv::Rect checked_region(const CameraModel& camera, const RenderOptions& options) {
    if (!std::isfinite(options.tolerance_gray) || !(options.tolerance_gray > 0.0))
        throw NumericalError(
            fmt::format("a render cannot have the tolerance {} gray", options.tolerance_gray));
    if (options.samples_per_side < 0 || options.samples_per_side > 48)
        throw NumericalError(fmt::format("{} samples a pixel side are not between 1 and 48",
                                         options.samples_per_side));
    const cv::Rect image(0, 0, camera.width, camera.height);
    if (options.region.empty())
        return image;
    if ((options.region & image) != options.region)
        throw NumericalError(fmt::format("the region {}x{} at ({}, {}) is not inside the image",
                                         options.region.width, options.region.height,
                                         options.region.x, options.region.y));
    return options.region;
}

// Largest difference of two cells that share an edge, the background around the grid included.
double largest_step(const MarkerView& view) {
    double largest = 0.0;
    for (int j = -1; j < view.rows(); ++j)
        for (int i = -1; i < view.columns(); ++i) {
            const double cell = view.cell(i, j);
            largest = std::max({largest, std::abs(view.cell(i + 1, j) - cell),
                                std::abs(view.cell(i, j + 1) - cell)});
        }
    return largest;
}

// At least the area of the marker's image: of the box around its outline, blur included.
double area_around(const std::vector<Eigen::Vector2d>& outline, double blur_px) {
    if (outline.empty())
        return std::numeric_limits<double>::infinity();
    Eigen::Array2d low = outline.front(), high = low;
    for (const Eigen::Vector2d& pixel : outline) {
        low = low.min(pixel.array());
        high = high.max(pixel.array());
    }
    return (high - low + 2.0 * blur_px + 1.0).prod();
}

// A cell's side in the shortest of the outline's four sides; 0 without an outline.
double shortest_cell(const std::vector<Eigen::Vector2d>& outline, const MarkerView& view) {
    if (outline.empty())
        return 0.0;
    const std::size_t per_side = outline.size() / 4;
    double shortest = std::numeric_limits<double>::infinity();
    for (std::size_t side = 0; side < 4; ++side) {
        const double length =
            (outline[side * per_side] - outline[(side + 1) * per_side - 1]).norm();
        shortest = std::min(shortest, length / (side % 2 == 0 ? view.columns() : view.rows()));
    }
    return shortest;
}

cv::Rect tiles_around(const std::vector<Eigen::Vector2d>& outline, double blur_px,
                      const UndistortionMap& map) {
    const cv::Rect tiles = map.tiles();
    const cv::Rect pixels(tile_px * tiles.tl(), tile_px * tiles.br());
    const double margin = std::min(blur_px, 1e6) + tile_px;
    return cells_of(pixels_around(outline, Eigen::Array2d::Constant(margin), pixels), tile_px);
}

// The blur as the sensor sees it, shrunk and magnified by the distortion: of the groups of these
// tiles that see the marker.
BlurRange distorted_blur(const BlurRange& blur, const MarkerView& view, const UndistortionMap& map,
                         const cv::Rect& tiles) {
    constexpr int level = UndistortionMap::block_level, side = UndistortionMap::block_side;
    const Intrinsics& intrinsics = map.projector().camera().intrinsics;
    const double smaller = view.aperture().radius_mm * std::min(intrinsics.fx, intrinsics.fy);
    const double larger = view.aperture().radius_mm * std::max(intrinsics.fx, intrinsics.fy);
    const cv::Rect groups = cells_of(tiles, side) & map.groups(level);
    BlurRange result{std::numeric_limits<double>::infinity(), 0.0};
    for (int j = groups.y; j < groups.br().y; ++j)
        for (int i = groups.x; i < groups.br().x; ++i) {
            const Box& box = map.group(level, i, j).bounds;
            if (map.group(level, i, j).validity == UndistortionMap::Validity::none ||
                !view.footprint(box))
                continue;
            const auto bend = map.bend(level, i, j);
            result.smallest_px =
                std::min(result.smallest_px,
                         bend.least_scale *
                             std::max(blur.smallest_px, smaller * view.smallest_defocus(box)));
            result.largest_px = std::max(
                result.largest_px,
                bend.largest_scale * std::min(blur.largest_px, larger * view.largest_defocus(box)));
        }
    return result.largest_px > 0.0 ? result : blur;
}

// The directions that grid lines have anywhere in the image: those of two opposite sides and
// everything in between, for both pairs of sides.
EdgeTangents tangents_of(const std::vector<Eigen::Vector2d>& outline) {
    EdgeTangents tangents;
    if (outline.empty())
        return tangents.set();
    constexpr std::size_t stride = 2;  // the margin below holds what lies between
    const std::size_t per_side = outline.size() / 4;
    for (const std::size_t pair : {0, 1}) {
        double first = 0.0, least = 0.0, most = 0.0;
        for (const std::size_t side : {pair, pair + 2})
            for (std::size_t n = 0; n + stride < per_side; n += stride) {
                const Eigen::Vector2d step =
                    outline[side * per_side + n + stride] - outline[side * per_side + n];
                const double angle = std::atan2(step.y(), step.x());
                if (side == pair && n == 0)
                    first = angle;
                // Modulo half a turn.
                const double from_first = std::remainder(angle - first, std::numbers::pi);
                least = std::min(least, from_first);
                most = std::max(most, from_first);
            }
        constexpr double margin = 0.02, step = 0.005;
        for (double turn = least - margin; turn < most + margin + step; turn += step) {
            const double across = std::abs(std::sin(first + turn));
            const double along = std::abs(std::cos(first + turn));
            const double tangent = std::min(across, along) / std::max(across, along);
            tangents.set(static_cast<std::size_t>(std::lround(tangent_steps * tangent)));
        }
    }
    return tangents;
}

// Of a scene of several markers: their extremes and sums.
void merge(const RenderPlan& one, RenderPlan& all) {
    if (all.sampling_gray < one.sampling_gray)
        all.method = one.method;
    all.points_per_pixel_side = std::max(all.points_per_pixel_side, one.points_per_pixel_side);
    all.sampling_gray = std::max(all.sampling_gray, one.sampling_gray);
    all.border_gray = std::max(all.border_gray, one.border_gray);
    all.min_blur_radius_px = std::min(all.min_blur_radius_px, one.min_blur_radius_px);
    all.max_blur_radius_px = std::max(all.max_blur_radius_px, one.max_blur_radius_px);
    all.tail_reach_px = std::max(all.tail_reach_px, one.tail_reach_px);
    for (const NeglectedBound& left : one.left_out) {
        const auto same = std::ranges::find(all.left_out, left.what, &NeglectedBound::what);
        if (same == all.left_out.end())
            all.left_out.push_back(left);
        else if (left.gray > same->gray)
            *same = left;
    }
    all.used.insert(all.used.end(), one.used.begin(), one.used.end());
    all.uniform_tiles = std::min(all.uniform_tiles, one.uniform_tiles);
}

// Large frames in huge pages, where the system has them: with pages of 4 KiB a frame of 20 MB takes
// 5000 page faults when it is new. Only advice, and only for whole huge pages within the frame.
void advise_huge_pages(const cv::Mat& pixels) {
    constexpr std::uintptr_t page = 2 << 20;
    const auto begin = reinterpret_cast<std::uintptr_t>(pixels.datastart);
    const auto end = reinterpret_cast<std::uintptr_t>(pixels.dataend);
    const std::uintptr_t first = (begin + page - 1) / page * page, last = end / page * page;
    if (first < last)
        madvise(reinterpret_cast<void*>(first), last - first, MADV_HUGEPAGE);
}

void check_background(const Radiance& background, const cv::Size& size) {
    if (background.type() != CV_32FC1 || background.size() != size)
        throw NumericalError(fmt::format("a background of {} x {} px for an image of {} x {} px",
                                         background.cols, background.rows, size.width,
                                         size.height));
    if (!cv::checkRange(background))
        throw NumericalError("the background's radiance is not finite everywhere");
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

// One marker's difference from the background, added to the region's pixels.
class Renderer::MarkerRender {
public:
    MarkerRender(const Cache& cache, const Scene& scene, const PlacedMarker& marker,
                 const RenderOptions& options)
        : cache_(cache),
          turn_(turn_towards(marker, cache.camera)),
          view_(cache.along_axis ? marker : turned(marker, turn_), scene.background,
                cache.aperture),
          own_sensor_(cache.along_axis
                          ? nullptr
                          : sensor_towards(cache.projector.turned(turn_), cache.filter, view_)),
          sensor_(cache.along_axis ? *cache.along_axis : *own_sensor_),
          outline_(marker_outline(view_, sensor_.rays.projector(), 31)),
          all_refined_(options.keeps(NeglectedEffect::uniform_tiles)) {
        const BlurRange blur = blur_over_marker(view_, cache.camera.intrinsics);
        const cv::Rect tiles = tiles_around(outline_, blur.largest_px, sensor_.rays);
        const Eigen::Vector2d middle(0.0, 0.0), slope = view_.defocus_slope(middle);
        const ImageExtremes image{
            blur,
            distorted_blur(blur, view_, sensor_.rays, tiles),
            view_.aperture().radius_mm * slope.norm(),
            view_.aperture().radius_mm * (slope - view_.turn(middle)).norm(),
            largest_step(view_),
            view_.contrast(),
            area_around(outline_, blur.largest_px),
            shortest_cell(outline_, view_),
            tangents_of(outline_),
            sensor_.rays.bend(tiles),
            blur.largest_px <= WedgeTable::largest_blur_px && is_far_from_border(blur.largest_px),
            static_cast<int>(scene.markers.size())};
        chosen_ = choose_sampling(image, cache.filter, cache.bound, options);
        chosen_.plan.instructions = tile_kernel_target();
        if (images_lines_straight(cache.camera))
            chosen_.plan.left_out.push_back(
                {NeglectedEffect::distortion, "the calibration has no distortion", 0.0});
    }

    const RenderPlan& plan() const { return chosen_.plan; }

    // Evaluates what the region's pixels see of the marker; returns those that may differ from the
    // background.
    cv::Rect sample(const cv::Rect& region) {
        constexpr double max_px = 1e5;
        samples_.emplace(view_, sensor_.rays, sampled_tiles(region, cache_.filter.reach_px()),
                         chosen_.sampling, all_refined_);
        RenderPlan& plan = chosen_.plan;
        plan.used = samples_->used();
        plan.uniform_tiles = samples_->tiles().area();
        for (const TileUse& use : plan.used)
            plan.uniform_tiles -= use.tiles;
        if (!all_refined_)
            plan.left_out.push_back({NeglectedEffect::uniform_tiles,
                                     fmt::format("{} of {} tiles see one radiance",
                                                 plan.uniform_tiles, samples_->tiles().area()),
                                     0.0});
        const int reach = static_cast<int>(std::ceil(
            std::min(std::max<double>(cache_.filter.reach_px(), plan.tail_reach_px), max_px)));
        sources_ = sensor_.tail.sources(*samples_, view_, outline_, grown(region, reach, reach));
        return sources_.empty() ? cv::Rect() : grown(sources_, reach, reach) & region;
    }

    // Adds to the pixels; with a `background`, writes them, whatever was there. Without one, what
    // the marker adds far from itself is left in `far`.
    void draw(const cv::Rect& region, std::optional<float> background, FarTail& far,
              cv::Mat& pixels) {
        const ImageFilter& filter = chosen_.with_spread ? cache_.filter : cache_.box_filter;
        const FilterKernel& core = filter.core(chosen_.sampling.k, chosen_.sampling.kind);
        const auto add_core = [&](const cv::Rect& band) {
            add_filtered(samples_->field(), core, region, band, pixels);
            samples_->add_edges(region, band, pixels);
        };
        if (plan().tail_reach_px > 0.0)
            return sensor_.tail.add(*samples_, view_, sources_, plan().tail_reach_px,
                                    chosen_.finest_ring, region, background, far, pixels, add_core);
        if (background)
            set_outside({}, region, *background, pixels);
        for_each_band(region, add_core);
    }

private:
    // So far that a table of corners sees nothing of it: tiles there count as thrice their size.
    bool is_far_from_border(double blur_px) const {
        constexpr double farthest_px = 3 * 3 * tile_px;
        const cv::Rect around = tiles_around(outline_, blur_px + farthest_px, sensor_.rays);
        return sensor_.rays.bend(around).is_polynomial;
    }

    // With a margin for the filter, in whole squares of the tail's first grids.
    static cv::Rect sampled_tiles(const cv::Rect& region, int reach_px) {
        constexpr int square_px = 2 * tile_px;
        const cv::Rect squares = cells_of(grown(region, reach_px, reach_px), square_px);
        return {2 * squares.x, 2 * squares.y, 2 * squares.width, 2 * squares.height};
    }

    const Cache& cache_;
    Eigen::Quaterniond turn_;  // of a wide lens
    MarkerView view_;
    std::unique_ptr<const SensorMap> own_sensor_;  // of a wide lens
    const SensorMap& sensor_;
    std::vector<Eigen::Vector2d> outline_;
    bool all_refined_;
    RenderSampling chosen_;
    std::optional<TileSamples> samples_;
    cv::Rect sources_;  // pixels outside of which the marker is not
};

Renderer::Drawn Renderer::draw_markers(const Scene& scene, const RenderOptions& options,
                                       const cv::Rect& region, const Canvas& canvas) const {
    if (options.method == RenderMethod::wave)
        throw NumericalError("the wave-optical method needs a camera with that point spread");
    const bool is_reference = options.method == RenderMethod::reference;
    const auto background = static_cast<float>(scene.background);
    Drawn drawn;
    if (scene.markers.empty())
        canvas({});
    FarTail far(cache_->filter, region);
    for (const PlacedMarker& placed : scene.markers) {
        MarkerRender marker(*cache_, scene, placed, options);
        const bool first = &placed == &scene.markers.front();
        const cv::Rect seen = is_reference ? region : marker.sample(region);
        if (first) {
            drawn.region = scene.markers.size() == 1 ? seen : region;
            drawn.pixels = canvas(drawn.region);
        }
        if (!is_reference)
            marker.draw(drawn.region, first ? std::optional(background) : std::nullopt, far,
                        drawn.pixels);
        if (first)
            drawn.plan = marker.plan();
        else
            merge(marker.plan(), drawn.plan);
    }
    far.add_to(drawn.pixels);
    return drawn;
}

// Of the one marker that check_wave_scene() allows.
Renderer::Drawn Renderer::draw_wave(const Scene& scene, const RenderOptions& options,
                                    const cv::Rect& region, const Canvas& canvas) const {
    if (options.method == RenderMethod::exact_lens || options.method == RenderMethod::exact_area)
        throw NumericalError("E and C do not know the wave-optical point spread");
    check_wave_scene(scene, cache_->camera);
    const MarkerView view(scene.markers.front(), scene.background, cache_->aperture);
    Drawn drawn{region, canvas(region), {}};
    set_outside({}, region, static_cast<float>(scene.background), drawn.pixels);
    if (options.method != RenderMethod::reference)
        drawn.pixels += wave_difference(view, cache_->along_axis->rays, *cache_->wave, region,
                                        options.tolerance_gray, options.stop);
    const BlurRange blur = blur_over_marker(view, cache_->camera.intrinsics);
    const bool is_reference = options.method == RenderMethod::reference;
    drawn.plan = {.method = is_reference ? RenderMethod::reference : RenderMethod::wave,
                  .tolerance_gray = options.tolerance_gray,
                  .min_blur_radius_px = blur.smallest_px,
                  .max_blur_radius_px = blur.largest_px};
    return drawn;
}

RenderPlan Renderer::draw(const Scene& scene, const RenderOptions& options,
                          const Canvas& canvas) const {
    const cv::Rect region = checked_region(cache_->camera, options);
    check_scene(scene);
    check_reach(scene, cache_->camera);
    if (scene.markers.size() > 1)
        check_no_occlusion(scene, cache_->camera);
    Drawn drawn = cache_->wave ? draw_wave(scene, options, region, canvas)
                               : draw_markers(scene, options, region, canvas);
    if (drawn.region.empty())
        return drawn.plan;
    if (options.method == RenderMethod::reference)
        integrate_reference(cache_->camera, scene, region,
                            {.scrambles = 8,
                             .samples_per_scramble = options.reference_samples / 8,
                             .stop_at_gray = options.tolerance_gray,
                             .stop = options.stop})
            .mean.copyTo(drawn.pixels);
    if (cache_->invalid_pixels > 0)
        drawn.pixels.setTo(scene.background, cache_->valid(drawn.region) == 0);
    return drawn.plan;
}

RenderedImage Renderer::render(const Scene& scene, const RenderOptions& options) const {
    RenderedImage image;
    image.valid = cache_->valid;
    const cv::Rect all({0, 0}, cache_->valid.size());
    image.plan = draw(scene, options, [&](const cv::Rect& seen) {
        image.radiance.create(all.size(), CV_32FC1);
        advise_huge_pages(image.radiance);
        set_outside(seen, all, static_cast<float>(scene.background), image.radiance);
        return image.radiance(seen);
    });
    return image;
}

RenderedPart Renderer::render_part(const Scene& scene, const RenderOptions& options) const {
    RenderedPart part;
    part.background = scene.background;
    part.plan = draw(scene, options, [&](const cv::Rect& seen) {
        part.region = seen;
        return part.radiance = cv::Mat(seen.size(), CV_32FC1);
    });
    return part;
}

Radiance placed_over(const Radiance& markers, const Radiance& coverage,
                     const Radiance& background) {
    check_background(background, markers.size());
    check_background(coverage, markers.size());
    return markers + (background - background.mul(coverage));
}

Scene on_black(const Scene& scene) {
    return {scene.markers, 0.0};
}

Scene white_on_black(const Scene& scene) {
    Scene white = on_black(scene);
    for (auto& [grid, pose] : white.markers) {
        const Eigen::Vector2d cells(grid.columns(), grid.rows());
        grid = {cv::Mat(1, 1, CV_32FC1, cv::Scalar(1.0)), grid.corner_mm,
                grid.cell_mm.cwiseProduct(cells)};
    }
    return white;
}

RenderedImage render_over(const Renderer& renderer, const Scene& scene, const Radiance& background,
                          const RenderOptions& options) {
    const CameraModel& camera = renderer.camera();
    check_background(background, {camera.width, camera.height});
    RenderOptions shared = options;  // an error of C counts with the background's radiance
    shared.tolerance_gray /= 1.0 + cv::norm(background, cv::NORM_INF);
    RenderedImage image = renderer.render(on_black(scene), shared);
    const RenderedImage coverage = renderer.render(white_on_black(scene), shared);
    image.radiance = placed_over(image.radiance, coverage.radiance, background);
    return image;
}

Radiance background_from(const CodeImage& image, const SensorModel& sensor) {
    Radiance radiance = sensor.linear_radiance(image);
    const cv::Mat& response = sensor.relative_response();
    if (response.empty())
        return radiance;
    if (response.size() != radiance.size())
        throw NumericalError(fmt::format("an image of {} x {} px is not the camera's",
                                         radiance.cols, radiance.rows));
    cv::divide(radiance, response, radiance);
    return radiance;
}

}  // namespace etalon
