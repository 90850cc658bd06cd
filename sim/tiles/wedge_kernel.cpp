// Compiled once for each instruction set, as sim/tiles/tile_kernel.cpp.
#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/tiles/wedge_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#include <cmath>
#include <numbers>

#include "sim/psf/wedge_table.h"
#include "sim/tiles/tile_patch.h"
#include "sim/tiles/tile_vectors-inl.h"

#ifndef ETALON_WEDGE_LINE
#define ETALON_WEDGE_LINE
namespace etalon {
namespace {

// What the vector code needs to know of a tile's line.
struct WedgeLine {
    TileLine line;
    float blur_scale;   // the blur across the line in units of the tile's
    float blur_across;  // the change of that by px across the line
    // How much of this is asymmetric: the lens turns the rest into a change of scale.
    float asymmetry;
    float rows_along;  // the change along the line, in rows of the table, in its directions' sense
    float bend;        // the line's change of gradient across it, by px
    float direction;   // place among the table's
    float extent;      // of a pixel across the line, px
    float per_chord;   // parts of its chord in a pixel by px along the line

    WedgeLine() = default;
    WedgeLine(const TileGeometry& tile, const TileLine& tile_line);
};

// The second derivative of a tile's polynomial across a line, at the tile's middle, by px^2.
float bend_across(const std::array<float, 16>& c, const TileLine& line) {
    const float x = line.gradient_x, y = line.gradient_y;
    return 2.0f * (c[2] * x * x + c[5] * x * y + c[8] * y * y) / (tile_px * tile_px);
}

// The table's directions are those of half a right angle; the others are mirrored.
bool is_mirrored(const TileLine& line) {
    return ((line.gradient_x < 0.0f) != (line.gradient_y < 0.0f)) !=
           (std::abs(line.gradient_y) > std::abs(line.gradient_x));
}

WedgeLine::WedgeLine(const TileGeometry& tile, const TileLine& tile_line) : line(tile_line) {
    const float x = line.gradient_x, y = line.gradient_y;
    const float flat = std::min(std::abs(x), std::abs(y)),
                steep = std::max(std::abs(x), std::abs(y));
    blur_scale = std::hypot(line.blur_x, line.blur_y);
    blur_across = blur_scale * (tile.blur_slope_x * x + tile.blur_slope_y * y);
    asymmetry = blur_across -
                (tile.lens_turn_x * line.blur_x + tile.lens_turn_y * line.blur_y) / blur_scale;
    rows_along = static_cast<float>(WedgeTable::rows_per_px) * blur_scale *
                 (tile.blur_slope_y * x - tile.blur_slope_x * y) *
                 (is_mirrored(line) ? -1.0f : 1.0f);
    bend = x * bend_across(tile.dx, line) + y * bend_across(tile.dy, line);
    direction = 4.0f * static_cast<float>(WedgeTable::directions) / std::numbers::pi_v<float> *
                std::atan2(flat, steep);
    extent = flat + steep;
    per_chord = steep;
}

// The angle between the normals of two lines; almost parallel ones count as a thousandth apart.
struct WedgeAngle {
    float cosine, inverse_sine;

    WedgeAngle(const TileLine& a, const TileLine& b)
        : cosine(a.gradient_x * b.gradient_x + a.gradient_y * b.gradient_y),
          inverse_sine(1.0f / std::max(1e-3f, std::abs(a.gradient_x * b.gradient_y -
                                                       a.gradient_y * b.gradient_x))) {}
};

// Gauss' 8 x 8 nodes.
struct PixelNodes {
    static constexpr std::size_t side = 8, count = side * side;
    alignas(64) float x[count], y[count], weight[count];

