// Compiled once for each instruction set: foreach_target.h includes this file again and again, with
// another HWY_NAMESPACE each time.
#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/tiles/tile_area_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#include "sim/tiles/tile_patch.h"
#include "sim/tiles/tile_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {
namespace {

// ---- C: a part of the tile, the square [-1/2, 1/2]^2 of its own coordinates

// A line on the square for each point of a vector: the part offset + gradient . s >= 0. See
// sim/tiles/lens_average.h.
struct BoxCut {
    HWY_ALIGN float gradient_x[block], gradient_y[block], offset[block], area[block];
    bool crosses;  // some point's square; else only `area` is there, 0 or 1
    bool settled;  // `area` is the same for every point of the lens
};

HWY_INLINE Mask is_cut(const BoxCut& cut) {
    const Vector area = load(cut.area);
    return hn::And(hn::Gt(area, hn::Zero(tag)), hn::Lt(area, all(1.0f)));
}

// Of the part that holds the square's centre: a trapezium, or all but a corner.
HWY_INLINE Vector major_area(Vector steep, Vector flat, Vector distance) {
    const Vector trapezium = hn::MulAdd(distance, all(1.0f) / steep, all(0.5f));
    const Vector leg = hn::ZeroIfNegative(all(0.5f) * (steep + flat) - distance);
    const Vector corner = hn::NegMulAdd(all(0.5f) * leg, leg / (steep * flat), all(1.0f));
    return hn::IfThenElse(hn::Le(distance, all(0.5f) * (steep - flat)), trapezium, corner);
}

HWY_INLINE Vector square_area(Vector gradient_x, Vector gradient_y, Vector offset) {
    const Vector x = hn::Abs(gradient_x), y = hn::Abs(gradient_y);
    const Vector steep = hn::Max(hn::Max(x, y), all(1e-12f));
    const Vector flat = hn::Max(hn::Min(x, y), all(1e-6f) * steep);
    const Vector major = hn::Min(major_area(steep, flat, hn::Abs(offset)), all(1.0f));
    return hn::IfThenElse(hn::Lt(offset, hn::Zero(tag)), all(1.0f) - major, major);
}

// A line offset + along s + across e >= 0 restricted to one pair of the square's sides, e = -1/2
// and e = 1/2: `along` decides which end of a side it cuts off.
struct SideCut {
    Vector inverse, offset, across;
    Mask rising;
};

HWY_INLINE SideCut side_cut(Vector along, Vector across, Vector offset) {
    const Vector safe = hn::CopySign(hn::Max(hn::Abs(along), all(tiny)), along);
    return {all(-1.0f) / safe, offset, across, hn::Gt(safe, hn::Zero(tag))};
}

// Shortens the piece [low, high] of the side e to what lies beyond the line.
HWY_INLINE void cut_side(const SideCut& cut, float e, Vector& low, Vector& high) {
    const Vector end = hn::MulAdd(cut.across, all(e), cut.offset) * cut.inverse;
    low = hn::Max(low, hn::IfThenElse(cut.rising, end, low));
    high = hn::Min(high, hn::IfThenElse(cut.rising, high, end));
}

// Length of the part of the side e beyond both lines.
HWY_INLINE Vector side_length(const SideCut& a, const SideCut& b, float e) {
    Vector low = all(-0.5f), high = all(0.5f);
    cut_side(a, e, low, high);
    cut_side(b, e, low, high);
    return hn::ZeroIfNegative(high - low);
}

// The fraction of the square beyond both lines. Seen from the point where they cross, the outline
// runs straight away or back along both lines and sweeps no area: only the square's sides count,
// each with its distance from that point. Where the point is far away, the lines are almost
// parallel and do not cross in the square: then one part holds the other, or they lie apart or
// cover the square.
HWY_INLINE Vector overlap_of(const BoxCut& a, const BoxCut& b) {
    const Vector ax = load(a.gradient_x), ay = load(a.gradient_y), at = load(a.offset);
    const Vector bx = load(b.gradient_x), by = load(b.gradient_y), bt = load(b.offset);
    // From the point of a's line that is closest to the centre along that line: however parallel
    // the lines are, the result lies on the first.
    const Vector to_line = hn::Neg(at) / hn::MulAdd(ax, ax, hn::MulAdd(ay, ay, all(tiny)));
    const Vector foot_x = ax * to_line, foot_y = ay * to_line;
    const Vector determinant = hn::MulSub(ax, by, ay * bx);
    const Vector along = hn::MulAdd(bx, foot_x, hn::MulAdd(by, foot_y, bt)) /
                         hn::CopySign(hn::Max(hn::Abs(determinant), all(tiny)), determinant);
    const Vector x = hn::MulAdd(along, ay, foot_x), y = hn::NegMulAdd(along, ax, foot_y);

    const SideCut a_upright = side_cut(ay, ax, at), b_upright = side_cut(by, bx, bt);
    const SideCut a_level = side_cut(ax, ay, at), b_level = side_cut(bx, by, bt);
    const Vector half = all(0.5f);
    Vector twice = side_length(a_upright, b_upright, 0.5f) * (half - x);
    twice = hn::MulAdd(side_length(a_upright, b_upright, -0.5f), half + x, twice);
    twice = hn::MulAdd(side_length(a_level, b_level, 0.5f), half - y, twice);
    twice = hn::MulAdd(side_length(a_level, b_level, -0.5f), half + y, twice);

    const Vector area_a = load(a.area), area_b = load(b.area);
    const Vector least = least_overlap(area_a, area_b), most = largest_overlap(area_a, area_b);
    const Mask opposed = hn::Lt(hn::MulAdd(ax, bx, ay * by), hn::Zero(tag));
    const Mask near = hn::Lt(hn::Max(hn::Abs(x), hn::Abs(y)), all(8.0f));
    const Vector apart = hn::IfThenElse(opposed, least, most);
    return hn::Clamp(hn::IfThenElse(near, half * twice, apart), least, most);
}

// A vector of parts: their centres, their sides and how far any line's value can change from the
// centre to the rim, px.
struct Parts {
    Vector dx, dy, blur, x_by_s, y_by_s, x_by_t, y_by_t, largest_reach;
};

// The line's area where it passes beside all of the vector's parts.
HWY_INLINE void store_uncut(Vector offset, BoxCut& cut) {
    store(hn::IfThenElseZero(hn::Ge(offset, hn::Zero(tag)), all(1.0f)), cut.area);
}

// Settles a line that passes beside every part for every point of the lens: |w| is at most
// |blur| + |turn| |D|.
HWY_INLINE bool settle(const PartShapes& shapes, const TileLine& line, const Parts& parts,
                       BoxCut& cut) {
    const Vector offset = distance(line, parts.dx, parts.dy);
    const Vector closest = hn::Abs(offset) * all(1.0f - shapes.turn) - hn::Abs(parts.blur);
    cut.settled = hn::AllTrue(tag, hn::Ge(closest, parts.largest_reach));
    cut.crosses = false;
    if (cut.settled)
        store_uncut(offset, cut);
    return cut.settled;
}

HWY_INLINE void cut_parts(const TileGeometry& tile, const TileLine& line, const Parts& parts,
                          const UnitLensPoint& l, BoxCut& cut) {
    if (cut.settled)
        return;
    // D + w . l and its gradient by (dx, dy), which is the same for the whole tile.
    const float shrink = 1.0f - tile.turn_x * l.x - tile.turn_y * l.y;
    const float shift = line.gradient_x * l.x + line.gradient_y * l.y;
    const Vector x = all(line.gradient_x * shrink + tile.blur_slope_x * shift);
    const Vector y = all(line.gradient_y * shrink + tile.blur_slope_y * shift);
    const Vector offset =
        hn::MulAdd(distance(line, parts.dx, parts.dy), all(shrink), parts.blur * all(shift));
    const Vector by_s = hn::MulAdd(x, parts.x_by_s, y * parts.y_by_s);
    const Vector by_t = hn::MulAdd(x, parts.x_by_t, y * parts.y_by_t);
    const Vector reach = all(0.5f) * (hn::Abs(by_s) + hn::Abs(by_t));
    cut.crosses = !hn::AllFalse(tag, hn::Lt(hn::Abs(offset), reach));
    if (!cut.crosses) {
        store_uncut(offset, cut);
        return;
    }
    store(by_s, cut.gradient_x);
    store(by_t, cut.gradient_y);
    store(offset, cut.offset);
    store(square_area(by_s, by_t, offset), cut.area);
}

HWY_INLINE Vector area_average(const TileGeometry& tile, const TilePatch& patch,
                               const PartShapes& shapes, const Parts& parts,
                               const UnitLensPoint* lens_points, std::size_t lens_point_count) {
    BoxCut columns[TilePatch::capacity], rows[TilePatch::capacity];
    bool settled = true;
    for (std::size_t i = 0; i < patch.column_count; ++i)
        settled &= settle(shapes, patch.columns[i], parts, columns[i]);
    for (std::size_t j = 0; j < patch.row_count; ++j)
        settled &= settle(shapes, patch.rows[j], parts, rows[j]);
    const PatchPart whole{0, patch.column_count, 0, patch.row_count};
    if (settled)
        return sum_of_cells(patch, whole, columns, rows);
    Vector sum = hn::Zero(tag);
    for (const UnitLensPoint* l = lens_points; l != lens_points + lens_point_count; ++l) {
        for (std::size_t i = 0; i < patch.column_count; ++i)
            cut_parts(tile, patch.columns[i], parts, *l, columns[i]);
        for (std::size_t j = 0; j < patch.row_count; ++j)
            cut_parts(tile, patch.rows[j], parts, *l, rows[j]);
        sum = hn::MulAdd(all(l->weight), sum_of_cells(patch, whole, columns, rows), sum);
    }
    return sum;
}

HWY_INLINE Parts parts_at(const TileGeometry& tile, const PartShapes& shapes, int degree, Vector s,
                          Vector t) {
    const Vector dx = bicubic(tile.dx, degree, s, t), dy = bicubic(tile.dy, degree, s, t);
    const Vector x_by_s = bicubic(shapes.x_by_s, degree, s, t);
    const Vector y_by_s = bicubic(shapes.y_by_s, degree, s, t);
    const Vector x_by_t = bicubic(shapes.x_by_t, degree, s, t);
    const Vector y_by_t = bicubic(shapes.y_by_t, degree, s, t);
    const Vector extent = hn::Abs(x_by_s) + hn::Abs(y_by_s) + hn::Abs(x_by_t) + hn::Abs(y_by_t);
    return {dx,
            dy,
            blur_at(tile, dx, dy),
            x_by_s,
            y_by_s,
            x_by_t,
            y_by_t,
            extent * all(0.5f * shapes.steepest)};
}

void add_area_averages(const TileGeometry& tile, const TilePatch& patch,
                       const TilePositions& positions, const UnitLensPoint* lens_points,
                       std::size_t lens_point_count, float* values) {
    const auto n = static_cast<std::size_t>(positions.n());
    const int degree = significant_degree(tile);
    const PartShapes shapes = part_shapes(tile, positions.n());
    for (std::size_t index = 0; index < n * n / block; ++index) {
        HWY_ALIGN float sums[block];
        for (std::size_t lane = 0; lane < block; lane += hn::Lanes(tag)) {
            const Vector s = hn::LoadU(tag, positions.s() + block * index + lane);
            const Vector t = hn::LoadU(tag, positions.t() + block * index + lane);
            const Parts parts = parts_at(tile, shapes, degree, s, t);
            store(area_average(tile, patch, shapes, parts, lens_points, lens_point_count),
                  sums + lane);
        }
        add_block(sums, index, n, values);
    }
}

}  // namespace
}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace etalon {
namespace {

HWY_EXPORT(add_area_averages);

}  // namespace

void exact_area_samples(const TileGeometry& geometry, const TilePositions& positions,
                        std::span<const UnitLensPoint> lens_points, float* values) {
    sum_patches(geometry, positions.n(), values, [&](const TilePatch& patch) {
        HWY_DYNAMIC_DISPATCH(add_area_averages)
        (geometry, patch, positions, lens_points.data(), lens_points.size(), values);
    });
}

}  // namespace etalon
#endif
