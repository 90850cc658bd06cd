#include "sim/tiles/tile_map.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "sim/tiles/filter_simd.h"

namespace etalon {

int floor_div(int a, int b) {
    return a >= 0 ? a / b : -((b - 1 - a) / b);
}

cv::Rect cells_of(const cv::Rect& pixels, int size) {
    if (pixels.empty())
        return {};
    const cv::Point first(floor_div(pixels.x, size), floor_div(pixels.y, size));
    const cv::Point last(floor_div(pixels.br().x - 1, size), floor_div(pixels.br().y - 1, size));
    return {first, last + cv::Point(1, 1)};
}

cv::Rect grown(const cv::Rect& rect, int x, int y) {
    return {rect.x - x, rect.y - y, rect.width + 2 * x, rect.height + 2 * y};
}

bool is_past_caches(const cv::Mat& pixels) {
    constexpr std::size_t caches_bytes = 4 << 20;  // a core's, about: 1 to 2 MiB and a share
    return pixels.total() * pixels.elemSize() > caches_bytes;
}

// cv::Mat's own fill takes four times as long: a third of a small marker's frame.
void set_outside(const cv::Rect& inner, const cv::Rect& region, float value, cv::Mat& pixels) {
    const bool past_caches = is_past_caches(pixels);
    for (int y = region.y; y < region.br().y; ++y) {
        float* row = pixels.ptr<float>(y - region.y);
        const bool beside = y >= inner.y && y < inner.br().y;
        const int from = beside ? inner.x - region.x : region.width;
        filter_loops().fill_row(value, from, past_caches, row);
        if (beside)
            filter_loops().fill_row(value, region.br().x - inner.br().x, past_caches,
                                    row + inner.br().x - region.x);
    }
}

TileMap::TileMap(const cv::Rect& tiles)
    : values_(tiles), details_(values_.cells.size()), finer_(values_.cells.size()) {}

void TileMap::fill(const cv::Rect& part, float value) {
    for (int j = part.y; j < part.br().y; ++j)
        std::fill_n(from({part.x, j}), part.width, value);
}

void TileMap::copy(const TileMap& other) {
    const cv::Rect both = tiles() & other.tiles();
    for (int j = both.y; j < both.br().y; ++j) {
        const std::size_t from = other.values_.index(both.x, j), to = values_.index(both.x, j);
        std::copy_n(&other.values_.cells[from], both.width, &values_.cells[to]);
        std::copy_n(&other.details_[from], both.width, &details_[to]);
        std::copy_n(&other.finer_[from], both.width, &finer_[to]);
    }
}

void TileMap::finish() {
    counted_ = grown(tiles(), 1, 1);
    cv::Mat padded = cv::Mat::zeros(counted_.height + 1, counted_.width + 1, CV_32FC1);
    cv::Mat differs = cv::Mat::zeros(counted_.size(), CV_8UC1);
    const cv::Size size = tiles().size();
    if (size.area() > 0) {
        cv::Mat(size, CV_32FC1, from(tiles().tl())).copyTo(padded({{2, 2}, size}));
        cv::Mat(size, CV_8UC1, details_.data()).copyTo(differs({{1, 1}, size}));
    }
    for (int j = 0; j < differs.rows; ++j) {
        const float *above = padded.ptr<float>(j), *here = padded.ptr<float>(j + 1);
        uchar* row = differs.ptr(j);
        for (int i = 0; i < differs.cols; ++i)
            row[i] =
                int(row[i] != 0) | int(here[i + 1] != here[i]) | int(here[i + 1] != above[i + 1]);
    }
    cv::integral(differs, counts_, CV_32S);
}

bool TileMap::is_constant(const cv::Rect& part) const {
    const cv::Rect inside = part & counted_;
    if (inside.empty())
        return true;
    const cv::Point a = inside.tl() - counted_.tl(), b = inside.br() - counted_.tl();
    const int *first = counts_.ptr<int>(a.y), *last = counts_.ptr<int>(b.y);
    return last[b.x] - last[a.x] - first[b.x] + first[a.x] == 0;
}

}  // namespace etalon
