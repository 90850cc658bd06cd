#include "sim/tiles/tail_pyramid.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "sim/tiles/lens_average.h"

namespace etalon {
namespace {

constexpr int tile_shift = 2;    // a tile is one square
constexpr int square_shift = 3;  // the finest grid outside the sampled tiles

cv::Rect scaled(const cv::Rect& rect, int factor) {
    return {rect.x * factor, rect.y * factor, rect.width * factor, rect.height * factor};
}

bool contains(const cv::Rect& outer, const cv::Rect& inner) {
    return (outer & inner) == inner;
}

// The squares of twice the side that lie inside.
cv::Rect halves_inside(const cv::Rect& rect) {
    const cv::Point first((rect.x + 1) >> 1, (rect.y + 1) >> 1);
    const cv::Point end(rect.br().x >> 1, rect.br().y >> 1);
    return first.x < end.x && first.y < end.y ? cv::Rect(first, end) : cv::Rect();
}

void average_pairs(const float* upper, const float* lower, int count, float* averages) {
    for (int i = 0; i < count; ++i)
        averages[i] = 0.25f * (upper[2 * i] + upper[2 * i + 1] + lower[2 * i] + lower[2 * i + 1]);
}

// What the tail is summed over: averages of one marker's image over the squares of ever coarser
// grids. Inside the sampled tiles they come from the samples; outside, squares of 8 px and more are
// averaged over 4 x 4 lens averages (finer grids take the value of the 8-px square).
class TailSources {
public:
    // `pixels`: those of TailPyramid::sources(), or the part of them that matters.
    TailSources(const TileSamples& samples, const MarkerView& marker, const SquareCorners& corners,
                const cv::Rect& pixels)
        : samples_(samples), marker_(marker), corners_(corners), pixels_(pixels) {}

    const cv::Rect& pixels() const { return pixels_; }

    // Averages what the sums need: on each grid from the shift `finest` on, 0 to 2, the squares of
    // needed[shift]; there must be some for the shifts 2 and 3 at least.
    void average(const std::vector<cv::Rect>& needed, int finest);

    // The averages on a grid, for add_filtered() with k = 1.
    SampleField field(int shift) const;

private:
    void take_tiles(const cv::Rect& needed_tiles);
    void average_pixels();
    void average_squares(const std::vector<cv::Rect>& needed);
    void fill_tiles_outside();
    float lens_mean(int shift, int i, int j, LensAverage& lens_average) const;