    constexpr PixelNodes() : x(), y(), weight() {
        constexpr float node[] = {-0.48014493f, -0.39833324f, -0.26276621f, -0.09171732f,
                                  0.09171732f,  0.26276621f,  0.39833324f,  0.48014493f};
        constexpr float share[] = {0.05061427f, 0.11119052f, 0.15685332f, 0.18134189f,
                                   0.18134189f, 0.15685332f, 0.11119052f, 0.05061427f};
        for (std::size_t n = 0; n < count; ++n) {
            x[n] = node[n % side];
            y[n] = node[n / side];
            weight[n] = share[n % side] * share[n / side];
        }
    }
};

}  // namespace
}  // namespace etalon
#endif

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {
namespace {

using Whole = hn::Vec<hn::RebindToSigned<Tag>>;
constexpr hn::RebindToSigned<Tag> whole;

// Half the distance of Gauss' two nodes across a pixel.
constexpr float gauss2 = 0.28867513f;

// A line as the pixels see it: by how far their middles lie beyond it, in px of the sensor, its
// normal there, and the parts of the pixels beyond it.
struct EdgeCut {
    HWY_ALIGN float distance[block], normal_x[block], normal_y[block], area[block];
    WedgeLine of;
    const TileGeometry* tile;
    const WedgeRows* table;
    const float* blur;  // of the pixels' middles
    bool crosses;
};

HWY_INLINE Mask is_cut(const EdgeCut& cut) {
    constexpr auto least = static_cast<float>(WedgeTable::negligible);
    const Vector area = load(cut.area);
    return hn::And(hn::Gt(area, all(least)), hn::Lt(area, all(1.0f - least)));
}

// A place in a table: the value before it, and how far behind that.
struct Place {
    Whole index;
    Vector way;

    HWY_INLINE Place(Vector place, float last) {
        const Vector inside = hn::Min(place, all(last));
        index = hn::ConvertTo(whole, inside);
        way = inside - hn::ConvertTo(tag, index);
    }
};

HWY_INLINE Place distance_place(const WedgeRows& table, Vector distance) {
    return Place(all(table.per_unit) * distance * reciprocal(all(1.0f) + distance),
                 static_cast<float>(table.distances - 2) + 0.99f);
}

HWY_INLINE Vector between(Vector way, Vector near, Vector far) {
    return hn::MulAdd(way, far - near, near);
}

// Of values `stride` apart.
HWY_INLINE Vector gather2(const float* values, Whole index, int stride, Vector way) {
    return between(way, hn::GatherIndex(tag, values, index),
                   hn::GatherIndex(tag, values + stride, index));
}

// Where the values of a row and a distance begin.
HWY_INLINE Whole begin_of(const WedgeRows& table, const Place& row, const Place& distance) {
    return (row.index * hn::Set(whole, table.distances) + distance.index) *
           hn::Set(whole, WedgeTable::wedge_values);
}

// The mean over pixels beyond an edge at this distance; `direction`: its place among the table's.
HWY_INLINE Vector pixel_beyond(const WedgeRows& table, float direction, Vector distance,
                               Vector row) {
    constexpr int directions = WedgeTable::directions;
    const Place at = distance_place(table, distance), of_row(row, table.last - 0.01f);
    const int first = HWY_MIN(static_cast<int>(direction), directions - 1);
    const Vector turned = all(direction - static_cast<float>(first));
    const int per_row = (directions + 1) * table.distances;
    const Whole index = of_row.index * hn::Set(whole, per_row) + at.index;
    const auto of = [&](const float* values) HWY_ATTR {
        return between(turned, gather2(values, index, 1, at.way),
                       gather2(values + table.distances, index, 1, at.way));
    };
    const float* near = table.edges + first * table.distances;
    return hn::Clamp(between(of_row.way, of(near), of(near + per_row)), hn::Zero(tag), all(1.0f));
}

// A vector of pixels: their middles, and how these change from pixel to pixel.
struct Pixels {
    Vector dx, dy, x_by_s, y_by_s, x_by_t, y_by_t;

    // A line's distance and its normal in px of the sensor, at the pixels' own places.
    HWY_INLINE Vector on_sensor(Vector offset, EdgeCut& cut) const {
        constexpr float far = 8.0f;  // beyond every core
        const Vector x = all(cut.of.line.gradient_x), y = all(cut.of.line.gradient_y);
        const Vector by_s = hn::MulAdd(x, x_by_s, y * y_by_s);
        const Vector by_t = hn::MulAdd(x, x_by_t, y * y_by_t);
        const Vector scale = inverse_root(hn::MulAdd(by_s, by_s, by_t * by_t));
        store(by_s * scale, cut.normal_x);
        store(by_t * scale, cut.normal_y);
        const Vector straight = offset * scale;
        return hn::MulAdd(straight * all(0.5f * cut.of.bend),
                          hn::Clamp(straight, all(-far), all(far)), straight);
    }
};

// What a blur adds to that which changes by one row of the table per px along the edge.
HWY_INLINE Vector turned_beyond(const WedgeRows& table, float direction, Vector distance,
                                Vector row) {
    constexpr int directions = WedgeTable::directions;
    const Place at = distance_place(table, distance), of_row(row, table.last - 0.01f);
    const int per_row = (directions + 1) * table.distances;
    const Whole index = of_row.index * hn::Set(whole, per_row) + at.index;
    const float* near = table.turns + static_cast<int>(direction + 0.5f) * table.distances;
    return gather2(near + per_row, index, 1, at.way) - gather2(near, index, 1, at.way);
}

// Of a blur radius, squared.
HWY_INLINE Vector row_of_blur(const WedgeRows& table, Vector square) {
    constexpr auto even = static_cast<float>(WedgeTable::even_px);
    constexpr auto per_px = static_cast<float>(WedgeTable::rows_per_px);
    return hn::Clamp(all(per_px) * (hn::Sqrt(square + all(even * even)) - all(even)),
                     all(table.first), all(table.last));
}

// What the change of the blur along the line adds to its part.
HWY_INLINE Vector change_along(const EdgeCut& cut, Vector distance, Vector blur, Vector row) {
    constexpr float least = 0.03f;  // rows by px: some hundredths of a gray
    constexpr auto even = static_cast<float>(WedgeTable::even_px);
    if (cut.of.rows_along < least && cut.of.rows_along > -least)
        return hn::Zero(tag);
    const Vector by_blur = blur * inverse_root(hn::MulAdd(blur, blur, all(even * even)));
    return all(cut.of.rows_along) * by_blur *
           turned_beyond(*cut.table, cut.of.direction, distance, row);
}

// The line D + w . l = 0 in a vector of pixels. Its blur is taken where it passes them; where that
// changes asymmetrically by s per px across it, the blurred edge lies s R / 4 farther.
HWY_INLINE void cut_pixels(const Pixels& pixels, EdgeCut& cut) {
    const WedgeLine& of = cut.of;
    const Vector offset = distance(of.line, pixels.dx, pixels.dy);
    const Vector to_line = pixels.on_sensor(offset, cut);
    const Vector blur = hn::MulSub(all(of.blur_scale), blur_at(*cut.tile, pixels.dx, pixels.dy),
                                   all(of.blur_across) * offset);
    const Vector row = row_of_blur(*cut.table, blur * blur);
    const Vector beyond = hn::NegMulAdd(all(0.25f * of.asymmetry), blur, to_line);
    const Vector apart = hn::Abs(beyond);
    const Vector part = pixel_beyond(*cut.table, of.direction, apart, row);
    const Vector area = hn::IfThenElse(hn::Lt(beyond, hn::Zero(tag)), part, all(1.0f) - part);
    store(to_line, cut.distance);
    store(hn::Clamp(area + change_along(cut, apart, blur, row), hn::Zero(tag), all(1.0f)),
          cut.area);
    cut.crosses = !hn::AllFalse(tag, is_cut(cut));
}

// ---- Crossings

// atan(t) for 0 <= t <= 1, to 1e-5 (Abramowitz and Stegun, 4.4.49, after a least-squares fit).
HWY_INLINE Vector arc_tangent(Vector t) {
    constexpr float c[] = {0.9998660f, -0.3302995f, 0.1801410f, -0.0851330f, 0.0208351f};
    return t * polynomial<4>(c, t * t);
}

// What a point sees beyond one of a wedge's rays: of a line at this distance, of which the ray
// begins `along` px from the foot of the perpendicular.
struct RaySeen {
    Vector half;    // beyond one half of the whole line
    Vector beyond;  // beyond the ray
};

// Of the nearest row of the table, or between two of them.
template <bool between_rows>
HWY_INLINE RaySeen ray_seen(const WedgeRows& table, Vector distance, Vector along, Vector row) {
    constexpr int angles = WedgeTable::angles, width = WedgeTable::wedge_values;
    const Vector length = hn::Abs(along), least = hn::Min(distance, length);
    const Vector most = hn::Max(hn::Max(distance, length), all(tiny));
    const Vector angle = arc_tangent(least * reciprocal(most));
    const Place of_angle(
        all(2.0f * static_cast<float>(angles) / pi) *
            hn::IfThenElse(hn::Gt(length, distance), all(0.5f * pi) - angle, angle),
        static_cast<float>(angles) - 0.001f);
    const Place at = distance_place(table, distance);
    const Place of_row(between_rows ? row : row + all(0.5f),
                       between_rows ? table.last - 0.01f : table.last + 0.49f);
    const Whole line = begin_of(table, of_row, at);
    const Whole ray = line + of_angle.index;
    const auto seen = [&](const float* values) HWY_ATTR -> RaySeen {
        return {gather2(values + angles, line, width, at.way),
                between(of_angle.way, gather2(values, ray, width, at.way),
                        gather2(values + 1, ray, width, at.way))};
    };
    RaySeen result = seen(table.wedges);
    if (between_rows) {
        const RaySeen next = seen(table.wedges + table.distances * width);
        result.half = between(of_row.way, result.half, next.half);
        result.beyond = between(of_row.way, result.beyond, next.beyond);
    }
    result.beyond = result.half - hn::CopySign(result.beyond, along);
    return result;
}

// From the foot of the perpendicular on a line to where the other begins to lie behind it.
HWY_INLINE Vector ray_begin(const WedgeAngle& angle, Vector to_line, Vector to_other) {
    return hn::MulSub(all(angle.cosine), to_line, to_other) * all(angle.inverse_sine);
}

// What points see beyond two lines and beyond each of them.
struct WedgeSeen {
    Vector both, a, b;
};

template <bool between_rows>
HWY_INLINE WedgeSeen wedge_seen(const WedgeRows& table, const WedgeAngle& angle, Vector to_a,
                                Vector to_b, Vector row_a, Vector row_b) {
    const Vector zero = hn::Zero(tag), one = all(1.0f);
    const RaySeen ray_a =
        ray_seen<between_rows>(table, hn::Abs(to_a), ray_begin(angle, to_a, to_b), row_a);
    const RaySeen ray_b =
        ray_seen<between_rows>(table, hn::Abs(to_b), ray_begin(angle, to_b, to_a), row_b);
    const Mask beyond_a = hn::Ge(to_a, zero), beyond_b = hn::Ge(to_b, zero);
    const auto from = [&](Mask beyond, Vector part)
                          HWY_ATTR { return hn::IfThenElse(beyond, hn::Neg(part), part); };
    const auto whole_line = [&](Mask beyond, Vector half) HWY_ATTR {
        return hn::IfThenElse(beyond, one - (half + half), half + half);
    };
    return {hn::IfThenElseZero(hn::And(beyond_a, beyond_b), one) +
                (from(beyond_a, ray_a.beyond) + from(beyond_b, ray_b.beyond)),
            whole_line(beyond_a, ray_a.half), whole_line(beyond_b, ray_b.half)};
}

HWY_INLINE Vector density(const WedgeRows& table, Vector distance, Vector row) {
    constexpr int width = WedgeTable::wedge_values;
    const Place at = distance_place(table, distance), of_row(row, table.last - 0.01f);
    const Whole index = begin_of(table, of_row, at);
    const float* densities = table.wedges + WedgeTable::angles + 1;
    return between(of_row.way, gather2(densities, index, width, at.way),
                   gather2(densities + table.distances * width, index, width, at.way));
}

// How a line lies on the lens, seen from points: the vector w of TileGeometry.
struct Across {
    Vector x, y, square;

    HWY_INLINE Across(const EdgeCut& cut, Vector to_line, Vector blur)
        : x(hn::MulSub(blur, all(cut.of.line.blur_x), to_line * all(cut.tile->lens_turn_x))),
          y(hn::MulSub(blur, all(cut.of.line.blur_y), to_line * all(cut.tile->lens_turn_y))),
          square(hn::MulAdd(x, x, y * y)) {}
};

// Each ray has the blur across its own line. Lines whose angle on the lens is not the sensor's
// (distortion, tilt) see more where they cross: by so many times the density there.
template <bool between_rows>
HWY_INLINE WedgeSeen points_beyond(const EdgeCut& a, const EdgeCut& b, const WedgeAngle& angle,
                                   Vector to_a, Vector to_b, Vector blur) {
    constexpr float least = 3e-5f;  // some thousandths of a gray
    const WedgeRows& table = *a.table;
    const Across on_a(a, to_a, blur), on_b(b, to_b, blur);
    const Vector row_a = row_of_blur(table, on_a.square), row_b = row_of_blur(table, on_b.square);
    WedgeSeen seen = wedge_seen<between_rows>(table, angle, to_a, to_b, row_a, row_b);
    const Vector together = hn::MulAdd(on_a.x, on_b.x, on_a.y * on_b.y);
    const Vector shear =
        all(0.125f * angle.inverse_sine) *
        hn::NegMulAdd(all(angle.cosine), on_a.square + on_b.square, together + together);
    if (!hn::AllTrue(tag, hn::Lt(hn::Abs(shear), all(least)))) {
        const Vector along = ray_begin(angle, to_a, to_b);
        const Vector apart = hn::Sqrt(hn::MulAdd(to_a, to_a, along * along));
        seen.both = hn::MulAdd(shear, density(table, apart, row_a), seen.both);
    }
    return seen;
}

// Of one pixel, over many points.
template <bool between_rows>
HWY_INLINE float many_points(const EdgeCut& a, const EdgeCut& b, const WedgeAngle& angle,
                             std::size_t lane) {
    static constexpr PixelNodes nodes;
    Vector both = hn::Zero(tag), mean_a = both, mean_b = both;
    for (std::size_t n = 0; n < PixelNodes::count; n += hn::Lanes(tag)) {
        const Vector x = load(nodes.x + n), y = load(nodes.y + n), weight = load(nodes.weight + n);
        const auto to = [&](const EdgeCut& cut) HWY_ATTR {
            return hn::MulAdd(x, all(cut.normal_x[lane]),
                              hn::MulAdd(y, all(cut.normal_y[lane]), all(cut.distance[lane])));
        };
        const Vector blur = hn::MulAdd(x, all(a.tile->blur_slope_x),
                                       hn::MulAdd(y, all(a.tile->blur_slope_y), all(a.blur[lane])));
        const WedgeSeen seen = points_beyond<between_rows>(a, b, angle, to(a), to(b), blur);
        both = hn::MulAdd(weight, seen.both, both);
        mean_a = hn::MulAdd(weight, seen.a, mean_a);
        mean_b = hn::MulAdd(weight, seen.b, mean_b);
    }
    const auto sum = [](Vector parts) HWY_ATTR { return hn::GetLane(hn::SumOfLanes(tag, parts)); };
    const auto beyond = [&](const EdgeCut& other, const EdgeCut& cut) HWY_ATTR {
        const float foot = other.distance[lane] - angle.cosine * cut.distance[lane];
        const float chords = foot * angle.inverse_sine * cut.of.per_chord;
        return HWY_MAX(0.0f, HWY_MIN(1.0f, 0.5f + chords));
    };
    const float part = sum(both) + (a.area[lane] - sum(mean_a)) * beyond(b, a) +
                       (b.area[lane] - sum(mean_b)) * beyond(a, b);
    return HWY_MAX(0.0f, HWY_MIN(1.0f, part));
}

// Where the line may be sharp within the pixel.
HWY_INLINE Mask passes(const EdgeCut& cut, Vector blur) {
    constexpr float beside = 0.35f, of_blur = 0.25f;
    const Vector within = hn::MulAdd(all(of_blur), blur, all(0.5f * cut.of.extent + beside));
    return hn::Lt(hn::Abs(load(cut.distance)), within);
}

// Replaces the parts of pixels in which both lines may be sharp.
HWY_INLINE void average_crossed(const EdgeCut& a, const EdgeCut& b, const WedgeAngle& angle,
                                float* parts) {
    constexpr float sharp_px = 0.01f;  // up to this blur the table's first row is good enough
    const Vector blur = hn::Abs(load(a.blur));
    const Mask crossed = hn::And(passes(a, blur), passes(b, blur));
    if (hn::AllFalse(tag, crossed))
        return;
    const Vector slope = hn::Abs(all(a.tile->blur_slope_x)) + hn::Abs(all(a.tile->blur_slope_y));
    HWY_ALIGN float is_crossed[block], blurs[block];
    store(hn::IfThenElseZero(crossed, all(1.0f)), is_crossed);
    store(blur + slope, blurs);
    for (std::size_t lane = 0; lane < hn::Lanes(tag); ++lane)
        if (is_crossed[lane] != 0.0f)
            parts[lane] = blurs[lane] < sharp_px ? many_points<false>(a, b, angle, lane)
                                                 : many_points<true>(a, b, angle, lane);
}

// The mean over each pixel beyond both lines. Where they cross elsewhere, one of them at most is
// sharp within the pixel: the product of the edges' parts is right but for something smooth, of
// which 2 x 2 points are enough.
HWY_INLINE Vector overlap_of(const EdgeCut& a, const EdgeCut& b) {
    const WedgeAngle angle(a.of.line, b.of.line);
    const Vector to_a = load(a.distance), to_b = load(b.distance);
    const Vector area_a = load(a.area), area_b = load(b.area);
    Vector both = hn::Zero(tag), mean_a = both, mean_b = both;
    for (const float y : {-gauss2, gauss2})
        for (const float x : {-gauss2, gauss2}) {
            const auto to = [&](const EdgeCut& cut, Vector to_line) HWY_ATTR {
                return hn::MulAdd(all(x), load(cut.normal_x),
                                  hn::MulAdd(all(y), load(cut.normal_y), to_line));
            };
            const Vector blur =
                load(a.blur) + all(x * a.tile->blur_slope_x + y * a.tile->blur_slope_y);
            const WedgeSeen seen =
                points_beyond<false>(a, b, angle, to(a, to_a), to(b, to_b), blur);
            both = both + seen.both;
            mean_a = mean_a + seen.a;
            mean_b = mean_b + seen.b;
        }
    const Vector quarter = all(0.25f);
    const auto beyond = [&](Vector to_other, Vector to_line, const EdgeCut& cut) HWY_ATTR {
        const Vector foot = hn::NegMulAdd(all(angle.cosine), to_line, to_other);
        const Vector per_chord = all(angle.inverse_sine * cut.of.per_chord);
        return hn::Clamp(hn::MulAdd(foot, per_chord, all(0.5f)), hn::Zero(tag), all(1.0f));
    };
    Vector part = quarter * both;
    part = hn::MulAdd(hn::NegMulAdd(quarter, mean_a, area_a), beyond(to_b, to_a, a), part);
    part = hn::MulAdd(hn::NegMulAdd(quarter, mean_b, area_b), beyond(to_a, to_b, b), part);
    HWY_ALIGN float parts[block];
    store(hn::Clamp(part, least_overlap(area_a, area_b), largest_overlap(area_a, area_b)), parts);
    average_crossed(a, b, angle, parts);
    return load(parts);
}

void add_wedge_pixels(const TileGeometry& tile, const TilePatch& patch,
                      const TilePositions& positions, const WedgeRows& table, float* values) {
    const int degree = significant_degree(tile);
    const PartShapes shapes = part_shapes(tile, positions.n);
    EdgeCut columns[TilePatch::capacity], rows[TilePatch::capacity];
    HWY_ALIGN float blur[block];
    const auto begin = [&](const TileLine* lines, std::size_t count, EdgeCut* cuts) HWY_ATTR {
        for (std::size_t i = 0; i < count; ++i) {
            cuts[i].of = WedgeLine(tile, lines[i]);
            cuts[i].tile = &tile;
            cuts[i].table = &table;
            cuts[i].blur = blur;
        }
    };
    begin(patch.columns.data(), patch.column_count, columns);
    begin(patch.rows.data(), patch.row_count, rows);
    HWY_ALIGN float sums[block];
    for (std::size_t lane = 0; lane < block; lane += hn::Lanes(tag)) {
        const Vector s = hn::LoadU(tag, positions.s.data() + lane);
        const Vector t = hn::LoadU(tag, positions.t.data() + lane);
        const auto at = [&](const std::array<float, 16>& c)
                            HWY_ATTR { return bicubic(c, degree, s, t); };
        const Pixels pixels{at(tile.dx),       at(tile.dy),       at(shapes.x_by_s),
                            at(shapes.y_by_s), at(shapes.x_by_t), at(shapes.y_by_t)};
        store(blur_at(tile, pixels.dx, pixels.dy), blur);
        for (std::size_t i = 0; i < patch.column_count; ++i)
            cut_pixels(pixels, columns[i]);
        for (std::size_t j = 0; j < patch.row_count; ++j)
            cut_pixels(pixels, rows[j]);
        store(sum_of_cells(patch, {0, patch.column_count, 0, patch.row_count}, columns, rows),
              sums + lane);
    }
    add_block(sums, 0, 4, values);
}

}  // namespace
}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace etalon {
namespace {

HWY_EXPORT(add_wedge_pixels);

}  // namespace

void wedge_pixels(const TileGeometry& geometry, const TilePositions& positions,
                  const WedgeRows& table, float* values) {
    sum_patches(geometry, positions.n, values, [&](const TilePatch& patch) {
        HWY_DYNAMIC_DISPATCH(add_wedge_pixels)(geometry, patch, positions, table, values);
    });
}

}  // namespace etalon
#endif
