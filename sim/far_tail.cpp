#include "sim/far_tail.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <opencv2/imgproc.hpp>

#include "sim/lens_average.h"

namespace etalon {
namespace {

constexpr int block_px = ImageFilter::block_px;

// The smallest rectangle of pixels that surely holds the marker's image, blur included, grown by a
// block; the whole of `limit` where the marker reaches beyond the valid region.
cv::Rect marker_box(const MarkerView& view, const UndistortionMap& map, const cv::Rect& limit) {
    constexpr int points_per_edge = 64;
    const Projector& projector = map.projector();
    Eigen::Array2d low = Eigen::Array2d::Constant(1e9), high = -low;
    for (int n = 0; n < 4 * points_per_edge; ++n) {
        const double along = (n % points_per_edge) / double(points_per_edge);
        const double s[] = {along, 1.0, 1.0 - along, 0.0};
        const double t[] = {0.0, along, 1.0, 1.0 - along};
        const int edge = n / points_per_edge;
        const Eigen::Vector3d p =
            view.camera_from_grid() *
            Eigen::Vector3d(s[edge] * view.columns(), t[edge] * view.rows(), 1.0);
        const auto pixel = projector.project(p);
        if (!pixel)
            return limit;
        low = low.min(pixel->array());
        high = high.max(pixel->array());
    }
    const BlurRange blur = blur_over_marker(view, projector.camera().intrinsics);
    const double margin = 2.0 * blur.largest_px + 2.0 * block_px;
    const auto clamped = [](double v) { return static_cast<int>(std::clamp(v, -1e8, 1e8)); };
    const cv::Point from(clamped(low.x() - margin), clamped(low.y() - margin));
    const cv::Point to(clamped(high.x() + margin), clamped(high.y() + margin));
    return cv::Rect(from, to) & limit;
}

int floor_div(int a, int b) {
    return a >= 0 ? a / b : -((-a + b - 1) / b);
}

// Indices of the blocks that hold these pixels.
cv::Rect blocks_of(const cv::Rect& pixels) {
    const int left = floor_div(pixels.x, block_px), top = floor_div(pixels.y, block_px);
    return {left, top, floor_div(pixels.br().x - 1, block_px) - left + 1,
            floor_div(pixels.br().y - 1, block_px) - top + 1};
}

// Mean of the radiance's difference from the background over a block, by 4 x 4 lens averages.
float block_mean(const MarkerView& view, const Projector& projector, int i, int j,
                 LensAverage& lens_average) {
    double sum = 0.0;
    for (int q = 0; q < 16; ++q) {
        const Eigen::Vector2d pixel(i * block_px - 0.5 + (q % 4 + 0.5) * block_px / 4.0,
                                    j * block_px - 0.5 + (q / 4 + 0.5) * block_px / 4.0);
        const auto x = projector.unproject(pixel);
        if (!x)
            continue;
        const auto range = view.footprint({*x, *x});
        if (range)
            sum += lens_average.at(*x, *range) - view.background();
    }
    return static_cast<float>(sum / 16.0);
}

cv::Mat block_means(const MarkerView& view, const Projector& projector, const cv::Rect& blocks) {
    cv::Mat means(blocks.size(), CV_32FC1);
    tbb::parallel_for(tbb::blocked_range<int>(0, blocks.height), [&](const auto& rows) {
        LensAverage lens_average(view);
        for (int j = rows.begin(); j < rows.end(); ++j)
            for (int i = 0; i < blocks.width; ++i)
                means.at<float>(j, i) =
                    block_mean(view, projector, blocks.x + i, blocks.y + j, lens_average);
    });
    return means;
}

}  // namespace

void add_far_tail(const MarkerView& view, const UndistortionMap& map, const ImageFilter& filter,
                  double reach_px, const cv::Rect& region, cv::Mat& difference) {
    const int reach = static_cast<int>(std::min(reach_px, 1e5));
    const cv::Rect limit(region.x - reach, region.y - reach, region.width + 2 * reach,
                         region.height + 2 * reach);
    const cv::Rect marker = marker_box(view, map, limit);
    if (marker.empty())
        return;
    // One more block around the region, for the interpolation.
    const cv::Rect target = blocks_of({region.x - 2 * block_px, region.y - 2 * block_px,
                                       region.width + 4 * block_px, region.height + 4 * block_px});
    const cv::Rect source = blocks_of(marker), all = source | target;
    cv::Mat sources = cv::Mat::zeros(all.size(), CV_32FC1);
    block_means(view, map.projector(), source).copyTo(sources(source - all.tl()));
    const double diagonal = std::hypot(all.width, all.height) * block_px;
    const cv::Mat tail = convolve(sources, filter.far_kernel(std::min(reach_px, diagonal)));

    // Block (i, j) stands for its centre; cubic interpolation to the pixels.
    cv::Mat fine;
    cv::resize(tail(target - all.tl()), fine, {}, block_px, block_px, cv::INTER_CUBIC);
    difference += fine(region - target.tl() * block_px);
}

}  // namespace etalon