    const TileSamples& samples_;
    const MarkerView& marker_;
    const SquareCorners& corners_;
    cv::Rect pixels_;
    std::vector<TileMap> squares_;  // by shift, from 2 on
    TileMap pixel_tiles_;           // with 4 x 4 averages of its pixels for each refined tile
    std::vector<float> pixel_averages_;
};

void TailSources::average(const std::vector<cv::Rect>& needed, int finest) {
    squares_.assign(needed.size(), TileMap());
    // Tiles are needed where the finer grids are, too, and wherever there are samples.
    take_tiles(grown(needed[tile_shift], 2, 2) | samples_.tiles());
    average_squares(needed);
    fill_tiles_outside();
    for (TileMap& squares : squares_)
        squares.finish();
    if (finest == 0)
        average_pixels();
}

void TailSources::take_tiles(const cv::Rect& needed_tiles) {
    squares_[tile_shift] = TileMap(cells_of(pixels_, tile_px) & needed_tiles);
    squares_[tile_shift].copy(samples_.map());
}

void TailSources::average_pixels() {
    constexpr int pixels = tile_px * tile_px;
    pixel_tiles_ = squares_[tile_shift];
    std::vector<cv::Point> refined;
    for_each_cell(pixel_tiles_.tiles(), [&](int i, int j) {
        if (pixel_tiles_.refined(i, j))
            refined.emplace_back(i, j);
    });
    pixel_averages_.resize(pixels * refined.size());
    float* next = pixel_averages_.data();
    for (const cv::Point& tile : refined) {
        filter_loops().average_parts(*pixel_tiles_.finer_from(tile) + samples_.unspread_offset(),
                                     samples_.k() * tile_px, tile_px, next);
        pixel_tiles_.set(tile.x, tile.y, pixel_tiles_.at(tile), TileDetail::quarters, next);
        next += pixels;
    }
}

// Each square from the four finer ones where all of them are known, otherwise through the lens.
void TailSources::average_squares(const std::vector<cv::Rect>& needed) {
    for (std::size_t n = square_shift; n < needed.size(); ++n) {
        const int shift = static_cast<int>(n);
        const TileMap& finer = squares_[n - 1];
        const cv::Rect known = shift == square_shift ? samples_.tiles() : needed[n - 1];
        const cv::Rect cells = cells_of(pixels_, 1 << shift) & needed[n];
        const cv::Rect within = halves_inside(finer.tiles() & known) & cells;
        squares_[n] = TileMap(cells);
        tbb::parallel_for(tbb::blocked_range<int>(cells.y, cells.br().y), [&](const auto& rows) {
            LensAverage lens_average(marker_);
            const auto mean = [&](int i, int j) {
                const int x = 2 * i, y = 2 * j;
                return contains(known, {x, y, 2, 2})
                           ? 0.25f * (finer.at({x, y}) + finer.at({x + 1, y}) +
                                      finer.at({x, y + 1}) + finer.at({x + 1, y + 1}))
                           : lens_mean(shift, i, j, lens_average);
            };
            for (int j = rows.begin(); j < rows.end(); ++j) {
                for (int i = cells.x; i < cells.br().x; ++i) {
                    if (!within.contains({i, j})) {
                        squares_[n].set(i, j, mean(i, j));
                        continue;
                    }
                    average_pairs(finer.from({2 * i, 2 * j}), finer.from({2 * i, 2 * j + 1}),
                                  within.width, squares_[n].from({i, j}));
                    i += within.width - 1;
                }
            }
        });
    }
}

void TailSources::fill_tiles_outside() {
    TileMap& tiles = squares_[tile_shift];
    const cv::Rect all = tiles.tiles();
    if (contains(samples_.tiles(), all))
        return;
    for_each_cell(all, [&](int i, int j) {
        if (!samples_.tiles().contains({i, j}))
            tiles.set(i, j, squares_[square_shift].at({i >> 1, j >> 1}));
    });
}

// Of 4 x 4 lens averages; their points are interpolated between the square's corners.
float TailSources::lens_mean(int shift, int i, int j, LensAverage& lens_average) const {
    const auto corners = corners_.of(shift, i, j);
    if (!corners)
        return 0.0f;
    const auto& [a, b, c, d] = *corners;
    const Box box{a.cwiseMin(b).cwiseMin(c).cwiseMin(d), a.cwiseMax(b).cwiseMax(c).cwiseMax(d)};
    const auto range = marker_.footprint(box);
    if (!range)
        return 0.0f;
    if (const auto uniform = marker_.uniform_radiance(*range))
        return static_cast<float>(*uniform - marker_.background());
    double sum = 0.0;
    for (int q = 0; q < 16; ++q) {
        const double s = (q % 4 + 0.5) / 4.0, t = (q / 4 + 0.5) / 4.0;
        const Eigen::Vector2d x = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d);
        if (const auto seen = marker_.footprint({x, x}))
            sum += lens_average.at(x, *seen) - marker_.background();
    }
    return static_cast<float>(sum / 16.0);
}

SampleField TailSources::field(int shift) const {
    if (shift >= tile_shift)
        return {squares_[static_cast<std::size_t>(shift)]};
    if (shift == 0)
        return {pixel_tiles_, tile_px};
    return {squares_[tile_shift], tile_px / 2};
}

// Adds the coarse values, interpolated up by two, to a band of rows of `fine`, or writes them and
// the background. `from` and `to`: the squares of both; `from` holds three more around.
void add_refined(const cv::Mat& coarse, const cv::Rect& from, const cv::Rect& to,
                 const cv::Rect& band, std::optional<float> background, cv::Mat& fine) {
    std::array<float, 6>
        weights;  // of the samples for a point a quarter of a step before the fourth
    for (std::size_t n = 0; n < 6; ++n)
        weights[n] = static_cast<float>(lagrange6(2.75 - static_cast<double>(n)));
    const auto width = static_cast<std::size_t>(from.width);
    std::vector<float> pair(2 * width);  // the fine rows 2 i and 2 i + 1
    for (int y = band.y; y < band.br().y; ++y) {
        if (y == band.y || y % 2 == 0) {
            const float* rows[7];
            for (int n = 0; n < 7; ++n)
                rows[n] = coarse.ptr<float>((y >> 1) + n - 3 - from.y);
            filter_loops().sum_row_pair(rows, weights.data(), from.width, pair.data(),
                                        pair.data() + width);
        }
        const float* row = pair.data() + (y & 1 ? width : 0) - from.x;
        float* to_row = fine.ptr<float>(y - to.y);
        filter_loops().put_interpolated(row, weights.data(), to.x, to.br().x, background, to_row);
    }
}

int smooth_shift(const ImageFilter& filter) {
    return filter.first_ring() + 3;
}

// What is written where. Beside the marker every grid is interpolated from the next coarser one. A
// pixel 6 of the smooth grid's squares away from it sees no ring of a finer grid. There straight
// lines between the smooth grid's sums are off by less than 0.06 lambda N gray over the square's
// side in px: beside a half-plane the tail is 26 lambda N / r gray at the distance r.
struct Targets {
    cv::Rect reached, beside;       // pixels
    std::vector<cv::Rect> squares;  // by shift, pixels (beside) first: where sums are needed
    int smooth;                     // shift

