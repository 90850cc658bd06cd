#include "sim/tiles/tile_map.h"

#include <algorithm>
#include <utility>

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
        fill_row(value, from, past_caches, row);
        if (beside)
            fill_row(value, region.br().x - inner.br().x, past_caches,
                     row + inner.br().x - region.x);
    }
}

namespace {

std::size_t length(int n) {
    return static_cast<std::size_t>(n);
}

}  // namespace

TileMap::TileMap(const cv::Rect& tiles)
    : tiles_(tiles), values_(length(tiles.area())), details_(length(tiles.area())) {}

void TileMap::fill(const cv::Rect& part, float value) {
    for (int j = part.y; j < part.br().y; ++j)
        std::fill_n(&values_[index(part.x, j)], part.width, value);
}

void TileMap::copy(const TileMap& other) {
    const cv::Rect both = tiles_ & other.tiles_;
    for (int j = both.y; j < both.br().y; ++j) {
        const std::size_t from = other.index(both.x, j), to = index(both.x, j);
        std::copy_n(&other.values_[from], both.width, &values_[to]);
        std::copy_n(&other.details_[from], both.width, &details_[to]);
    }
}

void TileMap::finish() {
    counted_ = grown(tiles_, 1, 1);
    const auto width = length(counted_.width), own_width = length(tiles_.width);
    counts_.resize((width + 1) * length(counted_.height + 1));
    std::fill_n(counts_.begin(), width + 1, 0);
    // A row of tiles with the zeros beyond its ends, from the second value on, and the row above.
    std::vector<float> here(width + 1), above(width + 1);
    std::vector<unsigned char> differs(width);
    for (std::size_t j = 0; j < length(counted_.height); ++j) {
        const bool own = j > 0 && j <= length(tiles_.height);
        if (own)
            std::copy_n(&values_[(j - 1) * own_width], own_width, here.begin() + 2);
        else
            std::fill(here.begin(), here.end(), 0.0f);
        for (std::size_t i = 0; i < width; ++i)
            differs[i] = int(here[i + 1] != here[i]) | int(here[i + 1] != above[i + 1]);
        if (own)
            for (std::size_t i = 0; i < own_width; ++i)
                differs[i + 1] |= refined((j - 1) * own_width + i);
        const int* last = &counts_[j * (width + 1)];
        int* sums = &counts_[(j + 1) * (width + 1)];
        sums[0] = 0;
        int row = 0;
        for (std::size_t i = 0; i < width; ++i) {
            row += differs[i];
            sums[i + 1] = last[i + 1] + row;
        }
        here.swap(above);
    }
}

std::size_t TileMap::refined_count() const {
    return details_.size() -
           static_cast<std::size_t>(std::count(details_.begin(), details_.end(), TileDetail::none));
}

bool TileMap::is_constant(const cv::Rect& part) const {
    const cv::Rect inside = part & counted_;
    if (inside.empty())
        return true;
    const auto sum = [&](int x, int y) {
        return counts_[length(y - counted_.y) * length(counted_.width + 1) +
                       length(x - counted_.x)];
    };
    const cv::Point a = inside.tl(), b = inside.br();
    return sum(b.x, b.y) - sum(a.x, b.y) - sum(b.x, a.y) + sum(a.x, a.y) == 0;
}

}  // namespace etalon
