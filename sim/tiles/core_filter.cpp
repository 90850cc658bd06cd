#include "sim/tiles/core_filter.h"

#include <hwy/cache_control.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <numeric>
#include <utility>

namespace etalon {

namespace {

// Outputs are made in blocks, block_rows high; neighbouring blocks that are not constant, up to a
// strip's width, share one window of samples.
constexpr int block = 16, block_rows = 32, strip = 4 * block;

// A window's outputs are summed in parts, of which constant ones are left out again; those beside
// each other are summed at once.
constexpr int part_columns = 16, part_rows = MirroredKernel::rows_at_once;

// From the left end of a window's tiles to the first output's margin: less than a tile's outputs,
// which are four at most.
constexpr int slack = 4;
// Behind each phase: constant samples are written in whole vectors.
constexpr int padding_of_phase = 16;

std::size_t length(std::ptrdiff_t n) {
    return static_cast<std::size_t>(n);
}

// Sets the outermost pairs of each row to zero that are too small to matter, and puts what they
// hold into the middle. Returns each row's first pair that is left.
std::vector<int> without_corners(cv::Mat& pairs) {
    constexpr double min_of_light = 1e-5, min_of_kernel = 3e-4;
    std::vector<double> sizes;
    for (const double pair : cv::Mat_<double>(pairs))
        sizes.push_back(2.0 * std::abs(pair));
    std::sort(sizes.begin(), sizes.end());
    const double all = std::accumulate(sizes.begin(), sizes.end(), 0.0);
    double allowed = std::min(min_of_light, min_of_kernel * all);
    std::size_t small = 0;
    while (small + 1 < sizes.size() && sizes[small] <= allowed)
        allowed -= sizes[small++];
    double dropped = 0.0;
    std::vector<int> first;
    for (int row = 0; row < pairs.rows; ++row) {
        auto* pair = pairs.ptr<double>(row);
        int i = 0;
        for (; i < pairs.cols && 2.0 * std::abs(pair[i]) < sizes[small]; ++i)
            dropped += std::exchange(pair[i], 0.0);
        first.push_back(i);
    }
    pairs.at<double>(pairs.rows / 2, pairs.cols - 1) += dropped;
    first[length(pairs.rows / 2)] = std::min(first[length(pairs.rows / 2)], pairs.cols - 1);
    return first;
}

}  // namespace

FilterKernel::FilterKernel(int samples_per_output, const cv::Mat& weights)
    : k(samples_per_output),
      reach_x((weights.cols - k) / 2),
      reach_y((weights.rows - k) / 2),
      margin_x((reach_x + k - 1) / k),
      margin_y((reach_y + k - 1) / k),
      energy(cv::sum(weights)[0]) {
    const int n = weights.cols, before = k * margin_x - reach_x;
    const int padding = (MirroredKernel::rows_at_once - 1) * k;
    const auto offset = [&](int column) {
        const int sample = before + column;
        return std::ptrdiff_t{sample % k} * phase_stride() + sample / k;
    };
    for (int i = 0; 2 * i < n; ++i) {
        left_.push_back(offset(i));
        right_.push_back(offset(n - 1 - i));
    }
    cv::Mat mirrored;
    cv::flip(weights, mirrored, 1);
    cv::Mat paired = cv::Mat(0.5 * (weights + mirrored)).colRange(0, (n + 1) / 2).clone();
    if (n % 2 != 0)  // the middle is a pair with itself
        paired.col(n / 2) *= 0.5;
    const std::vector<int> first = without_corners(paired);
    weights_.resize(length(weights.rows + 2 * padding) * left_.size());
    std::copy(paired.begin<double>(), paired.end<double>(),
              weights_.begin() + padding * paired.cols);
    for (int row = 0; row < weights.rows + padding; ++row) {
        int least = paired.cols;
        for (int from = row - padding; from <= row; from += k)
            if (from >= 0 && from < weights.rows)
                least = std::min(least, first[length(from)]);
        first_pairs_.push_back(least);
    }
}

int FilterKernel::phase_stride() const {
    return strip + 2 * margin_x + 2 * slack + padding_of_phase;
}

MirroredKernel FilterKernel::view() const {
    return {k,
            k + 2 * reach_y,
            static_cast<int>(left_.size()),
            left_.data(),
            right_.data(),
            weights_.data(),
            first_pairs_.data()};
}

namespace {

// The work of one thread: fills and filters blocks.
class BlockFilter {
public:
    BlockFilter(const SampleField& field, const FilterKernel& kernel, const cv::Rect& region,
                cv::Mat& out)
        : field_(field),
          kernel_(kernel),
          region_(region),
          out_(out),
          outputs_per_tile_(field.side / kernel.k),
          tile_shift_(std::countr_zero(static_cast<unsigned>(outputs_per_tile_))),
          phase_stride_(kernel.phase_stride()),
          stride_(kernel.k * phase_stride_),
          window_(new float[length((block_rows * kernel.k + 2 * kernel.reach_y) * stride_)]) {}

