// Vectors stand in an array here, which those of unknown size cannot.
#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/tiles/filter_simd.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstdint>

#include "sim/tiles/filter_simd.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Vector16 = hn::CappedTag<float, 16>;

// Calls body(d, x) for the vectors from x on up to `count`, ever smaller ones to the end: the same
// operations, so that a value does not depend on its place.
template <class D, class Body>
HWY_INLINE int for_whole_vectors(D d, int x, int count, const Body& body) {
    const int n = static_cast<int>(hn::Lanes(d));
    for (; x + n <= count; x += n)
        body(d, x);
    return x;
}
template <class Body>
HWY_INLINE void for_vectors(int count, const Body& body) {
    int x = for_whole_vectors(Vector16(), 0, count, body);
    x = for_whole_vectors(hn::CappedTag<float, 4>(), x, count, body);
    for_whole_vectors(hn::CappedTag<float, 1>(), x, count, body);
}

float sum_eight(const float* from, std::ptrdiff_t stride, const float weights[8]) {
    float even = 0.0f, odd = 0.0f;
    for (int tap = 0; tap < 8; tap += 2) {
        even += weights[tap] * from[tap * stride];
        odd += weights[tap + 1] * from[(tap + 1) * stride];
    }
    return even + odd;
}

// Four output rows of one or two vectors: four or eight sums run side by side and hide each other's
// latency. (The second half is not used of one vector.)
struct RowSums {
    hn::Vec<Vector16> first, second;
};
struct FourRows {
    RowSums a, b, c, e;
};

HWY_INLINE void add_row(RowSums& sums, hn::Vec<Vector16> first, hn::Vec<Vector16> second, bool wide,
                        float weight) {
    const auto w = hn::Set(Vector16(), weight);
    sums.first = hn::MulAdd(first, w, sums.first);
    if (wide)
        sums.second = hn::MulAdd(second, w, sums.second);
}

// The window's rows `row` ... `end` - 1, which only the output rows `least` to `most` see.
template <bool wide, int least, int most>
HWY_INLINE void add_window_rows(const MirroredKernel& kernel, const float* window,
                                std::ptrdiff_t stride, int row, int end, FourRows& sums) {
    const Vector16 d;
    const std::ptrdiff_t n = static_cast<std::ptrdiff_t>(hn::Lanes(d));
    const std::ptrdiff_t step = std::ptrdiff_t{kernel.k} * kernel.pairs;
    FourRows s = sums;  // in registers
    for (window += row * stride; row < end; ++row, window += stride) {
        const int first = kernel.first_pairs[row];
        const float* w = kernel.weights + row * std::ptrdiff_t{kernel.pairs} + first;
        for (int p = first; p < kernel.pairs; ++p, ++w) {
            const float *left = window + kernel.left[p], *right = window + kernel.right[p];
            const auto s0 = hn::Add(hn::LoadU(d, left), hn::LoadU(d, right));
            const auto s1 = wide ? hn::Add(hn::LoadU(d, left + n), hn::LoadU(d, right + n)) : s0;
            if (least <= 0)
                add_row(s.a, s0, s1, wide, w[3 * step]);
            if (least <= 1 && most >= 1)
                add_row(s.b, s0, s1, wide, w[2 * step]);
            if (least <= 2 && most >= 2)
                add_row(s.c, s0, s1, wide, w[step]);
            if (most >= 3)
                add_row(s.e, s0, s1, wide, w[0]);
        }
    }
    sums = s;
}

// All rows of the window. The first see one, two and three of the outputs only, the last likewise.
template <bool wide>
HWY_INLINE void add_window(const MirroredKernel& kernel, const float* window, std::ptrdiff_t stride,
                           FourRows& sums) {
    const int k = kernel.k, rows = kernel.rows;
    if (rows < 3 * k)
        return add_window_rows<wide, 0, 3>(kernel, window, stride, 0, rows + 3 * k, sums);
    add_window_rows<wide, 0, 0>(kernel, window, stride, 0, k, sums);
    add_window_rows<wide, 0, 1>(kernel, window, stride, k, 2 * k, sums);
    add_window_rows<wide, 0, 2>(kernel, window, stride, 2 * k, 3 * k, sums);
    add_window_rows<wide, 0, 3>(kernel, window, stride, 3 * k, rows, sums);
    add_window_rows<wide, 1, 3>(kernel, window, stride, rows, rows + k, sums);
    add_window_rows<wide, 2, 3>(kernel, window, stride, rows + k, rows + 2 * k, sums);
    add_window_rows<wide, 3, 3>(kernel, window, stride, rows + 2 * k, rows + 3 * k, sums);
}

