// Compiled once for each instruction set: foreach_target.h includes this file again and again, with
// another HWY_NAMESPACE each time.
#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/tiles/tile_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#include "sim/psf/edge_table.h"
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

// Of a part with lines of one direction only; the cells before and beyond them stand `stride`
// apart.
HWY_INLINE Vector sum_of_lines(const TileLine* lines, std::size_t count, const float* cells,
                               std::size_t stride, Vector dx, Vector dy, const Blur& blur) {
    Vector sum = all(cells[0]);
    for (std::size_t i = 0; i < count; ++i, cells += stride)
        if (const float contrast = cells[stride] - cells[0]; contrast != 0.0f)
            sum = hn::MulAdd(all(contrast), cut_aperture(lines[i], dx, dy, blur).area, sum);
    return sum;
}

HWY_INLINE void leave_out(Chord& chord) {
    chord.crosses = false;
    store(hn::Zero(tag), chord.area);
}

// Of the lines of a part of the patch; no other cuts the aperture of any of these points.
HWY_INLINE Vector lens_average(const TileGeometry& tile, const TilePatch& patch,
                               const PatchPart& part, Vector dx, Vector dy) {
    const std::size_t column_count = part.end_column - part.first_column;
    const std::size_t row_count = part.end_row - part.first_row;
    const Blur blur = blur_of(tile, dx, dy);
    const TileLine* column_lines = patch.columns.data() + part.first_column;
    const TileLine* row_lines = patch.rows.data() + part.first_row;
    const float* cells = patch.cells[part.first_row].data() + part.first_column;
    if (row_count == 0)
        return sum_of_lines(column_lines, column_count, cells, 1, dx, dy, blur);
    if (column_count == 0)
        return sum_of_lines(row_lines, row_count, cells, TilePatch::capacity + 1, dx, dy, blur);
    Chord columns[TilePatch::capacity], rows[TilePatch::capacity];
    for (std::size_t i = 0; i < column_count; ++i)
        if (patch.column_counts(part, part.first_column + i))
            store_chord(cut_aperture(column_lines[i], dx, dy, blur), columns[i]);
        else
            leave_out(columns[i]);
    for (std::size_t j = 0; j < row_count; ++j)
        if (patch.row_counts(part, part.first_row + j))
            store_chord(cut_aperture(row_lines[j], dx, dy, blur), rows[j]);
        else
            leave_out(rows[j]);
    if (any_crosses(columns, column_count) && any_crosses(rows, row_count)) {
        add_arcs(columns, column_count);
        add_arcs(rows, row_count);
    }
    return sum_of_cells(patch, part, columns, rows);
}

// Which lines may cut the aperture of a point of 16 blocks: those from `first` to before `end`, by
// their indices. Every ray of a block passes beyond those before, and none reaches those behind.
struct LinesOfBlocks {
    HWY_ALIGN float first[block], end[block];
};

HWY_INLINE void find_lines(const TileLine* lines, std::size_t count, Vector dx, Vector dy,
                           Vector radius, const BlockBounds& bounds, std::size_t lane,
                           LinesOfBlocks& found) {
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
    store(first, found.first + lane);
    store(end, found.end + lane);
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
        const Vector s = hn::LoadU(tag, positions.block_s.data() + index + lane);
        const Vector t = hn::LoadU(tag, positions.block_t.data() + index + lane);
        const Vector dx = bicubic(tile.dx, degree, s, t), dy = bicubic(tile.dy, degree, s, t);
        const Vector radius = blur_of(tile, dx, dy).radius;
        find_lines(patch.columns.data(), patch.column_count, dx, dy, radius, bounds, lane,
                   parts.columns);
        find_lines(patch.rows.data(), patch.row_count, dx, dy, radius, bounds, lane, parts.rows);
    }
}

void add_lens_averages(const TileGeometry& tile, const TilePatch& patch,
                       const TilePositions& positions, float* values) {
    const auto n = static_cast<std::size_t>(positions.n);
    const int degree = significant_degree(tile);
    const BlockBounds bounds = block_bounds(tile, positions);
    BlockParts parts;
    for (std::size_t index = 0; index < n * n / block; ++index) {
        const std::size_t place = index % block;
        if (place == 0)
            find_parts(tile, degree, patch, positions, index, bounds, parts);
        const PatchPart part = parts.of(place);
        HWY_ALIGN float sums[block];
        for (std::size_t lane = 0; lane < block; lane += hn::Lanes(tag)) {
            if (part.has_no_line()) {
                store(all(patch.cells[part.first_row][part.first_column]), sums + lane);
                continue;
            }
            const Vector s = hn::LoadU(tag, positions.s.data() + block * index + lane);
            const Vector t = hn::LoadU(tag, positions.t.data() + block * index + lane);
            const Vector dx = bicubic(tile.dx, degree, s, t), dy = bicubic(tile.dy, degree, s, t);
            store(lens_average(tile, patch, part, dx, dy), sums + lane);
        }
        add_block(sums, index, n, values);
    }
}

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