    // Where groups of tiles are known by how they are found.
    void filter_row_of_groups(int left, int right, int top) {
        for (int x = left; x < right; x += block)
            for (int y = top; y < top + block_rows; y += block)
                if (group_at({x, y}) == GroupKind::constant)
                    fill({x, y, block, block});
        for (int y = top; y < top + block_rows; y += block)
            for (int x = left; x < right;) {
                int end = x;
                while (end < right && end < x + strip && group_at({end, y}) == GroupKind::sampled)
                    end += block;
                if (end > x)
                    filter({x, y, end - x, block});
                x = std::max(end, x + block);
            }
    }

    // The blocks of a row that hold the outputs `left` (a multiple of their side) to `right` - 1. A
    // strip is filtered when the next one is found, whose samples are fetched meanwhile.
    void filter_row(int left, int right, int top) {
        cv::Rect found;
        for (int x = left; x < right;) {
            const auto is_constant_at = [&](int at) {
                return is_constant({at, top, block, block_rows});
            };
            const bool constant = is_constant_at(x);
            const int width =
                constant ? width_while(x, right,
                                       [&](int at) {
                                           return value_at({at, top}) == value_at({x, top}) &&
                                                  is_constant_at(at);
                                       })
                         : width_while(x, std::min(right, x + strip),
                                       [&](int at) { return !is_constant_at(at); });
            const cv::Rect outputs(x, top, width, block_rows);
            x += outputs.width;
            if (constant) {
                fill(outputs);
                continue;
            }
            prefetch(outputs);
            if (!found.empty())
                filter(found);
            found = outputs;
        }
        if (!found.empty())
            filter(found);
    }

private:
    GroupKind group_at(const cv::Point& output) const {
        static_assert(block == 16);
        return field_.groups->find(output.x >> 4, output.y >> 4);
    }

    cv::Rect tiles_seen(const cv::Rect& outputs) const {
        const int x = outputs.x - kernel_.margin_x, y = outputs.y - kernel_.margin_y;
        const int last_x = outputs.br().x - 1 + kernel_.margin_x;
        const int last_y = outputs.br().y - 1 + kernel_.margin_y;
        const int left = x >> tile_shift_, top = y >> tile_shift_;
        return {left, top, (last_x >> tile_shift_) - left + 1, (last_y >> tile_shift_) - top + 1};
    }

    bool is_constant(const cv::Rect& outputs) const {
        return field_.map.is_constant(tiles_seen(outputs));
    }

    // Of the blocks from x on up to `end` for which this holds.
    template <class Holds>
    static int width_while(int x, int end, const Holds& holds) {
        int to = x + block;
        while (to < end && holds(to))
            to += block;
        return to - x;
    }

    // Of the tile that an output lies in.
    float value_at(const cv::Point& output) const {
        return field_.map.at({output.x >> tile_shift_, output.y >> tile_shift_});
    }

    void prefetch(const cv::Rect& outputs) const {
        constexpr int line = 64 / sizeof(float);
        const cv::Rect own = outputs & region_;
        for (int y = own.y; y < own.br().y; ++y)
            for (int x = own.x; x < own.br().x; x += line)
                hwy::Prefetch(out_.ptr<float>(y - region_.y) + (x - region_.x));
        if (field_.side == 1)
            return;
        const cv::Rect seen = tiles_seen(outputs) & field_.map.tiles();
        const std::ptrdiff_t samples = std::ptrdiff_t{field_.side} * field_.side;
        for (int j = seen.y; j < seen.br().y; ++j) {
            const TileDetail* details = field_.map.details_from({seen.x, j});
            const float* const* finer = field_.map.finer_from({seen.x, j});
            for (int i = 0; i < seen.width; ++i)
                for (std::ptrdiff_t n = 0; has_samples(details[i]) && n < samples; n += line)
                    hwy::Prefetch(finer[i] + field_.offset + n);
        }
    }

    void fill(const cv::Rect& outputs) {
        const cv::Rect part = outputs & region_;
        if (part.empty())
            return;
        const float value = value_at(part.tl()) * static_cast<float>(kernel_.energy);
        if (value == 0.0f)
            return;
        filter_loops().add_constant(value, part.width, part.height,
                                    out_.ptr<float>(part.y - region_.y) + (part.x - region_.x),
                                    static_cast<std::ptrdiff_t>(out_.step1()));
    }

