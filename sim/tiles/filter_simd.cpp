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

namespace hn = hwy::HWY_NAMESPACE;

using Vector16 = hn::CappedTag<float, 16>;

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

HWY_ATTR void AddConvolved(const MirroredKernel& kernel, const float* window, std::ptrdiff_t stride,
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

HWY_ATTR void FillRow(float value, std::ptrdiff_t count, bool past_caches, float* out) {
    const Vector16 d;
    const auto n = static_cast<std::ptrdiff_t>(hn::Lanes(d));
    const auto v = hn::Set(d, value);
    const auto misplaced = static_cast<std::ptrdiff_t>(
        reinterpret_cast<std::uintptr_t>(out) / sizeof(float) % static_cast<std::uintptr_t>(n));
    std::ptrdiff_t x = 0;
    if (past_caches) {
        for (const std::ptrdiff_t aligned = (n - misplaced) % n; x < std::min(aligned, count); ++x)
            out[x] = value;
        for (; x + n <= count; x += n)
            hn::Stream(v, d, out + x);
        hwy::FlushStream();
    }
    for (; x + n <= count; x += n)
        hn::StoreU(v, d, out + x);
    for (; x < count; ++x)
        out[x] = value;
}

HWY_ATTR void SumEightRows(const float* from, std::ptrdiff_t stride, const float weights[8],
                           int width, float* to) {
    const Vector16 d;
    const int n = static_cast<int>(hn::Lanes(d));
    int x = 0;
    for (; x + n <= width; x += n) {
        auto even = hn::Zero(d), odd = hn::Zero(d);
        for (int tap = 0; tap < 8; tap += 2) {
            const float* at = from + tap * stride + x;
            even = hn::MulAdd(hn::Set(d, weights[tap]), hn::LoadU(d, at), even);
            odd = hn::MulAdd(hn::Set(d, weights[tap + 1]), hn::LoadU(d, at + stride), odd);
        }
        hn::StoreU(even + odd, d, to + x);
    }
    for (; x < width; ++x) {
        float even = 0.0f, odd = 0.0f;
        for (int tap = 0; tap < 8; tap += 2) {
            even += weights[tap] * from[tap * stride + x];
            odd += weights[tap + 1] * from[(tap + 1) * stride + x];
        }
        to[x] = even + odd;
    }
}

HWY_ATTR void ThinRow(const float* from, const float weights[8], int count, float* to) {
    const Vector16 d;
    const int n = static_cast<int>(hn::Lanes(d));
    int x = 0;
    for (; x + n <= count; x += n) {
        auto even = hn::Zero(d), odd = hn::Zero(d);
        for (int tap = 0; tap < 8; tap += 2) {
            hn::Vec<Vector16> first, second;
            hn::LoadInterleaved2(d, from + 2 * x + tap, first, second);
            even = hn::MulAdd(hn::Set(d, weights[tap]), first, even);
            odd = hn::MulAdd(hn::Set(d, weights[tap + 1]), second, odd);
        }
        hn::StoreU(even + odd, d, to + x);
    }
    for (; x < count; ++x) {
        float even = 0.0f, odd = 0.0f;
        for (int tap = 0; tap < 8; tap += 2) {
            even += weights[tap] * from[2 * x + tap];
            odd += weights[tap + 1] * from[2 * x + tap + 1];
        }
        to[x] = even + odd;
    }
}

HWY_ATTR void FillPhases(float value, int columns, int k, int rows, std::ptrdiff_t phase,
                         std::ptrdiff_t window_stride, float* to) {
    const Vector16 d;
    const int n = static_cast<int>(hn::Lanes(d));
    const auto v = hn::Set(d, value);
    for (int row = 0; row < rows; ++row, to += window_stride)
        for (int q = 0; q < k; ++q)
            for (int x = 0; x < columns; x += n)
                hn::StoreU(v, d, to + q * phase + x);
}

HWY_ATTR void SplitPhases(const float* from, int k, int rows, std::ptrdiff_t phase,
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
HWY_ATTR void AverageParts(const float* values, int side, int parts, float* averages) {
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

HWY_ATTR void AddConstant(float value, int width, int height, float* out, std::ptrdiff_t stride) {
    const Vector16 d;
    const int n = static_cast<int>(hn::Lanes(d));
    for (int y = 0; y < height; ++y, out += stride) {
        int x = 0;
        for (; x + n <= width; x += n)
            hn::StoreU(hn::Add(hn::Set(d, value), hn::LoadU(d, out + x)), d, out + x);
        for (; x < width; ++x)
            out[x] += value;
    }
}

// From x on as many as whole vectors hold; returns where they end.
template <class D>
HWY_ATTR int sum_pair(D d, const float* const rows[7], const float weights[6], int x, int width,
                      float* even, float* odd) {
    const int n = static_cast<int>(hn::Lanes(d));
    for (; x + n <= width; x += n) {
        auto before = hn::Mul(hn::Set(d, weights[0]), hn::LoadU(d, rows[0] + x));
        auto behind = hn::Mul(hn::Set(d, weights[0]), hn::LoadU(d, rows[6] + x));
        for (int q = 1; q < 6; ++q) {
            const auto weight = hn::Set(d, weights[q]);
            before = hn::MulAdd(weight, hn::LoadU(d, rows[q] + x), before);
            behind = hn::MulAdd(weight, hn::LoadU(d, rows[6 - q] + x), behind);
        }
        hn::StoreU(before, d, even + x);
        hn::StoreU(behind, d, odd + x);
    }
    return x;
}

// Ever smaller vectors to the end: the same operations, so that a pixel does not depend on its
// place.
HWY_ATTR void SumRowPair(const float* const rows[7], const float weights[6], int width, float* even,
                         float* odd) {
    int x = sum_pair(Vector16(), rows, weights, 0, width, even, odd);
    x = sum_pair(hn::CappedTag<float, 4>(), rows, weights, x, width, even, odd);
    sum_pair(hn::CappedTag<float, 1>(), rows, weights, x, width, even, odd);
}

// Fine samples before and behind the coarse samples at `at`, to be interleaved.
template <class D, class V>
HWY_ATTR void interpolate(D d, const float* at, const float* weights, V& even, V& odd) {
    const auto c0 = hn::LoadU(d, at - 3), c1 = hn::LoadU(d, at - 2), c2 = hn::LoadU(d, at - 1);
    const auto c3 = hn::LoadU(d, at), c4 = hn::LoadU(d, at + 1), c5 = hn::LoadU(d, at + 2);
    const auto c6 = hn::LoadU(d, at + 3);
    const auto w0 = hn::Set(d, weights[0]), w1 = hn::Set(d, weights[1]);
    const auto w2 = hn::Set(d, weights[2]), w3 = hn::Set(d, weights[3]);
    const auto w4 = hn::Set(d, weights[4]), w5 = hn::Set(d, weights[5]);
    even = hn::MulAdd(w1, c1, hn::Mul(w0, c0));
    odd = hn::MulAdd(w1, c5, hn::Mul(w0, c6));
    even = hn::MulAdd(w3, c3, hn::MulAdd(w2, c2, even));
    odd = hn::MulAdd(w3, c3, hn::MulAdd(w2, c4, odd));
    even = hn::MulAdd(w5, c5, hn::MulAdd(w4, c4, even));
    odd = hn::MulAdd(w5, c1, hn::MulAdd(w4, c2, odd));
}

// Adds to `out`, whose first sample is the fine sample f, or writes with the base added: as many
// pairs as whole vectors hold. Returns where they end.
template <bool add, class D>
HWY_ATTR int interpolate_pairs(D d, const float* coarse, const float weights[6], int f, int last,
                               float base, float* out) {
    const int n = static_cast<int>(hn::Lanes(d));
    for (; f + 2 * n <= last; f += 2 * n, out += 2 * n) {
        hn::Vec<D> even, odd, even_before = hn::Set(d, base), odd_before = even_before;
        interpolate(d, coarse + (f >> 1), weights, even, odd);
        if (add)
            hn::LoadInterleaved2(d, out, even_before, odd_before);
        hn::StoreInterleaved2(hn::Add(even, even_before), hn::Add(odd, odd_before), d, out);
    }
    return f;
}

// Ever smaller vectors to the end.
template <bool add>
HWY_ATTR void interpolate_row(const float* coarse, const float weights[6], int first, int last,
                              float base, float* out) {
    const hn::CappedTag<float, 1> one;
    int f = first;
    const auto put_one = [&]() HWY_ATTR {
        hn::Vec<decltype(one)> even, odd;
        interpolate(one, coarse + (f >> 1), weights, even, odd);
        float* to = out + f - first;
        const auto before = add ? hn::LoadU(one, to) : hn::Set(one, base);
        hn::StoreU(hn::Add((f & 1) != 0 ? odd : even, before), one, to);
        ++f;
    };
    if ((f & 1) != 0 && f < last)
        put_one();
    f = interpolate_pairs<add>(Vector16(), coarse, weights, f, last, base, out + f - first);
    f = interpolate_pairs<add>(hn::CappedTag<float, 4>(), coarse, weights, f, last, base,
                               out + f - first);
    while (f < last)
        put_one();
}

HWY_ATTR void PutInterpolated(const float* coarse, const float weights[6], int first, int last,
                              bool add, float base, float* out) {
    if (add)
        interpolate_row<true>(coarse, weights, first, last, 0.0f, out);
    else
        interpolate_row<false>(coarse, weights, first, last, base, out);
}

// Where and how a row of ramps is written.
enum class RampStore { add, keep, stream };
template <RampStore how, class D>
HWY_INLINE void store_ramp(D d, hn::Vec<D> ramp, float* to) {
    if (how == RampStore::add)
        hn::StoreU(hn::Add(ramp, hn::LoadU(d, to)), d, to);
    else if (how == RampStore::stream)
        hn::Stream(ramp, d, to);
    else
        hn::StoreU(ramp, d, to);
}

// Square i's pixels: its own value in the middle, and from there the ways to its neighbours'
// values.
struct Ramp {
    using D = hn::CappedTag<float, 8>;
    using V = hn::Vec<D>;
    static constexpr D d{};

    explicit HWY_INLINE Ramp(int shift) : side(1 << shift) {}

    // Places in the square, from its middle, of a vector of pixels.
    HWY_INLINE V ways(int from) const {
        const float step = 1.0f / static_cast<float>(side);
        return hn::MulAdd(hn::Iota(d, static_cast<float>(from)), hn::Set(d, step),
                          hn::Set(d, 0.5f * step - 0.5f));
    }
    HWY_INLINE V at(V way, V middle, V from_left, V to_right) const {
        const V zero = hn::Zero(d);
        return hn::MulAdd(hn::Min(way, zero), from_left,
                          hn::MulAdd(hn::Max(way, zero), to_right, middle));
    }

    int side;
};

// The pixels of a part of a square: vectors of which some lanes are taken.
template <RampStore how>
HWY_ATTR void put_some(const Ramp& ramp, const float* here, int x, int end, float* to) {
    const Ramp::D d;
    const int n = static_cast<int>(hn::Lanes(d));
    const auto middle = hn::Set(d, here[0]), from_left = hn::Set(d, here[0] - here[-1]);
    const auto to_right = hn::Set(d, here[1] - here[0]);
    while (x < end) {
        const int lane = x & (n - 1), lanes = std::min(n - lane, end - x);
        float values[8];
        hn::StoreU(ramp.at(ramp.ways((x - lane) & (ramp.side - 1)), middle, from_left, to_right), d,
                   values);
        for (int i = 0; i < lanes; ++i)
            to[i] = values[lane + i] + (how == RampStore::add ? to[i] : 0.0f);
        x += lanes, to += lanes;
    }
}

// `count` whole squares, the first of them `here`.
template <RampStore how>
HWY_ATTR void put_squares(const Ramp& ramp, const float* here, int count, float* to) {
    const Ramp::D d;
    const int n = static_cast<int>(hn::Lanes(d));
    const auto first_ways = ramp.ways(0);
    auto middle = hn::Set(d, here[0]), from_left = hn::Sub(middle, hn::Set(d, here[-1]));
    for (int i = 0; i < count; ++i) {
        const auto next = hn::Set(d, here[i + 1]), to_right = hn::Sub(next, middle);
        store_ramp<how>(d, ramp.at(first_ways, middle, from_left, to_right), to);
        for (int part = n; part < ramp.side; part += n)
            store_ramp<how>(d, ramp.at(ramp.ways(part), middle, from_left, to_right), to + part);
        to += ramp.side;
        middle = next;
        from_left = to_right;
    }
}

template <bool add>
HWY_ATTR void ramp_row(const float* coarse, int shift, int first, int last, bool past_caches,
                       float* out) {
    constexpr RampStore how = add ? RampStore::add : RampStore::keep;
    const Ramp ramp(shift);
    const int begin = std::min(last, ((first - 1) | (ramp.side - 1)) + 1);  // of whole squares
    if (first < begin)
        put_some<how>(ramp, coarse + (first >> shift), first, begin, out);
    const int count = (last - begin) >> shift, end = begin + (count << shift);
    float* to = out + begin - first;
    const bool stream =
        !add && past_caches && reinterpret_cast<std::uintptr_t>(to) % (sizeof(float) * 8) == 0;
    if (count > 0 && stream) {
        put_squares<RampStore::stream>(ramp, coarse + (begin >> shift), count, to);
        hwy::FlushStream();
    } else if (count > 0) {
        put_squares<how>(ramp, coarse + (begin >> shift), count, to);
    }
    if (end < last)
        put_some<how>(ramp, coarse + (end >> shift), end, last, out + end - first);
}

HWY_ATTR void PutRamps(const float* coarse, int shift, int first, int last, bool add,
                       bool past_caches, float* out) {
    if (add)
        ramp_row<true>(coarse, shift, first, last, false, out);
    else
        ramp_row<false>(coarse, shift, first, last, past_caches, out);
}

}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace etalon {

HWY_EXPORT(AddConvolved);
HWY_EXPORT(SumEightRows);
HWY_EXPORT(ThinRow);
HWY_EXPORT(FillPhases);
HWY_EXPORT(SplitPhases);
HWY_EXPORT(AverageParts);
HWY_EXPORT(AddConstant);
HWY_EXPORT(SumRowPair);
HWY_EXPORT(FillRow);
HWY_EXPORT(PutInterpolated);
HWY_EXPORT(PutRamps);

void add_convolved(const MirroredKernel& kernel, const float* window, std::ptrdiff_t window_stride,
                   int width, int height, float* out, std::ptrdiff_t out_stride) {
    HWY_DYNAMIC_DISPATCH(AddConvolved)
    (kernel, window, window_stride, width, height, out, out_stride);
}

void sum_eight_rows(const float* from, std::ptrdiff_t stride, const float weights[8], int width,
                    float* to) {
    HWY_DYNAMIC_DISPATCH(SumEightRows)(from, stride, weights, width, to);
}

void thin_row(const float* from, const float weights[8], int count, float* to) {
    HWY_DYNAMIC_DISPATCH(ThinRow)(from, weights, count, to);
}

void fill_phases(float value, int columns, int k, int rows, std::ptrdiff_t phase_stride,
                 std::ptrdiff_t window_stride, float* to) {
    HWY_DYNAMIC_DISPATCH(FillPhases)(value, columns, k, rows, phase_stride, window_stride, to);
}

void split_phases(const float* from, int k, int rows, std::ptrdiff_t phase_stride,
                  std::ptrdiff_t window_stride, float* to) {
    HWY_DYNAMIC_DISPATCH(SplitPhases)(from, k, rows, phase_stride, window_stride, to);
}

void average_parts(const float* values, int side, int parts, float* averages) {
    HWY_DYNAMIC_DISPATCH(AverageParts)(values, side, parts, averages);
}

void add_constant(float value, int width, int height, float* out, std::ptrdiff_t out_stride) {
    HWY_DYNAMIC_DISPATCH(AddConstant)(value, width, height, out, out_stride);
}

void sum_row_pair(const float* const rows[7], const float weights[6], int width, float* even,
                  float* odd) {
    HWY_DYNAMIC_DISPATCH(SumRowPair)(rows, weights, width, even, odd);
}

void fill_row(float value, std::ptrdiff_t count, bool past_caches, float* out) {
    HWY_DYNAMIC_DISPATCH(FillRow)(value, count, past_caches, out);
}

void put_interpolated(const float* coarse, const float weights[6], int first, int last,
                      std::optional<float> base, float* out) {
    HWY_DYNAMIC_DISPATCH(PutInterpolated)
    (coarse, weights, first, last, !base, base.value_or(0.0f), out);
}

void put_ramps(const float* coarse, int shift, int first, int last, bool add, bool past_caches,
               float* out) {
    HWY_DYNAMIC_DISPATCH(PutRamps)(coarse, shift, first, last, add, past_caches, out);
}

}  // namespace etalon

#endif  // HWY_ONCE
