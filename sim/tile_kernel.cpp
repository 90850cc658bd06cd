// Compiled once for each instruction set: foreach_target.h includes this file again and again, with
// another HWY_NAMESPACE each time. No function template of the standard library is called in it:
// the linker could keep the copy of an instruction set that another machine has not.
//
// Vectors are members of structures here, which those of unknown size cannot be.
#undef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/tile_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#include <numbers>

#include "sim/tile_kernel.h"
#include "sim/tile_patch.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Vectors of at most 16 points: one block of TilePositions or a whole part of it.
constexpr std::size_t block = 16;
using Tag = hn::CappedTag<float, block>;
using Vector = hn::Vec<Tag>;
using Mask = hn::Mask<Tag>;
constexpr Tag tag;
constexpr float pi = std::numbers::pi_v<float>;
// Keeps divisors from vanishing; its square root and its reciprocal are finite.
constexpr float tiny = 1e-30f;

HWY_INLINE Vector all(float value) {
    return hn::Set(tag, value);
}
HWY_INLINE Vector load(const float* values) {
    return hn::Load(tag, values);
}
HWY_INLINE void store(Vector v, float* values) {
    hn::Store(v, tag, values);
}

// Horner's rule: c[0] + c[1] x + ... + c[degree] x^degree.
template <int degree>
HWY_INLINE Vector polynomial(const float* c, Vector x) {
    Vector sum = all(c[degree]);
    for (int i = degree - 1; i >= 0; --i)
        sum = hn::MulAdd(sum, x, all(c[i]));
    return sum;
}

// 1 / sqrt(x), x >= tiny, to 3e-7 of itself.
HWY_INLINE Vector inverse_root(Vector x) {
#if HWY_ARCH_X86 && HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128
    // Newton's step from 12 bits or more.
    const Vector guess = hn::ApproximateReciprocalSqrt(x);
    return guess * hn::NegMulAdd(all(0.5f) * x * guess, guess, all(1.5f));
#else
    return all(1.0f) / hn::Sqrt(x);
#endif
}

// ---- Sensor points

// The terms s^i t^j with i + j <= degree of a bicubic polynomial.
template <int degree>
HWY_INLINE Vector bicubic(const float* c, Vector s, Vector t) {
    Vector sum = polynomial<HWY_MIN(3, degree - 2)>(c + 8, s);
    if constexpr (degree >= 3)
        sum = hn::MulAdd(polynomial<HWY_MIN(3, degree - 3)>(c + 12, s), t, sum);
    sum = hn::MulAdd(sum, t, polynomial<HWY_MIN(3, degree - 1)>(c + 4, s));
    return hn::MulAdd(sum, t, polynomial<HWY_MIN(3, degree)>(c, s));
}

HWY_INLINE Vector bicubic(const std::array<float, 16>& c, int degree, Vector s, Vector t) {
    if (degree == 2)
        return bicubic<2>(c.data(), s, t);
    return degree == 3 ? bicubic<3>(c.data(), s, t) : bicubic<6>(c.data(), s, t);
}

HWY_INLINE Vector blur_at(const TileGeometry& tile, Vector dx, Vector dy) {
    return hn::MulAdd(all(tile.blur_slope_x), dx,
                      hn::MulAdd(all(tile.blur_slope_y), dy, all(tile.blur)));
}

HWY_INLINE Vector distance(const TileLine& line, Vector dx, Vector dy) {
    return hn::MulAdd(all(line.gradient_x), dx,
                      hn::MulAdd(all(line.gradient_y), dy, all(line.offset)));
}

// ---- What both methods share

// Areas beyond both lines lie between these, whatever the lines and the window.
HWY_INLINE Vector least_overlap(Vector area_a, Vector area_b) {
    return hn::Max(hn::Zero(tag), area_a + area_b - all(1.0f));
}
HWY_INLINE Vector largest_overlap(Vector area_a, Vector area_b) {
    return hn::Min(area_a, area_b);
}