    void filter(const cv::Rect& block_outputs) {
        const cv::Rect outputs = without_constant_rows(block_outputs);
        if (outputs.empty())
            return;
        const float* window = gather(outputs);
        for (int y = outputs.y; y < outputs.br().y; y += part_rows)
            for (int x = outputs.x; x < outputs.br().x;) {
                int end = x;
                while (end < outputs.br().x && !is_constant({end, y, part_columns, part_rows}))
                    end += part_columns;
                if (end == x) {
                    fill({x, y, part_columns, part_rows}), x += part_columns;
                    continue;
                }
                const cv::Rect parts = without_constant_ends({x, y, end - x, part_rows});
                if (!parts.empty())
                    filter_parts(parts, window + (y - outputs.y) * kernel_.k * stride_ + parts.x -
                                            outputs.x);
                x = end;
            }
    }

    // Without the rows of parts at the top and at the bottom that are constant: what only they see
    // need not be gathered.
    cv::Rect without_constant_rows(cv::Rect outputs) {
        const auto fill_constant = [&](int y) {
            const cv::Rect row(outputs.x, y, outputs.width, part_rows);
            const bool constant = is_constant(row);
            if (constant)
                fill(row), outputs.height -= part_rows;
            return constant;
        };
        while (outputs.height > 0 && fill_constant(outputs.y))
            outputs.y += part_rows;
        while (outputs.height > 0 && fill_constant(outputs.br().y - part_rows))
            continue;
        return outputs;
    }

    // Fewer parts, where the constant outputs at both ends leave no more.
    cv::Rect without_constant_ends(const cv::Rect& parts) {
        const int before =
            constant_end([&](int width) { return cv::Rect(parts.x, parts.y, width, part_rows); });
        const int behind = constant_end(
            [&](int width) { return cv::Rect(parts.br().x - width, parts.y, width, part_rows); });
        const int rest = std::max(0, parts.width - before - behind);
        const int width = (rest + part_columns - 1) / part_columns * part_columns;
        if (width == parts.width)
            return parts;
        const int x = std::min(parts.x + before, parts.br().x - width);
        fill({parts.x, parts.y, x - parts.x, part_rows});
        fill({x + width, parts.y, parts.br().x - x - width, part_rows});
        return {x, parts.y, width, part_rows};
    }

    // The largest of 0, 4, 8 and 12 columns at an end that are constant.
    template <class End>
    int constant_end(const End& end) const {
        constexpr int half = part_columns / 2, quarter = half / 2;
        const int width = is_constant(end(half)) ? half + quarter : quarter;
        return is_constant(end(width)) ? width : width - quarter;
    }

    void filter_parts(const cv::Rect& outputs, const float* window) {
        const cv::Rect part = outputs & region_;
        if (part == outputs) {
            float* to = out_.ptr<float>(part.y - region_.y) + (part.x - region_.x);
            filter_loops().add_convolved(kernel_.view(), window, stride_, part.width, part.height,
                                         to, static_cast<std::ptrdiff_t>(out_.step1()));
            return;
        }
        float result[part_rows * strip] = {};
        filter_loops().add_convolved(kernel_.view(), window, stride_, outputs.width, outputs.height,
                                     result, strip);
        for (int y = part.y; y < part.br().y; ++y) {
            const float* from = result + (y - outputs.y) * strip + (part.x - outputs.x);
            float* to = out_.ptr<float>(y - region_.y) + (part.x - region_.x);
            for (int x = 0; x < part.width; ++x)
                to[x] += from[x];
        }
    }

    // Copies the samples that these outputs see into the window, phase by phase, and returns where
    // its rows begin for the kernel.
    const float* gather(const cv::Rect& outputs) {
        switch (outputs_per_tile_) {
            case 4:
                return gather_tiles<4>(outputs);
            case 2:
                return gather_tiles<2>(outputs);
            default:
                return gather_plain(outputs);
        }
    }

    // Of tiles with n outputs a side. The window's rows begin at the left end of the first tile.
    template <int n>
    const float* gather_tiles(const cv::Rect& outputs) {
        const int side = field_.side, k = kernel_.k;
        const int top = outputs.y * k - kernel_.reach_y;
        const int bottom = outputs.br().y * k + kernel_.reach_y;
        const cv::Rect seen = tiles_seen(outputs);
        for (int j = floor_div(top, side); j * side < bottom; ++j) {
            const int first = std::max(top, j * side), last = std::min(bottom, (j + 1) * side);
            gather_tile_row<n>({seen.x, j, seen.width, 1}, first - j * side, last - first,
                               &window_[length((first - top) * stride_)]);
        }
        return &window_[length(outputs.x - kernel_.margin_x - seen.x * n)];
    }

