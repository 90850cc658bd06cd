#include "sim/render/wave_render.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "core/program/errors.h"
#include "sim/tiles/lens_average.h"

namespace etalon {
namespace {

double blur_radius_px(const MarkerView& view, const Projector& projector,
                      const Eigen::Vector2d& x) {
    const double radius =
        projector.camera().intrinsics.fx * view.aperture().radius_mm * std::abs(view.defocus(x));
    return std::min(radius, max_wave_blur_px);
}

// Box averages a pixel side, for a maximum of 0.1 gray: the areas under the pattern are sharp, so
// that only much blur allows for fewer.
int boxes_per_pixel_side(double least_blur_px) {
    return least_blur_px >= 4.0 ? 3 : least_blur_px >= 2.0 ? 5 : 9;
}

// The pixels that hold everything that the chief rays see of the marker.
cv::Rect marker_box(const MarkerView& view, const Projector& projector, const cv::Rect& limit) {
    constexpr int points_per_side = 64;
    const auto outline = marker_outline(view, projector, points_per_side);
    constexpr int far = 100'000'000;
    const cv::Rect box =
        pixels_around(outline, Eigen::Array2d::Zero(), {-far, -far, 2 * far, 2 * far});
    // Distortion may bulge a side out between two of its points.
    return pixels_around(outline, 5.0 + 0.02 * Eigen::Array2d(box.width, box.height), limit);
}

// Averages of the chief rays' radiance less the background over k x k boxes of each pixel.
struct BoxAverages {
    const MarkerView& view;
    const UndistortionMap& map;
    cv::Rect pixels;
    int k;

    cv::Mat values() const {
        cv::Mat averages = cv::Mat::zeros(pixels.height * k, pixels.width * k, CV_32FC1);
        const cv::Rect tiles = cells_of(pixels, tile_px);
        tbb::parallel_for(tiles.y, tiles.br().y, [&](int j) {
            CellCoverage coverage(view, lens_points(0.0, {1, 0}));
            std::vector<std::optional<MappedPoint>> points;
            for (int i = tiles.x; i < tiles.br().x; ++i)
                fill_tile(i, j, coverage, points, averages);
        });
        return averages;
    }

    void fill_tile(int i, int j, CellCoverage& coverage,
                   std::vector<std::optional<MappedPoint>>& points, cv::Mat& averages) const {
        const cv::Rect tile(i * tile_px, j * tile_px, tile_px, tile_px);
        const cv::Rect inside = tile & pixels;
        cv::Mat part = averages({(inside.x - pixels.x) * k, (inside.y - pixels.y) * k,
                                 inside.width * k, inside.height * k});
        const cv::Point first((inside.x - tile.x) * k, (inside.y - tile.y) * k);
        const bool is_mapped =
            map.tiles().contains({i, j}) && map.validity(i, j) == UndistortionMap::Validity::all;
        if (is_mapped) {
            const auto range = view.footprint(map.bounds(i, j));
            if (!range)
                return;
            if (const auto uniform = view.uniform_radiance(*range)) {
                part.setTo(*uniform - view.background());
                return;
            }
            map.sample(i, j, tile_px * k, points);
        }
        for (int y = 0; y < part.rows; ++y)
            for (int x = 0; x < part.cols; ++x) {
                const int column = first.x + x, row = first.y + y;
                const auto point =
                    is_mapped ? points[static_cast<std::size_t>(row * tile_px * k + column)]
                              : map.exact({tile.x - 0.5 + (column + 0.5) / k,
                                           tile.y - 0.5 + (row + 0.5) / k});
                part.at<float>(y, x) = average(point, coverage);
            }
    }

    float average(const std::optional<MappedPoint>& point, CellCoverage& coverage) const {
        if (!point)
            return 0.0f;
        const Eigen::Matrix2d sides = point->jacobian / k;
        const Eigen::Vector2d half = 0.5 * sides.cwiseAbs().rowwise().sum();
        const auto range = view.footprint({point->x - half, point->x + half});
        return range
                   ? static_cast<float>(coverage.over(point->x, sides, *range) - view.background())
                   : 0.0f;
    }
};

// Sums the window of averages around each pixel of a tile with the kernel of the tile's blur
// radius, interpolated between its neighbours.
struct Core {
    const WaveFilter& filter;
    cv::Mat averages;
    cv::Rect pixels;
    int k;