// The fraction of the square beyond both lines. Seen from the point where they cross, the lines
// sweep no area: only the square's sides count, each with its distance from that point. Where the
// point is far away, the lines are almost parallel and do not cross in the square.
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
    const auto n = static_cast<std::size_t>(positions.n);
    const int degree = significant_degree(tile);
    const PartShapes shapes = part_shapes(tile, positions.n);
    for (std::size_t index = 0; index < n * n / block; ++index) {
        HWY_ALIGN float sums[block];
        for (std::size_t lane = 0; lane < block; lane += hn::Lanes(tag)) {
            const Vector s = hn::LoadU(tag, positions.s.data() + block * index + lane);
            const Vector t = hn::LoadU(tag, positions.t.data() + block * index + lane);
            const Parts parts = parts_at(tile, shapes, degree, s, t);
            store(area_average(tile, patch, shapes, parts, lens_points, lens_point_count),
                  sums + lane);
        }
        add_block(sums, index, n, values);
    }
}

// ---- Groups that see one edge

constexpr std::size_t side = EdgeGroup::side_px;
static_assert(side == block);

// The places of a row's pixels, and the distance's cubic in one row.
struct EdgeRow {
    HWY_ALIGN float c[4];

    EdgeRow(const EdgeGroup& group, int row) {
        const float t = (static_cast<float>(row) + 0.5f) / static_cast<float>(side) - 0.5f;
        const float* of = group.distance.data();
        for (int n = 0; n < 4; ++n)
            c[n] = of[n] + t * (of[4 + n] + t * (of[8 + n] + t * of[12 + n]));
    }

    HWY_INLINE Vector distance(std::size_t lane) const {
        const Vector s = hn::MulAdd(hn::Iota(tag, static_cast<float>(lane) + 0.5f),
                                    all(1.0f / side), all(-0.5f));
        return polynomial<3>(c, s);
    }
};

void average_edge(const EdgeGroup& group, float* averages) {
    const Vector inverse = all(1.0f / group.blur), one = all(1.0f);
    const Vector before = all(group.before), step = all(group.beyond - group.before);
    for (std::size_t row = 0; row < side; row += 2) {
        HWY_ALIGN float sums[side];
        for (std::size_t lane = 0; lane < side; lane += hn::Lanes(tag)) {
            Vector sum = hn::Zero(tag);
            for (std::size_t y = row; y < row + 2; ++y) {
                const EdgeRow of_row(group, static_cast<int>(y));
                const Vector offset = hn::Clamp(of_row.distance(lane) * inverse, hn::Neg(one), one);
                sum = sum + area_beyond(offset, hn::Sqrt(one - hn::Abs(offset)));
            }
            store(hn::MulAdd(sum * all(0.5f), step, before), sums + lane);
        }
        for (std::size_t x = 0; x < side / 2; ++x)
            averages[side / 4 * row + x] = 0.5f * (sums[2 * x] + sums[2 * x + 1]);
    }
}

void add_edge_rows(const EdgeGroup& group, const EdgeProfile& profile, float energy, int first,
                   int end, float* out, std::ptrdiff_t stride) {
    const hn::RebindToSigned<Tag> whole;
    const float* values = profile.values.data();
    const Vector last = all(static_cast<float>(profile.values.size() - 2));
    const Vector per_px = all(static_cast<float>(EdgeTable::per_px));
    const Vector before = all(energy * group.before), beyond = all(energy * group.beyond);
    const Vector step = all(group.beyond - group.before), shift = all(profile.shift);
    for (int row = first; row < end; ++row, out += stride) {
        const EdgeRow of_row(group, row);
        for (std::size_t lane = 0; lane < side; lane += hn::Lanes(tag)) {
            const Vector distance = of_row.distance(lane);
            const Vector place = hn::Min(hn::MulAdd(hn::Abs(distance), per_px, shift), last);
            const auto index = hn::ConvertTo(whole, place);
            const Vector way = place - hn::ConvertTo(tag, index);
            const Vector near = hn::GatherIndex(tag, values, index);
            const Vector far = hn::GatherIndex(tag, values + 1, index);
            const Vector part = step * hn::MulAdd(way, far - near, near);
            const Vector seen =
                hn::IfThenElse(hn::Lt(distance, hn::Zero(tag)), before + part, beyond - part);
            hn::StoreU(hn::LoadU(tag, out + lane) + seen, tag, out + lane);
        }
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
HWY_EXPORT(add_area_averages);
HWY_EXPORT(average_edge);
HWY_EXPORT(add_edge_rows);
HWY_EXPORT(target_name);

}  // namespace

void exact_lens_samples(const TileGeometry& geometry, const TilePositions& positions,
                        float* values) {
    sum_patches(geometry, positions.n, values, [&](const TilePatch& patch) {
        HWY_DYNAMIC_DISPATCH(add_lens_averages)(geometry, patch, positions, values);
    });
}

const char* tile_kernel_target() {
    return HWY_DYNAMIC_DISPATCH(target_name)();
}

void exact_area_samples(const TileGeometry& geometry, const TilePositions& positions,
                        std::span<const UnitLensPoint> lens_points, float* values) {
    sum_patches(geometry, positions.n, values, [&](const TilePatch& patch) {
        HWY_DYNAMIC_DISPATCH(add_area_averages)
        (geometry, patch, positions, lens_points.data(), lens_points.size(), values);
    });
}

void edge_averages(const EdgeGroup& group, float* averages) {
    HWY_DYNAMIC_DISPATCH(average_edge)(group, averages);
}

void add_edge(const EdgeGroup& group, const EdgeProfile& profile, float energy, int first, int end,
              float* out, std::ptrdiff_t stride) {
    HWY_DYNAMIC_DISPATCH(add_edge_rows)(group, profile, energy, first, end, out, stride);
}

}  // namespace etalon
#endif