template <bool wide>
HWY_ATTR void add_to(const RowSums& row, float* out) {
    const Vector16 d;
    hn::StoreU(hn::Add(row.first, hn::LoadU(d, out)), d, out);
    if (wide) {
        float* to = out + hn::Lanes(d);
        hn::StoreU(hn::Add(row.second, hn::LoadU(d, to)), d, to);
    }
}

template <bool wide>
HWY_INLINE void add_to(const FourRows& sums, float* out, std::ptrdiff_t stride) {
    add_to<wide>(sums.a, out);
    add_to<wide>(sums.b, out + stride);
    add_to<wide>(sums.c, out + 2 * stride);
    add_to<wide>(sums.e, out + 3 * stride);
}

// Large kernels in bands of rows: a sum of a million products in single precision loses what each
// of them adds.
template <bool wide>
HWY_ATTR void add_four_rows(const MirroredKernel& kernel, const float* window,
                            std::ptrdiff_t stride, float* out, std::ptrdiff_t out_stride) {
    constexpr int max_products = 1024;
    const RowSums zero{hn::Zero(Vector16()), hn::Zero(Vector16())};
    const int rows = kernel.rows + 3 * kernel.k;
    const int band = std::max(1, max_products / std::max(1, kernel.pairs));
    if (rows <= band) {
        FourRows sums{zero, zero, zero, zero};
        add_window<wide>(kernel, window, stride, sums);
        return add_to<wide>(sums, out, out_stride);
    }
    for (int begin = 0; begin < rows; begin += band) {
        FourRows sums{zero, zero, zero, zero};
        add_window_rows<wide, 0, 3>(kernel, window, stride, begin, std::min(begin + band, rows),
                                    sums);
        add_to<wide>(sums, out, out_stride);
    }
}

void add_convolved(const MirroredKernel& kernel, const float* window, std::ptrdiff_t stride,
                   int width, int height, float* out, std::ptrdiff_t out_stride) {
    const int n = static_cast<int>(hn::Lanes(Vector16()));
    for (int x = 0; x < width;) {
        const bool wide = x + 2 * n <= width;
        for (int y = 0; y < height; y += MirroredKernel::rows_at_once) {
            const float* from = window + y * kernel.k * stride + x;
            float* to = out + y * out_stride + x;
            if (wide)
                add_four_rows<true>(kernel, from, stride, to, out_stride);
            else
                add_four_rows<false>(kernel, from, stride, to, out_stride);
        }
        x += wide ? 2 * n : n;
    }
}

void fill_row(float value, std::ptrdiff_t count, bool past_caches, float* out) {
    const Vector16 d;
    const auto n = static_cast<std::ptrdiff_t>(hn::Lanes(d));
    std::ptrdiff_t x = 0;
    if (past_caches) {
        const auto misplaced = static_cast<std::ptrdiff_t>(
            reinterpret_cast<std::uintptr_t>(out) / sizeof(float) % static_cast<std::uintptr_t>(n));
        for (const std::ptrdiff_t aligned = (n - misplaced) % n; x < std::min(aligned, count); ++x)
            out[x] = value;
        for (; x + n <= count; x += n)
            hn::Stream(hn::Set(d, value), d, out + x);
        hwy::FlushStream();
    }
    for_vectors(static_cast<int>(count - x), [&](auto part, int i) HWY_ATTR {
        hn::StoreU(hn::Set(part, value), part, out + x + i);
    });
}

void sum_eight_rows(const float* from, std::ptrdiff_t stride, const float weights[8], int width,
                    float* to) {
    int x = for_whole_vectors(Vector16(), 0, width, [&](auto d, int at) HWY_ATTR {
        auto even = hn::Zero(d), odd = even;
        for (int tap = 0; tap < 8; tap += 2) {
            const float* row = from + tap * stride + at;
            even = hn::MulAdd(hn::Set(d, weights[tap]), hn::LoadU(d, row), even);
            odd = hn::MulAdd(hn::Set(d, weights[tap + 1]), hn::LoadU(d, row + stride), odd);
        }
        hn::StoreU(even + odd, d, to + at);
    });
    for (; x < width; ++x)
        to[x] = sum_eight(from + x, stride, weights);
}

