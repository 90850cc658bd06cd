// Compiled once for each instruction set: foreach_target.h includes this file again and again, with
// another HWY_NAMESPACE each time.
#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/tiles/tile_lens_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#include "sim/tiles/tile_patch.h"
#include "sim/tiles/tile_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {
namespace {

// ---- E: the aperture, a unit disk

// A line on the disk for each point of a vector: the part normal . l + offset >= 0. See
// sim/tiles/lens_average.h.
struct Chord {
    HWY_ALIGN float normal_x[block], normal_y[block], offset[block];  // offset within [-1, 1]
    HWY_ALIGN float area[block];
    HWY_ALIGN float root[block];  // of 1 - |offset|
    // Half of the chord's length, half of the angle under which the centre sees the part beyond,
    // and the normal's direction, -pi to pi: where lines of both directions cross.
    HWY_ALIGN float half_length[block], half_angle[block], direction[block];
    bool crosses;  // some point's aperture; else only `area` is there, 0 or 1
};

HWY_INLINE Mask is_cut(const Chord& chord) {
    return hn::Lt(hn::Abs(load(chord.offset)), all(1.0f));
}

// Minimax polynomials (Remez) on [0, 1].
// acos(x) / sqrt(1 - x), for acos to 6e-7 rad.
constexpr float arc_cosine[] = {1.57079569f,     -0.2145428168f, 0.08817105367f,
                                -0.04592722905f, 0.02062006212f, -0.004911174695f};
// asin(x) / x by x^2 on [0, 1/2]: minimax for asin, 3e-7 rad.
constexpr float arc_sine[] = {0.999994359f,   0.1669592553f,   0.07070499958f,
                              0.07104289101f, -0.04452862232f, 0.1111271978f};

// The angle, 0 to pi, with this sine (not negative) and cosine; accurate at every angle.
HWY_INLINE Vector angle_of(Vector sine, Vector cosine) {
    const Vector side = hn::Abs(cosine), smaller = hn::Min(sine, side);
    const Vector arc = smaller * polynomial<5>(arc_sine, smaller * smaller);
    const Vector acute = hn::IfThenElse(hn::Lt(sine, side), arc, all(0.5f * pi) - arc);
    return hn::IfThenElse(hn::Lt(cosine, hn::Zero(tag)), all(pi) - acute, acute);
}

HWY_INLINE void add_arc(Chord& chord) {
    const Vector offset = load(chord.offset), root = load(chord.root), x = hn::Abs(offset);
    const Vector angle = root * polynomial<5>(arc_cosine, x);
    const Mask major = hn::Gt(offset, hn::Zero(tag));
    store(root * hn::Sqrt(all(1.0f) + x), chord.half_length);
    store(hn::IfThenElse(major, all(pi) - angle, angle), chord.half_angle);
    const Vector sine = load(chord.normal_y);
    store(hn::CopySign(angle_of(hn::Abs(sine), load(chord.normal_x)), sine), chord.direction);
}

// What blurs at each point of a vector: w = radius gradient - turn D.
struct Blur {
    Vector radius, turn_x, turn_y;
};

HWY_INLINE Blur blur_of(const TileGeometry& tile, Vector dx, Vector dy) {
    const Vector lens = blur_at(tile, dx, dy);
    if (tile.disk == 0.0f)
        return {lens, all(tile.turn_x), all(tile.turn_y)};
    // The turn is a change of the lens' radius: it counts by the derivative.
    const Vector along = hn::Add(lens, all(tile.disk_cosine * tile.disk));
    const Vector across = all((1.0f - tile.disk_cosine * tile.disk_cosine) * tile.disk * tile.disk);
    const Vector square = hn::MulAdd(along, along, across);
    const Vector inverse = inverse_root(square + all(tiny)), share = along * inverse;
    return {square * inverse, all(tile.turn_x) * share, all(tile.turn_y) * share};
}

// Where a line cuts the apertures of a vector of points: as in Chord, and but for `area` only if it
// crosses.
struct Cut {
    Vector normal_x, normal_y, offset, root, area;
    bool crosses;
};

HWY_INLINE Cut cut_aperture(const TileLine& line, Vector dx, Vector dy, const Blur& blur) {
    Cut cut;
    const Vector offset = distance(line, dx, dy);
    const Vector slope_x = hn::NegMulAdd(blur.turn_x, offset, blur.radius * all(line.gradient_x));
    const Vector slope_y = hn::NegMulAdd(blur.turn_y, offset, blur.radius * all(line.gradient_y));
    const Vector square = hn::MulAdd(slope_x, slope_x, slope_y * slope_y);
    cut.crosses = !hn::AllFalse(tag, hn::Lt(offset * offset, square));
    if (!cut.crosses) {
        cut.area = hn::IfThenElseZero(hn::Ge(offset, hn::Zero(tag)), all(1.0f));
        return cut;
    }
    // A point without blur has slope 0: its large quotient becomes a sharp step by the clamp.
    const Vector inverse = inverse_root(square + all(tiny));
    cut.normal_x = slope_x * inverse;
    cut.normal_y = slope_y * inverse;
    cut.offset = hn::Clamp(offset * inverse, all(-1.0f), all(1.0f));
    cut.root = hn::Sqrt(all(1.0f) - hn::Abs(cut.offset));
    cut.area = area_beyond(cut.offset, cut.root);
    return cut;
}

HWY_INLINE void store_chord(const Cut& cut, Chord& chord) {
    chord.crosses = cut.crosses;
    store(cut.area, chord.area);
    if (!cut.crosses)
        return;
    store(cut.normal_x, chord.normal_x);
    store(cut.normal_y, chord.normal_y);
    store(cut.offset, chord.offset);
    store(cut.root, chord.root);
}

// The fraction of the disk beyond both chords: disk_wedge_area() of sim/tiles/lens_average.cpp.
// Mirrored chords have the same areas, so that only the sine's magnitude matters.
HWY_INLINE Vector overlap_of(const Chord& a, const Chord& b) {
    const Vector ax = load(a.normal_x), ay = load(a.normal_y), bx = load(b.normal_x),
                 by = load(b.normal_y);
    const Vector cosine = hn::MulAdd(ax, bx, ay * by);
    const Vector sine = hn::Abs(hn::MulSub(ax, by, ay * bx));
    const Vector apart = hn::Abs(load(a.direction) - load(b.direction));
    const Vector turn = hn::Min(apart, all(2.0f * pi) - apart);
    const Vector t_a = load(a.offset), t_b = load(b.offset);
    const Vector length_a = load(a.half_length), angle_a = load(a.half_angle);
    const Vector length_b = load(b.half_length), angle_b = load(b.half_angle);

    // Where the chords cross, along each of them; the second from the first.
    const Vector along_a = hn::Clamp(hn::MulSub(t_a, cosine, t_b) * reciprocal(sine + all(tiny)),
                                     hn::Neg(length_a), length_a);
    const Vector along_b =
        hn::Clamp(hn::MulAdd(t_a, sine, along_a * cosine), hn::Neg(length_b), length_b);
    const Vector twice =
        angle_a + angle_b - turn + hn::MulAdd(t_a, length_a - along_a, t_b * (length_b + along_b));

    // Where they do not: the parts lie apart or cover the disk, or one holds the other.
    const Vector area_a = load(a.area), area_b = load(b.area);
    const Vector least = least_overlap(area_a, area_b), most = largest_overlap(area_a, area_b);
    const Vector opposed = hn::Abs(angle_a + angle_b - all(pi)) - (all(pi) - turn);
    const Vector nested = hn::Abs(angle_a - angle_b) - turn;
    const Vector uncrossed = hn::IfThenElse(hn::Ge(opposed, nested), least, most);
    const Mask crossed = hn::Lt(hn::Max(opposed, nested), hn::Zero(tag));
    return hn::Clamp(hn::IfThenElse(crossed, twice * all(0.5f / pi), uncrossed), least, most);
}

HWY_INLINE bool any_crosses(const Chord* chords, std::size_t count) {
    bool crosses = false;
    for (std::size_t i = 0; i < count; ++i)
        crosses |= chords[i].crosses;
    return crosses;
}

HWY_INLINE void add_arcs(Chord* chords, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i)
        if (chords[i].crosses)
            add_arc(chords[i]);
}