    Targets(const cv::Rect& marker, const cv::Rect& reached_pixels, int smooth_shift, int top)
        : reached(reached_pixels), beside(reached_pixels), smooth(smooth_shift) {
        constexpr int margin = 3;  // of the interpolation
        if (top >= smooth)
            beside &= grown(marker, 6 << smooth, 6 << smooth);
        if (beside.empty())  // all that is reached is farther
            beside = {reached.tl(), cv::Size()};
        squares.push_back(beside);
        for (int shift = 1; shift <= top; ++shift) {
            squares.push_back(grown(cells_of(squares.back(), 2), margin, margin));
            if (shift == smooth)
                squares.back() |= grown(cells_of(reached, 1 << smooth), 1, 1);
        }
    }

    // The reached pixels above, below, to the left and to the right of those beside the marker.
    std::array<cv::Rect, 4> farther() const {
        const cv::Point from = reached.tl(), to = reached.br(), a = beside.tl(), b = beside.br();
        return {cv::Rect(from, cv::Point(to.x, a.y)), cv::Rect(cv::Point(from.x, b.y), to),
                cv::Rect(cv::Point(from.x, a.y), cv::Point(a.x, b.y)),
                cv::Rect(cv::Point(b.x, a.y), cv::Point(to.x, b.y))};
    }
};

// Adds the smooth grid's sums, or writes them and the background, to a part of the region.
void add_smooth(const cv::Mat& sums, const cv::Rect& squares, int shift, const cv::Rect& part,
                const cv::Rect& region, std::optional<float> background, cv::Mat& pixels) {
    if (part.empty())  // a row of no pixels has no squares
        return;
    const bool past_caches = is_past_caches(pixels);
    const float base = background.value_or(0.0f);
    // The squares between whose middles the part's pixels lie.
    const cv::Rect between = grown(cells_of(part, 1 << shift), 1, 1);
    const int left = between.x - squares.x;
    tbb::parallel_for(tbb::blocked_range<int>(part.y, part.br().y, 16), [&](const auto& range) {
        std::vector<float> row(static_cast<std::size_t>(between.width));
        for (int y = range.begin(); y < range.end(); ++y) {
            // In half pixels, from the middle of the square with the index 0.
            const int place = 2 * y + 1 - (1 << shift), above = place >> (shift + 1);
            const auto way =
                static_cast<float>(place - above * (2 << shift)) / static_cast<float>(2 << shift);
            const float* from = sums.ptr<float>(above - squares.y) + left;
            const float* next = sums.ptr<float>(above + 1 - squares.y) + left;
            for (std::size_t x = 0; x < row.size(); ++x)
                row[x] = from[x] + way * (next[x] - from[x]) + base;
            float* to = pixels.ptr<float>(y - region.y) + (part.x - region.x);
            filter_loops().put_ramps(row.data() - between.x, shift, part.x, part.br().x,
                                     !background, past_caches, to);
        }
    });
}

// The rings of one camera's tail that a reach and a blur take: one for each of the shifts `first`
// to `top`; none if top < first.
struct Rings {
    const ImageFilter& filter;
    int first, top;