void thin_row(const float* from, const float weights[8], int count, float* to) {
    int x = for_whole_vectors(Vector16(), 0, count, [&](auto d, int at) HWY_ATTR {
        auto even = hn::Zero(d), odd = even, first = even, second = even;
        for (int tap = 0; tap < 8; tap += 2) {
            hn::LoadInterleaved2(d, from + 2 * at + tap, first, second);
            even = hn::MulAdd(hn::Set(d, weights[tap]), first, even);
            odd = hn::MulAdd(hn::Set(d, weights[tap + 1]), second, odd);
        }
        hn::StoreU(even + odd, d, to + at);
    });
    for (; x < count; ++x)
        to[x] = sum_eight(from + 2 * x, 1, weights);
}

void fill_phases(float value, int columns, int k, int rows, std::ptrdiff_t phase,
                 std::ptrdiff_t window_stride, float* to) {
    const Vector16 d;
    const int n = static_cast<int>(hn::Lanes(d));
    const auto v = hn::Set(d, value);
    for (int row = 0; row < rows; ++row, to += window_stride)
        for (int q = 0; q < k; ++q)
            for (int x = 0; x < columns; x += n)
                hn::StoreU(v, d, to + q * phase + x);
}

void split_phases(const float* from, int k, int rows, std::ptrdiff_t phase,
                  std::ptrdiff_t window_stride, float* to) {
    const hn::CappedTag<float, 4> d;
    const int n = static_cast<int>(hn::Lanes(d));
    hn::Vec<decltype(d)> v[4];
    for (int row = 0; row < rows; ++row, from += 4 * k, to += window_stride)
        for (int x = 0; x < 4; x += n) {
            const float* at = from + k * x;
            if (k == 1)
                v[0] = hn::LoadU(d, at);
            else if (k == 2)
                hn::LoadInterleaved2(d, at, v[0], v[1]);
            else if (k == 3)
                hn::LoadInterleaved3(d, at, v[0], v[1], v[2]);
            else if (k == 4)
                hn::LoadInterleaved4(d, at, v[0], v[1], v[2], v[3]);
            for (int q = 0; q < k; ++q)
                if (k <= 4)
                    hn::StoreU(v[q], d, to + q * phase + x);
                else
                    for (int i = 0; i < n; ++i)
                        to[q * phase + x + i] = at[k * i + q];
        }
}

// Sums of the columns of each row of parts, four columns at a time, then of these.
void average_parts(const float* values, int side, int parts, float* averages) {
    const hn::CappedTag<float, 4> d;
    const int n = static_cast<int>(hn::Lanes(d)), part = side / parts;
    constexpr int most = 4 * 48;  // more samples a tile side than any plan takes
    const float share = 1.0f / static_cast<float>(part * part);
    for (int y = 0; y < parts; ++y, values += part * side) {
        float columns[most];
        for (int x = 0; x < side; x += n) {
            auto even = hn::Zero(d), odd = even;
            for (int row = 0; row + 1 < part; row += 2) {
                even = hn::Add(even, hn::LoadU(d, values + row * side + x));
                odd = hn::Add(odd, hn::LoadU(d, values + (row + 1) * side + x));
            }
            if (part % 2 != 0)
                even = hn::Add(even, hn::LoadU(d, values + (part - 1) * side + x));
            hn::StoreU(hn::Add(even, odd), d, columns + x);
        }
        const float* column = columns;
        for (int x = 0; x < parts; ++x) {
            float sum = 0.0f;
            for (int i = 0; i < part; ++i)
                sum += *column++;
            *averages++ = sum * share;
        }
    }
}

void add_constant(float value, int width, int height, float* out, std::ptrdiff_t stride) {
    for (int y = 0; y < height; ++y, out += stride)
        for_vectors(width, [&](auto d, int x) HWY_ATTR {
            hn::StoreU(hn::Add(hn::Set(d, value), hn::LoadU(d, out + x)), d, out + x);
        });
}

// The sum of weights[n] times the values at at(n), and its mirror image from at(6) on.
template <class D, class At, class V>
HWY_INLINE void sum_mirrored(D d, const float weights[6], const At& at, V& even, V& odd) {
    even = hn::Mul(hn::Set(d, weights[0]), hn::LoadU(d, at(0)));
    odd = hn::Mul(hn::Set(d, weights[0]), hn::LoadU(d, at(6)));
    for (int n = 1; n < 6; ++n) {
        const auto weight = hn::Set(d, weights[n]);
        even = hn::MulAdd(weight, hn::LoadU(d, at(n)), even);
        odd = hn::MulAdd(weight, hn::LoadU(d, at(6 - n)), odd);
    }
}