HWY_INLINE void leave_out(Chord& chord) {
    chord.crosses = false;
    store(hn::Zero(tag), chord.area);
}

// Of a part with lines of one direction only.
HWY_INLINE Vector sum_of_columns(const TilePatch& patch, const PatchPart& part, Vector dx,
                                 Vector dy, const Blur& blur) {
    const float* cells = patch.cells[part.first_row].data();
    Vector sum = all(cells[part.first_column]);
    for (std::size_t i = part.first_column; i < part.end_column; ++i)
        if (patch.column_counts(part, i))
            sum = hn::MulAdd(all(cells[i + 1] - cells[i]),
                             cut_aperture(patch.columns[i], dx, dy, blur).area, sum);
    return sum;
}
HWY_INLINE Vector sum_of_rows(const TilePatch& patch, const PatchPart& part, Vector dx, Vector dy,
                              const Blur& blur) {
    const auto cell = [&](std::size_t j) { return patch.cells[j][part.first_column]; };
    Vector sum = all(cell(part.first_row));
    for (std::size_t j = part.first_row; j < part.end_row; ++j)
        if (patch.row_counts(part, j))
            sum = hn::MulAdd(all(cell(j + 1) - cell(j)),
                             cut_aperture(patch.rows[j], dx, dy, blur).area, sum);
    return sum;
}