    Rings(const ImageFilter& image_filter, double reach_px, int finest)
        : filter(image_filter), first(finest), top(filter.first_ring() - 1) {
        while (filter.radius_held(top + 1) < reach_px && top < SquareCorners::max_shift)
            ++top;
        if (top >= filter.first_ring())
            top = std::max(top, first);
    }

    const FilterKernel& on(int shift) const {
        return filter.ring(std::max(shift, first), shift <= first);
    }

    // The squares that the targets' sums see.
    std::vector<cv::Rect> sources(const std::vector<cv::Rect>& targets) const {
        std::vector<cv::Rect> result;
        for (const cv::Rect& target : targets) {
            const FilterKernel& ring = on(static_cast<int>(result.size()));
            result.push_back(grown(target, ring.margin_x, ring.margin_y));
        }
        return result;
    }
};

}  // namespace

std::optional<SquareCorners::Corners> SquareCorners::of(int shift, int i, int j) const {
    Corners result;
    for (int q = 0; q < 4; ++q) {
        auto& x = result[static_cast<std::size_t>(q)];
        x = point_at(shift, {i + q % 2, j + q / 2});
        if (!x.allFinite())
            return std::nullopt;
    }
    return result;
}

Eigen::Vector2d SquareCorners::compute(int shift, const cv::Point& node) const {
    const double g = std::ldexp(1.0, shift);
    const auto x = projector_.unproject({g * node.x - 0.5, g * node.y - 0.5});
    return x ? *x : Eigen::Vector2d::Constant(std::nan(""));
}

Eigen::Vector2d SquareCorners::point_at(int shift, const cv::Point& node) const {
    constexpr int margin = 32;  // squares beyond the image that rings and interpolation see
    const CellTable<Part>& parts = parts_[static_cast<std::size_t>(shift)].get([&] {
        return CellTable<Part>(
            cells_of(grown(cells_of(pixels_, 1 << shift), margin, margin), part_side));
    });
    const cv::Point at(floor_div(node.x, part_side), floor_div(node.y, part_side));
    if (!parts.rect.contains(at))
        return compute(shift, node);
    const cv::Point first = part_side * at, within = node - first;
    const auto& points = parts.at(at.x, at.y).get([&] {
        std::vector<Eigen::Vector2d> made;
        for_each_cell({first, cv::Size(part_side, part_side)}, [&](int x, int y) {
            made.push_back(compute(shift, {x, y}));
        });
        return made;
    });
    return points[static_cast<std::size_t>(within.y * part_side + within.x)];
}

TailPyramid::TailPyramid(const ImageFilter& filter, const Projector& projector,
                         const cv::Rect& pixels)
    : filter_(filter), corners_(projector, pixels) {}