// Sum over the patch of contrast times area, and mixed difference times area beyond both lines.
// `Cut` is a line's Chord or BoxCut in a vector of points.
template <class Cut>
HWY_INLINE Vector sum_of_cells(const TilePatch& patch, const Cut* columns, const Cut* rows) {
    Vector sum = hn::Zero(tag);
    for (std::size_t i = 0; i < patch.column_count; ++i)
        sum = hn::MulAdd(all(patch.columns[i].contrast), load(columns[i].area), sum);
    for (std::size_t j = 0; j < patch.row_count; ++j) {
        sum = hn::MulAdd(all(patch.rows[j].contrast), load(rows[j].area), sum);
        for (std::size_t i = 0; i < patch.column_count; ++i) {
            if (patch.mixed[j][i] == 0.0f)
                continue;
            // Exact where one of the areas is 0 or 1.
            Vector overlap = load(columns[i].area) * load(rows[j].area);
            if (columns[i].crosses && rows[j].crosses &&
                !hn::AllFalse(tag, hn::And(is_cut(columns[i]), is_cut(rows[j]))))
                overlap = overlap_of(columns[i], rows[j]);
            sum = hn::MulAdd(all(patch.mixed[j][i]), overlap, sum);
        }
    }
    return sum;
}

// Adds a block's sums to the image of n x n values.
HWY_INLINE void add_block(const float* sums, std::size_t index, std::size_t n, float* values) {
    const std::size_t blocks = n / 4;
    float* corner = values + 4 * (index / blocks) * n + 4 * (index % blocks);
    for (std::size_t row = 0; row < 4; ++row)
        for (std::size_t column = 0; column < 4; ++column)
            corner[row * n + column] += sums[4 * row + column];
}

// ---- E: the aperture, a unit disk

// A line on the disk for each point of a vector: the part normal . l + offset >= 0. See
// sim/disk_area.h.
struct Chord {
    HWY_ALIGN float normal_x[block], normal_y[block], offset[block];  // offset within [-1, 1]
    HWY_ALIGN float half_length[block], half_angle[block], area[block];
    bool crosses;  // some point's aperture; else only `area` is there, 0 or 1
};

HWY_INLINE Mask is_cut(const Chord& chord) {
    return hn::Lt(hn::Abs(load(chord.offset)), all(1.0f));
}

// acos(x) / sqrt(1 - x) on [0, 1]: minimax (Remez) for acos, 6e-7 rad.
constexpr float arc_cosine[] = {1.57079569f,     -0.2145428168f, 0.08817105367f,
                                -0.04592722905f, 0.02062006212f, -0.004911174695f};
// asin(x) / x by x^2 on [0, 1/2]: minimax for asin, 3e-7 rad.
constexpr float arc_sine[] = {0.999994359f,   0.1669592553f,   0.07070499958f,
                              0.07104289101f, -0.04452862232f, 0.1111271978f};

// Fills in what follows from the offset t. Computed for the smaller part, x = |t|, whose area
// (acos x - x sqrt(1 - x^2)) / pi has no cancellation worth mentioning.
HWY_INLINE void cut_disk(Vector t, Chord& chord) {
    const Vector x = hn::Abs(t), one = all(1.0f);
    const Vector root = hn::Sqrt(one - x);
    const Vector half_length = root * hn::Sqrt(one + x);
    const Vector angle = root * polynomial<5>(arc_cosine, x);
    const Vector area = hn::ZeroIfNegative(hn::NegMulAdd(x, half_length, angle)) * all(1.0f / pi);
    const Mask major = hn::Gt(t, hn::Zero(tag));
    store(t, chord.offset);
    store(half_length, chord.half_length);
    store(hn::IfThenElse(major, all(pi) - angle, angle), chord.half_angle);
    store(hn::IfThenElse(major, one - area, area), chord.area);
}