// Of the lines of a part of the patch; no other cuts the aperture of any of these points.
HWY_INLINE Vector lens_average(const TileGeometry& tile, const TilePatch& patch,
                               const PatchPart& part, Vector dx, Vector dy) {
    const std::size_t column_count = part.end_column - part.first_column;
    const std::size_t row_count = part.end_row - part.first_row;
    const Blur blur = blur_of(tile, dx, dy);
    if (row_count == 0)
        return sum_of_columns(patch, part, dx, dy, blur);
    if (column_count == 0)
        return sum_of_rows(patch, part, dx, dy, blur);
    Chord columns[TilePatch::capacity], rows[TilePatch::capacity];
    for (std::size_t i = 0; i < column_count; ++i)
        if (patch.column_counts(part, part.first_column + i))
            store_chord(cut_aperture(patch.columns[part.first_column + i], dx, dy, blur),
                        columns[i]);
        else
            leave_out(columns[i]);
    for (std::size_t j = 0; j < row_count; ++j)
        if (patch.row_counts(part, part.first_row + j))
            store_chord(cut_aperture(patch.rows[part.first_row + j], dx, dy, blur), rows[j]);
        else
            leave_out(rows[j]);
    if (any_crosses(columns, column_count) && any_crosses(rows, row_count)) {
        add_arcs(columns, column_count);
        add_arcs(rows, row_count);
    }
    return sum_of_cells(patch, part, columns, rows);
}

// Which lines may cut the aperture of a point: those from `first` to before `end`, by their
// indices, for 16 blocks. Every ray of a block passes beyond those before, and none reaches those
// behind.
struct LinesOfBlocks {
    HWY_ALIGN float first[block], end[block];
};