cv::Rect TailPyramid::sources(const TileSamples& samples, const MarkerView& marker,
                              const std::vector<Eigen::Vector2d>& outline,
                              const cv::Rect& limit) const {
    const cv::Rect sampled = scaled(samples.tiles_off_background(), tile_px);
    constexpr double bulge_px = 16.0;  // of the outline between two of its points, at most
    const BlurRange blur = blur_over_marker(marker, corners_.projector().camera().intrinsics);
    const double margin = 2.0 * blur.largest_px + bulge_px;
    const cv::Rect box = pixels_around(outline, Eigen::Array2d::Constant(margin), limit);
    if (contains(scaled(samples.tiles(), tile_px), box))
        return sampled & limit;
    return (sampled.empty() ? box : sampled | box) & limit;
}

FarTail::FarTail(const ImageFilter& filter, const cv::Rect& pixels)
    : shift(smooth_shift(filter)),
      region(pixels),
      squares(grown(cells_of(pixels, 1 << shift), 1, 1)) {}

void FarTail::add(const cv::Mat& more, const cv::Rect& of_squares) {
    if (sums.empty())
        sums = cv::Mat::zeros(squares.size(), CV_32FC1);
    const cv::Rect both = squares & of_squares;
    sums(both - squares.tl()) += more(both - of_squares.tl());
}

void FarTail::add_to(cv::Mat& pixels) const {
    if (!sums.empty())
        add_smooth(sums, squares, shift, region, region, std::nullopt, pixels);
}

void TailPyramid::add(const TileSamples& samples, const MarkerView& marker, const cv::Rect& seen_at,
                      double reach_px, int finest, const cv::Rect& region,
                      std::optional<float> background, FarTail& far, cv::Mat& pixels,
                      const std::function<void(const cv::Rect&)>& done) const {
    constexpr int min_outside = 3;  // shift of the squares outside the samples
    constexpr double max_px = 1e5;
    const Rings rings(filter_, std::min(reach_px, max_px), finest);
    const int reach = static_cast<int>(std::ceil(std::min(reach_px, max_px)));
    TailSources sources(samples, marker, corners_, seen_at & grown(region, reach, reach));
    cv::Rect reached = grown(sources.pixels(), reach, reach) & region;
    if (sources.pixels().empty() || rings.top < rings.first)
        reached = {};
    if (background)
        set_outside(reached, region, *background, pixels);
    if (reached.empty())
        return for_each_band(region, done);
    const Targets targets(sources.pixels(), reached, smooth_shift(filter_),
                          std::max(rings.top, min_outside));
    sources.average(rings.sources(targets.squares), std::min(rings.first, min_outside - 1));
    cv::Mat coarser;
    // The sums of a band of a grid: those of the coarser grids, or the background, and its own.
    const auto add_band = [&](int shift, const cv::Rect& band, std::optional<float> base,
                              cv::Mat& sums) {
        const cv::Rect& target = targets.squares[static_cast<std::size_t>(shift)];
        if (shift < rings.top)
            add_refined(coarser, targets.squares[static_cast<std::size_t>(shift + 1)], target, band,
                        base, sums);
        else if (base)
            sums(band - target.tl()).setTo(*base);
        if (shift >= rings.first)
            add_filtered(sources.field(shift), rings.on(shift), target, band, sums);
    };
    for (int shift = rings.top; shift > 0; --shift) {
        const cv::Rect& target = targets.squares[static_cast<std::size_t>(shift)];
        cv::Mat sums(target.size(), CV_32FC1);
        for_each_band(target, [&](const cv::Rect& band) { add_band(shift, band, 0.0f, sums); });
        if (shift == targets.smooth && background) {
            for (const cv::Rect& part : targets.farther())
                add_smooth(sums, target, shift, part, region, background, pixels);
        } else if (shift == targets.smooth) {
            // Beside the marker finer grids take the place of what will come from there.
            far.add(sums, target);
            add_smooth(-sums, target, shift, targets.beside, region, std::nullopt, pixels);
        }
        coarser = sums;
    }
    cv::Mat beside = pixels(targets.beside - region.tl());
    for_each_band(region, [&](const cv::Rect& band) {
        if (const cv::Rect own = band & targets.beside; !own.empty())
            add_band(0, own, background, beside);
        done(band);
    });
}

}  // namespace etalon