HWY_INLINE void cut_aperture(const TileGeometry& tile, const TileLine& line, Vector dx, Vector dy,
                             Vector blur, Chord& chord) {
    const Vector offset = distance(line, dx, dy);
    const Vector slope_x = hn::NegMulAdd(all(tile.turn_x), offset, blur * all(line.gradient_x));
    const Vector slope_y = hn::NegMulAdd(all(tile.turn_y), offset, blur * all(line.gradient_y));
    const Vector square = hn::MulAdd(slope_x, slope_x, slope_y * slope_y);
    chord.crosses = !hn::AllFalse(tag, hn::Lt(offset * offset, square));
    if (!chord.crosses) {
        store(hn::IfThenElseZero(hn::Ge(offset, hn::Zero(tag)), all(1.0f)), chord.area);
        return;
    }
    // A point without blur has slope 0: its large quotient becomes a sharp step by the clamp.
    const Vector inverse = inverse_root(square + all(tiny));
    store(slope_x * inverse, chord.normal_x);
    store(slope_y * inverse, chord.normal_y);
    cut_disk(hn::Clamp(offset * inverse, all(-1.0f), all(1.0f)), chord);
}

// The angle, 0 to pi, with this sine (not negative) and cosine; accurate at every angle.
HWY_INLINE Vector angle_of(Vector sine, Vector cosine) {
    const Vector side = hn::Abs(cosine), smaller = hn::Min(sine, side);
    const Vector arc = smaller * polynomial<5>(arc_sine, smaller * smaller);
    const Vector acute = hn::IfThenElse(hn::Lt(sine, side), arc, all(0.5f * pi) - arc);
    return hn::IfThenElse(hn::Lt(cosine, hn::Zero(tag)), all(pi) - acute, acute);
}

// The fraction of the disk beyond both chords: disk_wedge_area() of sim/disk_area.cpp. Mirrored
// chords have the same areas, so that only the sine's magnitude matters.
HWY_INLINE Vector overlap_of(const Chord& a, const Chord& b) {
    const Vector ax = load(a.normal_x), ay = load(a.normal_y), bx = load(b.normal_x),
                 by = load(b.normal_y);
    const Vector cosine = hn::MulAdd(ax, bx, ay * by);
    const Vector sine = hn::Abs(hn::MulSub(ax, by, ay * bx));
    const Vector turn = angle_of(sine, cosine);
    const Vector angle_a = load(a.half_angle), angle_b = load(b.half_angle);
    const Vector length_a = load(a.half_length), length_b = load(b.half_length);
    const Vector t_a = load(a.offset), t_b = load(b.offset);

    // Where the chords cross, along each of them; the second from the first.
    const Vector along_a =
        hn::Clamp(hn::MulSub(t_a, cosine, t_b) / (sine + all(tiny)), hn::Neg(length_a), length_a);
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

HWY_INLINE Vector lens_average(const TileGeometry& tile, const TilePatch& patch, Vector dx,
                               Vector dy) {
    Chord columns[TilePatch::capacity], rows[TilePatch::capacity];
    const Vector blur = blur_at(tile, dx, dy);
    for (std::size_t i = 0; i < patch.column_count; ++i)
        cut_aperture(tile, patch.columns[i].line, dx, dy, blur, columns[i]);
    for (std::size_t j = 0; j < patch.row_count; ++j)
        cut_aperture(tile, patch.rows[j].line, dx, dy, blur, rows[j]);
    return sum_of_cells(patch, columns, rows);
}

void add_lens_averages(const TileGeometry& tile, const TilePatch& patch,
                       const TilePositions& positions, float* values) {
    const auto n = static_cast<std::size_t>(positions.n());
    const int degree = significant_degree(tile);
    for (std::size_t index = 0; index < n * n / block; ++index) {
        HWY_ALIGN float sums[block];
        for (std::size_t lane = 0; lane < block; lane += hn::Lanes(tag)) {
            const Vector s = hn::LoadU(tag, positions.s() + block * index + lane);
            const Vector t = hn::LoadU(tag, positions.t() + block * index + lane);
            const Vector dx = bicubic(tile.dx, degree, s, t), dy = bicubic(tile.dy, degree, s, t);
            store(lens_average(tile, patch, dx, dy), sums + lane);
        }
        add_block(sums, index, n, values);
    }
}

// ---- C: a part of the tile, the square [-1/2, 1/2]^2 of its own coordinates

// A line on the square for each point of a vector: the part offset + gradient . s >= 0. See
// sim/square_area.h.
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
    return {all(-1.0f) / safe, offset, across, hn::Gt(along, hn::Zero(tag))};
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
        settled &= settle(shapes, patch.columns[i].line, parts, columns[i]);
    for (std::size_t j = 0; j < patch.row_count; ++j)
        settled &= settle(shapes, patch.rows[j].line, parts, rows[j]);
    if (settled)
        return sum_of_cells(patch, columns, rows);
    Vector sum = hn::Zero(tag);
    for (const UnitLensPoint* l = lens_points; l != lens_points + lens_point_count; ++l) {
        for (std::size_t i = 0; i < patch.column_count; ++i)
            cut_parts(tile, patch.columns[i].line, parts, *l, columns[i]);
        for (std::size_t j = 0; j < patch.row_count; ++j)
            cut_parts(tile, patch.rows[j].line, parts, *l, rows[j]);
        sum = hn::MulAdd(all(l->weight), sum_of_cells(patch, columns, rows), sum);
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

const char* target_name() {
    return hwy::TargetName(HWY_TARGET);
}

}  // namespace
}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <fmt/format.h>

