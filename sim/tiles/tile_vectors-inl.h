// The vector code of both kernels, included once for each instruction set, into its own namespace.
// No function template of the standard library is called between HWY_BEFORE_NAMESPACE and
// HWY_AFTER_NAMESPACE: the linker could keep another instruction set's copy. Vectors are members of
// structures, which those of unknown size (SVE, RVV) cannot be.
#if defined(ETALON_SIM_TILE_VECTORS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef ETALON_SIM_TILE_VECTORS_INL_H
#undef ETALON_SIM_TILE_VECTORS_INL_H
#else
#define ETALON_SIM_TILE_VECTORS_INL_H
#endif

#include <hwy/highway.h>

#include <numbers>

#include "sim/tiles/tile_patch.h"

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

// 1 / sqrt(x) and 1 / x, x >= tiny, to 3e-7 of themselves: Newton's step from 12 bits or more.
#if HWY_ARCH_X86 && HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128
HWY_INLINE Vector inverse_root(Vector x) {
    const Vector guess = hn::ApproximateReciprocalSqrt(x);
    return guess * hn::NegMulAdd(all(0.5f) * x * guess, guess, all(1.5f));
}
HWY_INLINE Vector reciprocal(Vector x) {
    const Vector guess = hn::ApproximateReciprocal(x);
    return guess * hn::NegMulAdd(x, guess, all(2.0f));
}
#else
HWY_INLINE Vector inverse_root(Vector x) {
    return all(1.0f) / hn::Sqrt(x);
}
HWY_INLINE Vector reciprocal(Vector x) {
    return all(1.0f) / x;
}
#endif

// ---- Segments of the unit disk

// Minimax polynomial (Remez) on [0, 1]: the area beyond a chord at x by 1 - x, divided by
// (1 - x)^(3/2); 2e-8 of the disk.
constexpr float segment_area[] = {0.6002143025f,    -0.09008195996f,  -0.007776257582f,
                                  -0.002201624447f, 0.0003666134134f, -0.0005210483214f};

// The area beyond a chord at `offset`, of the smaller part first: no cancellation. `root` is that
// of 1 - |offset|.
HWY_INLINE Vector area_beyond(Vector offset, Vector root) {
    const Vector one = all(1.0f), height = one - hn::Abs(offset);
    const Vector area = height * root * polynomial<5>(segment_area, height);
    return hn::IfThenElse(hn::Gt(offset, hn::Zero(tag)), one - area, area);
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

// The cell before a part of the patch, and the sum over its lines of contrast times area, and mixed
// difference times area beyond both lines. `Cut` is a line's Chord or BoxCut in a vector of points.
template <class Cut>
HWY_INLINE Vector sum_of_cells(const TilePatch& patch, const PatchPart& part, const Cut* columns,
                               const Cut* rows) {
    const float* before = patch.cells[part.first_row].data() + part.first_column;
    Vector sum = all(before[0]);
    const std::size_t column_count = part.end_column - part.first_column;
    for (std::size_t i = 0; i < column_count; ++i)
        sum = hn::MulAdd(all(before[i + 1] - before[i]), load(columns[i].area), sum);
    for (std::size_t j = 0; j < part.end_row - part.first_row; ++j) {
        const std::size_t row = part.first_row + j;
        const float contrast =
            patch.cells[row + 1][part.first_column] - patch.cells[row][part.first_column];
        sum = hn::MulAdd(all(contrast), load(rows[j].area), sum);
        const float* mixed = patch.mixed[row].data() + part.first_column;
        for (std::size_t i = 0; i < column_count; ++i) {
            if (mixed[i] == 0.0f)
                continue;
            // Exact where one of the areas is 0 or 1.
            Vector overlap = load(columns[i].area) * load(rows[j].area);
            if (columns[i].crosses && rows[j].crosses &&
                !hn::AllFalse(tag, hn::And(is_cut(columns[i]), is_cut(rows[j]))))
                overlap = overlap_of(columns[i], rows[j]);
            sum = hn::MulAdd(all(mixed[i]), overlap, sum);
        }
    }
    return sum;
}

// Adds a block's sums to the image of n x n values.
HWY_INLINE void add_block(const float* sums, std::size_t index, std::size_t n, float* values) {
    constexpr hn::CappedTag<float, 4> four;  // of a block's row
    const std::size_t blocks = n / 4;
    float* corner = values + 4 * (index / blocks) * n + 4 * (index % blocks);
    for (std::size_t row = 0; row < 4; ++row)
        for (std::size_t column = 0; column < 4; column += hn::Lanes(four)) {
            float* to = corner + row * n + column;
            hn::StoreU(hn::LoadU(four, to) + hn::LoadU(four, sums + 4 * row + column), four, to);
        }
}

}  // namespace
}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