HWY_INLINE void find_lines(const TileLine* lines, std::size_t count, Vector dx, Vector dy,
                           Vector radius, const BlockBounds& bounds, float* first_of_blocks,
                           float* end_of_blocks) {
    const Vector largest_radius = hn::Abs(radius) + all(bounds.blur_change);
    Vector first = hn::Zero(tag), end = hn::Zero(tag);
    Mask beyond_all = hn::Le(end, all(1.0f));
    for (std::size_t i = 0; i < count; ++i) {
        const Vector offset = distance(lines[i], dx, dy);
        const Vector closest = (hn::Abs(offset) - all(bounds.reach)) * all(1.0f - bounds.turn);
        const Mask uncut = hn::Ge(closest, largest_radius), before = hn::Lt(offset, hn::Zero(tag));
        beyond_all = hn::And(beyond_all, hn::AndNot(before, uncut));
        first = hn::IfThenElse(beyond_all, all(static_cast<float>(i + 1)), first);
        end = hn::IfThenElse(hn::And(uncut, before), end, all(static_cast<float>(i + 1)));
    }
    store(first, first_of_blocks);
    store(end, end_of_blocks);
}

// The lines of 16 blocks of points.
struct BlockParts {
    LinesOfBlocks columns, rows;

    PatchPart of(std::size_t place) const {
        return {static_cast<std::size_t>(columns.first[place]),
                static_cast<std::size_t>(columns.end[place]),
                static_cast<std::size_t>(rows.first[place]),
                static_cast<std::size_t>(rows.end[place])};
    }
};

// Of those from `index` on.
HWY_INLINE void find_parts(const TileGeometry& tile, int degree, const TilePatch& patch,
                           const TilePositions& positions, std::size_t index,
                           const BlockBounds& bounds, BlockParts& parts) {
    for (std::size_t lane = 0; lane < block; lane += hn::Lanes(tag)) {
        const Vector s = hn::LoadU(tag, positions.block_s() + index + lane);
        const Vector t = hn::LoadU(tag, positions.block_t() + index + lane);
        const Vector dx = bicubic(tile.dx, degree, s, t), dy = bicubic(tile.dy, degree, s, t);
        const Vector radius = blur_of(tile, dx, dy).radius;
        find_lines(patch.columns.data(), patch.column_count, dx, dy, radius, bounds,
                   parts.columns.first + lane, parts.columns.end + lane);
        find_lines(patch.rows.data(), patch.row_count, dx, dy, radius, bounds,
                   parts.rows.first + lane, parts.rows.end + lane);
    }
}

void add_lens_averages(const TileGeometry& tile, const TilePatch& patch,
                       const TilePositions& positions, float* values) {
    const auto n = static_cast<std::size_t>(positions.n());
    const int degree = significant_degree(tile);
    const BlockBounds bounds = block_bounds(tile, positions);
    BlockParts parts;
    for (std::size_t index = 0; index < n * n / block; ++index) {
        const std::size_t place = index % block;
        if (place == 0)
            find_parts(tile, degree, patch, positions, index, bounds, parts);
        const PatchPart part = parts.of(place);
        if (part.has_no_line()) {
            add_even_block(patch.cells[part.first_row][part.first_column], index, n, values);
            continue;
        }
        HWY_ALIGN float sums[block];
        for (std::size_t lane = 0; lane < block; lane += hn::Lanes(tag)) {
            const Vector s = hn::LoadU(tag, positions.s() + block * index + lane);
            const Vector t = hn::LoadU(tag, positions.t() + block * index + lane);
            const Vector dx = bicubic(tile.dx, degree, s, t), dy = bicubic(tile.dy, degree, s, t);
            store(lens_average(tile, patch, part, dx, dy), sums + lane);
        }
        add_block(sums, index, n, values);
    }
}

const char* target_name() {
    return hwy::TargetName(HWY_TARGET);
}

}  // namespace
}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace etalon {
namespace {

HWY_EXPORT(add_lens_averages);
HWY_EXPORT(target_name);

}  // namespace

void exact_lens_samples(const TileGeometry& geometry, const TilePositions& positions,
                        float* values) {
    sum_patches(geometry, positions.n(), values, [&](const TilePatch& patch) {
        HWY_DYNAMIC_DISPATCH(add_lens_averages)(geometry, patch, positions, values);
    });
}

const char* tile_kernel_target() {
    return HWY_DYNAMIC_DISPATCH(target_name)();
}

}  // namespace etalon
#endif