void sum_row_pair(const float* const rows[7], const float weights[6], int width, float* even,
                  float* odd) {
    for_vectors(width, [&](auto d, int x) HWY_ATTR {
        auto before = hn::Zero(d), behind = before;
        const auto at = [&](int n) HWY_ATTR { return rows[n] + x; };
        sum_mirrored(d, weights, at, before, behind);
        hn::StoreU(before, d, even + x);
        hn::StoreU(behind, d, odd + x);
    });
}

// Fine samples before and behind the coarse samples from `coarse` on, to be interleaved.
template <class D, class V>
HWY_INLINE void interpolate(D d, const float* coarse, const float* weights, V& even, V& odd) {
    const auto at = [&](int n) HWY_ATTR { return coarse + n - 3; };
    sum_mirrored(d, weights, at, even, odd);
}

void put_interpolated(const float* coarse, const float weights[6], int first, int last,
                      std::optional<float> base, float* out) {
    const bool add = !base;
    const float value = add ? 0.0f : *base;
    const auto put_one = [&](int f) HWY_ATTR {
        const hn::CappedTag<float, 1> one;
        auto even = hn::Zero(one), odd = even;
        interpolate(one, coarse + (f >> 1), weights, even, odd);
        float* to = out + f - first;
        const auto before = add ? hn::LoadU(one, to) : hn::Set(one, value);
        hn::StoreU(hn::Add((f & 1) != 0 ? odd : even, before), one, to);
    };
    const int begin = first + (first & 1), pairs = std::max(0, last - begin) / 2;
    if (first < std::min(begin, last))
        put_one(first);
    for_vectors(pairs, [&](auto d, int i) HWY_ATTR {
        auto even = hn::Zero(d), odd = even, even_before = hn::Set(d, value),
             odd_before = even_before;
        interpolate(d, coarse + (begin >> 1) + i, weights, even, odd);
        float* to = out + begin - first + 2 * i;
        if (add)
            hn::LoadInterleaved2(d, to, even_before, odd_before);
        hn::StoreInterleaved2(hn::Add(even, even_before), hn::Add(odd, odd_before), d, to);
    });
    if (begin + 2 * pairs < last)
        put_one(begin + 2 * pairs);
}

// In a square: its own value in the middle, and from there the ways to its neighbours' values.
void put_ramps(const float* coarse, int shift, int first, int last, bool add, bool past_caches,
               float* out) {
    const hn::CappedTag<float, 8> d;
    const int n = static_cast<int>(hn::Lanes(d)), side = 1 << shift;
    const auto zero = hn::Zero(d), step = hn::Set(d, 1.0f / static_cast<float>(side));
    const auto half_before = hn::Set(d, 0.5f / static_cast<float>(side) - 0.5f);
    const auto place = static_cast<int>(reinterpret_cast<std::uintptr_t>(out) / sizeof(float) % 8);
    const bool stream = !add && past_caches && ((place - first) & 7) == 0;
    for (int x = first & -n; x < last; x += n) {
        const float* here = coarse + (x >> shift);
        const auto middle = hn::Set(d, here[0]), from_left = middle - hn::Set(d, here[-1]);
        const auto to_right = hn::Set(d, here[1]) - middle;
        const auto in_square = hn::Iota(d, static_cast<float>(x & (side - 1)));
        const auto way = hn::MulAdd(in_square, step, half_before);
        const auto ramp = hn::MulAdd(hn::Min(way, zero), from_left,
                                     hn::MulAdd(hn::Max(way, zero), to_right, middle));
        float* to = out + (x - first);
        if (x < first || x + n > last) {
            HWY_ALIGN float values[8];
            hn::Store(ramp, d, values);
            for (int i = std::max(0, first - x); i < std::min(n, last - x); ++i)
                to[i] = add ? values[i] + to[i] : values[i];
        } else if (add) {
            hn::StoreU(hn::Add(ramp, hn::LoadU(d, to)), d, to);
        } else if (stream) {
            hn::Stream(ramp, d, to);
        } else {
            hn::StoreU(ramp, d, to);
        }
    }
    if (stream)
        hwy::FlushStream();
}

const FilterLoops* loops() {
    static constexpr FilterLoops all{add_convolved,    sum_eight_rows, thin_row,     fill_phases,
                                     split_phases,     average_parts,  add_constant, sum_row_pair,
                                     put_interpolated, fill_row,       put_ramps};
    return &all;
}

}  // namespace
}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace etalon {
namespace {

HWY_EXPORT(loops);

}  // namespace

const FilterLoops& filter_loops() {
    return *HWY_DYNAMIC_DISPATCH(loops)();
}

}  // namespace etalon
#endif