#include <algorithm>

#include "core/errors.h"

namespace etalon {
namespace {

HWY_EXPORT(add_lens_averages);
HWY_EXPORT(add_area_averages);
HWY_EXPORT(target_name);

// Starts with the base and lets `add` add every patch of the tile.
template <class Add>
void sum_patches(const TileGeometry& tile, int n, float* values, Add add) {
    std::fill_n(values, n * n, tile.base);
    // One patch at least in each direction: there may be lines of the other alone.
    for (std::size_t j = 0; j == 0 || j < tile.rows.size(); j += TilePatch::capacity)
        for (std::size_t i = 0; i == 0 || i < tile.columns.size(); i += TilePatch::capacity) {
            const TilePatch patch = make_tile_patch(tile, i, j);
            if (patch.column_count + patch.row_count > 0)
                add(patch);
        }
}

}  // namespace

TilePositions::TilePositions(int n) : n_(n) {
    if (n < 4 || n % 4 != 0)
        throw NumericalError(fmt::format("{} x {} points in a tile: not a multiple of 4", n, n));
    for (int block_y = 0; block_y < n; block_y += 4)
        for (int block_x = 0; block_x < n; block_x += 4)
            for (int i = 0; i < 16; ++i) {
                s_.push_back((static_cast<float>(block_x + i % 4) + 0.5f) / static_cast<float>(n) -
                             0.5f);
                t_.push_back((static_cast<float>(block_y + i / 4) + 0.5f) / static_cast<float>(n) -
                             0.5f);
            }
}

void exact_lens_samples(const TileGeometry& geometry, const TilePositions& positions,
                        float* values) {
    sum_patches(geometry, positions.n(), values, [&](const TilePatch& patch) {
        HWY_DYNAMIC_DISPATCH(add_lens_averages)(geometry, patch, positions, values);
    });
}

void exact_area_samples(const TileGeometry& geometry, const TilePositions& positions,
                        std::span<const UnitLensPoint> lens_points, float* values) {
    sum_patches(geometry, positions.n(), values, [&](const TilePatch& patch) {
        HWY_DYNAMIC_DISPATCH(add_area_averages)
        (geometry, patch, positions, lens_points.data(), lens_points.size(), values);
    });
}

const char* tile_kernel_target() {
    return HWY_DYNAMIC_DISPATCH(target_name)();
}

}  // namespace etalon
#endif