    // Some rows of samples, from `first` on, of a row of tiles.
    template <int n>
    void gather_tile_row(const cv::Rect& seen, int first, int rows, float* to) const {
        const cv::Rect inside = seen & field_.map.tiles();
        const int left = inside.empty() ? seen.width : inside.x - seen.x;
        fill_rows(0.0f, left * n, rows, to);
        to += left * n;
        if (inside.empty())
            return;
        const float* values = field_.map.from(inside.tl());
        const TileDetail* details = field_.map.details_from(inside.tl());
        const float* const* finer = field_.map.finer_from(inside.tl());
        for (int i = 0; i < inside.width; ++i, to += n) {
            if (!has_samples(details[i])) {
                const int alike = count_alike(values + i, details + i, inside.width - i);
                fill_rows(values[i], alike * n, rows, to);
                i += alike - 1, to += (alike - 1) * n;
                continue;
            }
            const float* from = finer[i] + field_.offset + first * field_.side;
            if constexpr (n == 4)
                filter_loops().split_phases(from, kernel_.k, rows, phase_stride_, stride_, to);
            else  // only with k = 1
                for (int row = 0; row < rows; ++row)
                    std::copy_n(from + row * n, n, to + row * stride_);
        }
        fill_rows(0.0f, (seen.width - left - inside.width) * n, rows, to);
    }

    bool has_samples(TileDetail detail) const { return detail >= field_.least; }

    // The first of these tiles, which has no samples, and those behind it that have its value.
    int count_alike(const float* values, const TileDetail* details, int count) const {
        int alike = 1;
        while (alike < count && !has_samples(details[alike]) && values[alike] == values[0])
            ++alike;
        return alike;
    }

    void fill_rows(float value, int columns, int rows, float* to) const {
        filter_loops().fill_phases(value, columns, kernel_.k, rows, phase_stride_, stride_, to);
    }

    // Of a field with one sample per tile.
    const float* gather_plain(const cv::Rect& outputs) {
        const cv::Rect seen = grown(outputs, kernel_.reach_x, kernel_.reach_y);
        const cv::Rect inside = seen & field_.map.tiles();
        for (int y = seen.y; y < seen.br().y; ++y) {
            float* to = &window_[length((y - seen.y) * stride_)];
            if (inside.empty() || y < inside.y || y >= inside.br().y) {
                std::fill_n(to, seen.width, 0.0f);
                continue;
            }
            std::fill_n(to, inside.x - seen.x, 0.0f);
            std::copy_n(field_.map.from({inside.x, y}), inside.width, to + inside.x - seen.x);
            std::fill(to + inside.br().x - seen.x, to + seen.width, 0.0f);
        }
        return window_.get();
    }

    const SampleField& field_;
    const FilterKernel& kernel_;
    cv::Rect region_;
    cv::Mat& out_;
    int outputs_per_tile_, tile_shift_;  // 4, 2 or 1 outputs, and its logarithm
    std::ptrdiff_t phase_stride_, stride_;
    std::unique_ptr<float[]> window_;
};

}  // namespace

void for_each_band(const cv::Rect& region, const std::function<void(const cv::Rect&)>& work) {
    const cv::Rect bands = cells_of(region, block_rows);
    tbb::parallel_for(tbb::blocked_range<int>(bands.y, bands.br().y), [&](const auto& range) {
        for (int j = range.begin(); j < range.end(); ++j)
            work(cv::Rect(region.x, j * block_rows, region.width, block_rows) & region);
    });
}

void add_filtered(const SampleField& field, const FilterKernel& kernel, const cv::Rect& region,
                  const cv::Rect& band, cv::Mat& out) {
    const int n = field.side / kernel.k;
    const cv::Rect own(field.map.tiles().x * n, field.map.tiles().y * n,
                       field.map.tiles().width * n, field.map.tiles().height * n);
    const cv::Rect reached = grown(own, kernel.margin_x, kernel.margin_y) & band;
    if (own.empty() || reached.empty())
        return;
    const int left = floor_div(reached.x, block) * block;
    const int top = floor_div(reached.y, block_rows) * block_rows;
    BlockFilter filter(field, kernel, region, out);
    if (field.groups)
        filter.filter_row_of_groups(left, reached.br().x, top);
    else
        filter.filter_row(left, reached.br().x, top);
}

}  // namespace etalon