    void add(const cv::Rect& tile, double blur_radius_px, const cv::Rect& region,
             cv::Mat& difference) const {
        const int index = static_cast<int>(blur_radius_px / filter.blur_step_px());
        const cv::Size reach = filter.core_reach(k, index + 1);
        double part = blur_radius_px / filter.blur_step_px() - index;
        if (index == 0)
            part *= part;  // the pattern is even in the defocus
        const auto constant = constant_around(tile, reach);
        if (constant && *constant == 0.0)
            return;
        const cv::Mat kernel = kernel_between(index, part);
        if (constant) {
            difference(tile - region.tl()) += *constant * cv::sum(kernel)[0];
            return;
        }
        for (int y = tile.y; y < tile.br().y; ++y)
            for (int x = tile.x; x < tile.br().x; ++x)
                difference.at<float>(y - region.y, x - region.x) +=
                    static_cast<float>(product(kernel, reach, {x, y}));
    }

    // The value of all averages that the tile's pixels see, if they have one; outside the averages
    // it is 0.
    std::optional<double> constant_around(const cv::Rect& tile, const cv::Size& reach) const {
        const cv::Rect seen((tile.x - pixels.x) * k - reach.width,
                            (tile.y - pixels.y) * k - reach.height,
                            tile.width * k + 2 * reach.width, tile.height * k + 2 * reach.height);
        const cv::Rect met = seen & cv::Rect({0, 0}, averages.size());
        if (met.empty())
            return 0.0;
        double least = 0.0, most = 0.0;
        cv::minMaxLoc(averages(met), &least, &most);
        if (least != most || (met != seen && least != 0.0))
            return std::nullopt;
        return least;
    }

    // Of the size of the kernel above.
    cv::Mat kernel_between(int index, double part) const {
        const cv::Size reach = filter.core_reach(k, index + 1);
        const cv::Size less = filter.core_reach(k, index);
        const cv::Mat& below = filter.core(k, index);
        cv::Mat kernel = part * filter.core(k, index + 1);
        cv::Mat inner =
            kernel({{reach.width - less.width, reach.height - less.height}, below.size()});
        inner += (1.0 - part) * below;
        return kernel;
    }

    // The sum over a kernel centred on a pixel, as far as it meets the averages.
    double product(const cv::Mat& kernel, const cv::Size& reach, const cv::Point& pixel) const {
        const cv::Point first((pixel.x - pixels.x) * k - reach.width,
                              (pixel.y - pixels.y) * k - reach.height);
        const cv::Rect met = cv::Rect(first, kernel.size()) & cv::Rect({0, 0}, averages.size());
        return met.empty() ? 0.0 : kernel(met - first).dot(averages(met));
    }
};

// Convolution of `image` over `from` with a kernel of odd size, seen on `to`; by FFT.
cv::Mat convolved(const cv::Mat& image, const cv::Rect& from, const cv::Rect& to,
                  const cv::Mat& kernel) {
    const cv::Rect all = from | to;
    const cv::Size size(cv::getOptimalDFTSize(all.width + kernel.cols),
                        cv::getOptimalDFTSize(all.height + kernel.rows));
    cv::Mat a = cv::Mat::zeros(size, CV_32FC1), b = cv::Mat::zeros(size, CV_32FC1);
    image.copyTo(a(from - all.tl()));
    kernel.copyTo(b({{0, 0}, kernel.size()}));
    cv::dft(a, a);
    cv::dft(b, b);
    cv::mulSpectrums(a, b, a, 0);
    cv::dft(a, a, cv::DFT_INVERSE | cv::DFT_SCALE);
    return a(to - all.tl() + cv::Point(kernel.cols / 2, kernel.rows / 2)).clone();
}

// The blur radius of every pixel of the region; where there is no ray the least.
cv::Mat blur_radii(const MarkerView& view, const Projector& projector, const cv::Rect& region,
                   cv::Mat& has_ray) {
    cv::Mat radii(region.size(), CV_32FC1);
    has_ray = cv::Mat(region.size(), CV_8UC1, cv::Scalar(0));
    tbb::parallel_for(0, region.height, [&](int y) {
        for (int x = 0; x < region.width; ++x) {
            const auto seen = projector.unproject({x + region.x, y + region.y});
            has_ray.at<uchar>(y, x) = seen ? 255 : 0;
            radii.at<float>(y, x) =
                seen ? static_cast<float>(blur_radius_px(view, projector, *seen)) : 0.0f;
        }
    });
    return radii;
}

// Adds the tail, interpolated for each pixel between blur radii a pixel or less apart.
void add_tail(const WaveFilter& filter, const cv::Mat& means, const cv::Rect& pixels,
              const cv::Rect& region, const cv::Mat& radii, int reach, const std::stop_token& stop,
              cv::Mat& difference) {
    double least = 0.0, most = 0.0;
    cv::minMaxLoc(radii, &least, &most);
    const int levels = std::max(2, static_cast<int>(std::ceil(most - least)) + 1);
    const double step = std::max((most - least) / (levels - 1), 1e-3);
    const cv::Rect all = pixels | region;
    const auto tall = static_cast<int>(std::ceil(reach / filter.pitch_y()));
    const cv::Size half(std::min(all.width, reach), std::min(all.height, tall));
    for (int level = 0; level < levels; ++level) {
        throw_if_stopped(stop);
        const double blur = least + level * step;
        const cv::Mat share = cv::max(1.0 - cv::abs(radii - blur) / step, 0.0);
        if (cv::countNonZero(share) == 0)
            continue;
        difference += convolved(means, pixels, region, filter.tail(blur, half)).mul(share);
    }
}

}  // namespace

void check_wave_scene(const Scene& scene, const CameraModel& camera) {
    if (!camera.projection.is_flat())
        throw NumericalError(
            fmt::format("psf wave: of a flat projection only, whose pattern is round "
                        "on the sensor, not one that is {}",
                        name_of(camera.projection.kind).name));
    if (scene.markers.size() != 1)
        throw NumericalError(fmt::format("psf wave: needs a scene with exactly one marker, not {}",
                                         scene.markers.size()));
    const MarkerView view(scene.markers.front(), scene.background, aperture_of(camera));
    const double largest = blur_over_marker(view, camera.intrinsics).largest_px;
    if (!(largest <= max_wave_blur_px))
        throw NumericalError(
            fmt::format("psf wave: the marker's blur radius of {:.4g} px is above {:.4g} "
                        "px; use psf: ideal, which is right there",
                        largest, max_wave_blur_px));
}

cv::Mat wave_difference(const MarkerView& view, const UndistortionMap& map,
                        const WaveFilter& filter, const cv::Rect& region, double tolerance_gray,
                        const std::stop_token& stop) {
    const Projector& projector = map.projector();
    const CameraModel& camera = projector.camera();
    const double contrast = std::max(view.contrast(), 1e-6);
    const double omitted = 0.5 * tolerance_gray / (255.0 * contrast);
    const double wide =
        2.0 * filter.lambda_n_px() / (std::numbers::pi * std::numbers::pi * omitted);
    const int reach = static_cast<int>(std::clamp(wide, 64.0, 1e4));
    const int k = boxes_per_pixel_side(blur_over_marker(view, camera.intrinsics).smallest_px);

    cv::Mat has_ray;
    const cv::Mat radii = blur_radii(view, projector, region, has_ray);
    cv::Mat difference = cv::Mat::zeros(region.size(), CV_32FC1);
    const cv::Rect far = marker_box(view, projector, grown(region, reach, reach));
    if (far.empty())
        return difference;
    add_tail(filter, BoxAverages{view, map, far, 1}.values(), far, region, radii, reach, stop,
             difference);

    double most = 0.0;
    cv::minMaxLoc(radii, nullptr, &most);
    const cv::Size core = filter.core_reach(k, static_cast<int>(most / filter.blur_step_px()) + 1);
    const cv::Rect near = far & grown(region, core.width / k + 1, core.height / k + 1);
    const Core sums{filter, BoxAverages{view, map, near, k}.values(), near, k};
    const cv::Rect reached = region & grown(near, core.width / k + 1, core.height / k + 1);
    tbb::parallel_for(0, (reached.height + tile_px - 1) / tile_px, [&](int j) {
        for (int x = reached.x; x < reached.br().x; x += tile_px) {
            throw_if_stopped(stop);
            const cv::Rect tile = cv::Rect(x, reached.y + j * tile_px, tile_px, tile_px) & reached;
            const cv::Point middle(tile.x + tile.width / 2 - region.x,
                                   tile.y + tile.height / 2 - region.y);
            sums.add(tile, radii.at<float>(middle), region, difference);
        }
    });
    difference.setTo(0.0, has_ray == 0);
    return difference;
}

}  // namespace etalon
