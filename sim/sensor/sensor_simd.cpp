#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/sensor/sensor_simd.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>

#include "core/statistics/random.h"
#include "sim/sensor/sensor_simd.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int most_lanes = 16;
// Pixels that are done at once. Loops of few operations let the processor work on several vectors.
constexpr int stretch = 64;
using Floats = hn::CappedTag<float, most_lanes>;
using Integers = hn::RebindToSigned<Floats>;

// Codes in the low 16 bits, and which of them are doubtful.
struct Found {
    hn::Vec<Integers> codes;
    hn::Mask<Integers> doubtful;
};

#if HWY_MAX_BYTES == 64  // a register holds a number of every piece
HWY_ATTR HWY_INLINE Found follow_curve(const PiecewisePolynomial& pieces, hn::Vec<Floats> values) {
    static_assert(PiecewisePolynomial::count == most_lanes);
    const Floats d;
    const Integers di;
    const auto number = hn::ShiftRight<PiecewisePolynomial::shift>(hn::BitCast(di, values));
    const auto piece = hn::IndicesFromVec(
        d, hn::Min(hn::Max(hn::Sub(number, hn::Set(di, PiecewisePolynomial::first)), hn::Zero(di)),
                   hn::Set(di, PiecewisePolynomial::count - 1)));
    const auto u = hn::Sub(values, hn::TableLookupLanes(hn::LoadU(d, pieces.centre), piece));
    auto code =
        hn::TableLookupLanes(hn::LoadU(d, pieces.factor[PiecewisePolynomial::degree]), piece);
    for (int n = PiecewisePolynomial::degree - 1; n >= 0; --n)
        code = hn::MulAdd(code, u, hn::TableLookupLanes(hn::LoadU(d, pieces.factor[n]), piece));
    // Beside 1.5 * 2^23 floats are whole numbers, whose last bits are the low ones.
    const auto large = hn::Set(d, 0x1.8p23f);
    const auto rounded = hn::Add(code, large);
    const auto rest = hn::Abs(hn::Sub(code, hn::Sub(rounded, large)));
    const auto half = hn::Set(d, 0.5f);
    const auto is_sure = hn::And(hn::Lt(rest, hn::Set(d, 0.5f - pieces.doubt)),
                                 hn::Le(hn::Abs(hn::Sub(values, half)), half));
    return {hn::BitCast(di, rounded), hn::RebindMask(di, hn::Not(is_sure))};
}
#endif

HWY_ATTR HWY_INLINE Found look_up_codes(const StepCells& cells, const std::uint32_t* entries,
                                        bool is_rounded, hn::Vec<Floats> values) {
    const Integers d;
    const auto all = [&](std::int32_t value) { return hn::Set(d, value); };
    // -0 becomes 0.
    const auto bits = hn::BitCast(d, hn::Add(values, hn::Zero(Floats())));
    const auto is_negative = hn::ShiftRight<31>(bits);  // -1 or 0
    const auto unlimited = hn::And(bits, all(0x7fffffff));
    const auto size = hn::Min(hn::Max(unlimited, all(cells.first << cells.shift)),
                              all(cells.last << cells.shift));
    const auto cell = hn::ShiftRightSame(size, cells.shift);
    const auto side = hn::And(is_negative, all(cells.last - cells.first + 1));
    const auto entry = hn::GatherIndex(d, reinterpret_cast<const std::int32_t*>(entries),
                                       hn::Add(hn::Sub(cell, all(cells.first)), side));
    const std::int32_t last_place = (1 << cells.shift) - 1;
    const auto place = hn::And(size, all(last_place));
    const auto step = hn::And(entry, all(StepCells::doubtful - 1));
    const auto direction = hn::Or(is_negative, all(1));
    const auto is_across = hn::Not(hn::Lt(place, step));
    const auto codes = hn::Add(hn::ShiftRight<16>(entry), hn::IfThenElseZero(is_across, direction));
    constexpr std::int32_t largest = 0x7f7fffff;  // what is not finite is larger
    auto doubtful =
        hn::Or(hn::TestBit(entry, all(StepCells::doubtful)), hn::Gt(unlimited, all(largest)));
    if (is_rounded) {  // beyond the cells its own place counts, not the limited one
        const auto own = hn::And(unlimited, all(last_place));
        const auto beside_step = hn::Lt(hn::Abs(hn::Sub(own, step)), all(2));
        const auto beside_end = hn::Or(hn::Eq(own, hn::Zero(d)), hn::Eq(own, all(last_place)));
        doubtful = hn::Or(doubtful, hn::Or(beside_step, beside_end));
    }
    return {codes, doubtful};
}

template <bool follow>
HWY_ATTR HWY_INLINE Found find_codes(const StepCells& cells, const std::uint32_t* entries,
                                     bool is_rounded, hn::Vec<Floats> values) {
#if HWY_MAX_BYTES == 64
    if constexpr (follow) {
        const Found found = follow_curve(cells.pieces, values);
        if (HWY_LIKELY(hn::AllFalse(Integers(), found.doubtful)))
            return found;
    }
#endif
    return look_up_codes(cells, entries, is_rounded, values);
}

template <class Code>
struct Output {
    Code* codes;
    std::uint16_t* doubtful;
    int doubts = 0;
};

// Of the first `count` lanes, at `x`.
template <class Code>
HWY_ATTR HWY_INLINE void put_vector(const Found& found, int x, int count, Output<Code>& output) {
    const hn::RebindToUnsigned<Integers> d;
    const hn::Rebind<Code, Floats> narrow;
    HWY_ALIGN Code codes[most_lanes];
    hn::Store(hn::TruncateTo(narrow, hn::BitCast(d, found.codes)), narrow, codes);
    std::copy_n(codes, count, output.codes + x);
    if (hn::AllFalse(Integers(), found.doubtful))
        return;
    HWY_ALIGN std::int32_t is_doubtful[most_lanes] = {};
    hn::Store(hn::VecFromMask(Integers(), found.doubtful), Integers(), is_doubtful);
    for (int i = 0; i < count; ++i)
        if (is_doubtful[i] != 0)
            output.doubtful[output.doubts++] = static_cast<std::uint16_t>(x + i);
}

HWY_ATTR HWY_INLINE bool is_even(const float* values) {
    const Floats d;
    const auto first = hn::Set(d, values[0]);
    auto even = hn::Eq(first, hn::LoadU(d, values));
    for (int x = static_cast<int>(hn::Lanes(d)); x < stretch; x += static_cast<int>(hn::Lanes(d)))
        even = hn::And(even, hn::Eq(first, hn::LoadU(d, values + x)));
    return hn::AllTrue(d, even);
}

// Most of a rendered image is an even background: a stretch of it needs one code.
template <bool follow, class Code>
HWY_ATTR HWY_INLINE int put_codes(const StepCells& cells, const std::uint32_t* entries,
                                  const float* values, bool is_rounded, int count,
                                  Output<Code> output) {
    const Floats d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    int x = 0;
    for (; x + lanes <= count; x += lanes) {
        const int doubts = output.doubts;
        put_vector(find_codes<follow>(cells, entries, is_rounded, hn::LoadU(d, values + x)), x,
                   lanes, output);
        if (x % stretch == 0 && x + stretch <= count && output.doubts == doubts &&
            values[x] == values[x + stretch - 1] && is_even(values + x)) {
            std::fill_n(output.codes + x, stretch, output.codes[x]);
            x += stretch - lanes;
        }
    }
    if (x < count) {
        HWY_ALIGN float rest[most_lanes] = {};
        std::copy(values + x, values + count, rest);
        put_vector(find_codes<follow>(cells, entries, is_rounded, hn::Load(d, rest)), x, count - x,
                   output);
    }
    return output.doubts;
}

template <class Code>
HWY_ATTR HWY_INLINE int put_codes(const StepCells& cells, const std::uint32_t* entries,
                                  const float* values, bool is_rounded, int count,
                                  const Output<Code>& output) {
    return cells.pieces.follow
               ? put_codes<true>(cells, entries, values, is_rounded, count, output)
               : put_codes<false>(cells, entries, values, is_rounded, count, output);
}

HWY_ATTR int StepCodes8(const StepCells& cells, const std::uint32_t* entries, const float* values,
                        bool is_rounded, int count, std::uint8_t* codes, std::uint16_t* doubtful) {
    return put_codes(cells, entries, values, is_rounded, count,
                     Output<std::uint8_t>{codes, doubtful});
}

HWY_ATTR int StepCodes16(const StepCells& cells, const std::uint32_t* entries, const float* values,
                         bool is_rounded, int count, std::uint16_t* codes,
                         std::uint16_t* doubtful) {
    return put_codes(cells, entries, values, is_rounded, count,
                     Output<std::uint16_t>{codes, doubtful});
}

// 0 times a number is 0, and NaN for the others; a NaN stays in the sum.
HWY_ATTR bool AllFinite(const float* values, int count) {
    const hn::ScalableTag<float> d;
    const int n = static_cast<int>(hn::Lanes(d));
    auto sum = hn::Zero(d);
    int x = 0;
    for (; x + n <= count; x += n)
        sum = hn::Add(sum, hn::Mul(hn::LoadU(d, values + x), hn::Zero(d)));
    float rest = 0.0f;
    for (; x < count; ++x)
        rest += values[x] * 0.0f;
    return rest == 0.0f && hn::AllTrue(d, hn::Eq(sum, hn::Zero(d)));
}

// ---- noise

using Doubles = hn::CappedTag<double, 8>;
using Words64 = hn::RebindToUnsigned<Doubles>;
using V = hn::Vec<Doubles>;
using W = hn::Vec<Words64>;

// The product of the lower halves of every lane.
HWY_ATTR HWY_INLINE W product(W a, std::uint32_t b) {
    const Words64 d;
#if HWY_TARGET == HWY_SCALAR  // of one lane, which cannot be halved
    return hn::Set(d, (hn::GetLane(a) & 0xffffffff) * b);
#else
    const hn::Repartition<std::uint32_t, Words64> halves;
    return hn::MulEven(hn::BitCast(halves, a), hn::BitCast(halves, hn::Set(d, b)));
#endif
}

// Of every round, in a lane's lower half.
struct PhiloxKeys {
    explicit PhiloxKeys(std::uint64_t key) {
        auto k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
        for (auto& round : words) {
            round[0] = k0;
            round[1] = k1;
            k0 += philox_key_steps[0];
            k1 += philox_key_steps[1];
        }
    }
    std::uint64_t words[philox_rounds][2];
};

// A word of random bits is the lower half of each; above it is what the products left.
struct Words {
    std::uint64_t radius[stretch], angle[stretch];
};

// The first two words of philox() of core/statistics/random.h for the counters (0, frame, pixel).
HWY_ATTR HWY_INLINE void draw_words(const PhiloxKeys& keys, std::uint32_t frame,
                                    std::uint64_t first_pixel, int count, Words& words) {
    const Words64 d;
    const int n = static_cast<int>(hn::Lanes(d));
    W pixel = hn::Iota(d, first_pixel);
    for (int x = 0; x < count; x += n) {
        W c0 = hn::Zero(d), c1 = hn::Set(d, frame), c2 = pixel, c3 = hn::ShiftRight<32>(pixel);
        for (const auto& key : keys.words) {
            const W p0 = product(c0, philox_multipliers[0]);
            const W p1 = product(c2, philox_multipliers[1]);
            c0 = hn::Xor(hn::Xor(hn::ShiftRight<32>(p1), c1), hn::Set(d, key[0]));
            c1 = p1;
            c2 = hn::Xor(hn::Xor(hn::ShiftRight<32>(p0), c3), hn::Set(d, key[1]));
            c3 = p0;
        }
        hn::StoreU(c0, d, words.radius + x);
        hn::StoreU(c1, d, words.angle + x);
        pixel = hn::Add(pixel, hn::Set(d, static_cast<std::uint64_t>(n)));
    }
}

// The integers 0 <= n < 2^52 are the last bits of the doubles 2^52 + n.
constexpr std::uint64_t bits_of_2_52 = 0x4330000000000000;

// 2^52 + 2 w + 1.
HWY_ATTR HWY_INLINE V odd(W word) {
    const Words64 d;
    const W twice = hn::ShiftRight<31>(hn::ShiftLeft<32>(word));
    return hn::BitCast(Doubles(), hn::Or(twice, hn::Set(d, bits_of_2_52 + 1)));
}

// c[0] + c[1] x
HWY_ATTR HWY_INLINE V line(const double* c, V x) {
    const Doubles d;
    return hn::Add(hn::Set(d, c[0]), hn::Mul(hn::Set(d, c[1]), x));
}

HWY_ATTR HWY_INLINE V polynomial(const double (&c)[8], V x) {
    const V x2 = hn::Mul(x, x);
    const V low = hn::Add(line(c, x), hn::Mul(line(c + 2, x), x2));
    const V high = hn::Add(line(c + 4, x), hn::Mul(line(c + 6, x), x2));
    return hn::Add(low, hn::Mul(high, hn::Mul(x2, x2)));
}

// The operations of box_muller(), one by one.
HWY_ATTR HWY_INLINE V radius(W word) {
    const Doubles d;
    const Words64 integers;
    const W offset = hn::Set(integers, bits_of_sqrt_half);
    const V number = hn::Sub(odd(word), hn::Set(d, 0x1p52));
    const W above = hn::Sub(hn::BitCast(integers, number), offset);
    const W places = hn::Or(hn::ShiftRight<52>(above), hn::Set(integers, bits_of_2_52));
    const V exponent = hn::Sub(hn::Set(d, 0x1p52 + 33.0), hn::BitCast(d, places));
    const W fraction = hn::And(above, hn::Set(integers, 0xfffffffffffff));
    const V m = hn::BitCast(d, hn::Add(fraction, offset));
    const V s = hn::Div(hn::Sub(m, hn::Set(d, 1.0)), hn::Add(m, hn::Set(d, 1.0)));
    const V log_m = hn::Mul(s, polynomial(log_polynomial, hn::Mul(s, s)));
    return hn::Sqrt(hn::Sub(hn::Mul(exponent, hn::Set(d, twice_ln2)), log_m));
}

HWY_ATTR HWY_INLINE V cosine(W word) {
    const Doubles d;
    const V half_turn_off =
        hn::Mul(hn::Sub(odd(word), hn::Set(d, 0x1p52 + 0x1p32)), hn::Set(d, 0x1p-33));
    const V z = hn::Sub(hn::Abs(half_turn_off), hn::Set(d, 0.25));
    return hn::Mul(z, polynomial(sine_polynomial, hn::Mul(z, z)));
}

HWY_ATTR HWY_INLINE V noisy(SensorNoise noise, V signal, V deviate) {
    const Doubles d;
    const V shot = hn::Mul(hn::Max(signal, hn::Zero(d)), hn::Set(d, noise.shot_variance));
    const V variance = hn::Add(shot, hn::Set(d, noise.read_variance));
    return hn::Add(signal, hn::Mul(hn::Sqrt(variance), deviate));
}

// Up to `stretch` signals, and those behind them that the last vector holds.
HWY_ATTR HWY_INLINE void add_to_stretch(SensorNoise noise, const Words& words, int count,
                                        double* signals) {
    const Doubles d;
    const Words64 integers;
    const int n = static_cast<int>(hn::Lanes(d));
    for (int x = 0; x < count; x += n) {
        const V length = radius(hn::LoadU(integers, words.radius + x));
        const V deviate = hn::Mul(length, cosine(hn::LoadU(integers, words.angle + x)));
        hn::StoreU(noisy(noise, hn::LoadU(d, signals + x), deviate), d, signals + x);
    }
}

HWY_ATTR void AddNoise(SensorNoise noise, const NoiseKey& key, std::uint64_t first_pixel, int count,
                       double* signals) {
    const PhiloxKeys keys(key.seed);
    Words words;
    for (; count >= stretch; count -= stretch, first_pixel += stretch, signals += stretch) {
        draw_words(keys, key.frame, first_pixel, stretch, words);
        add_to_stretch(noise, words, stretch, signals);
    }
    double rest[stretch] = {};
    for (int x = 0; x < count; ++x)
        rest[x] = signals[x];
    draw_words(keys, key.frame, first_pixel, count, words);
    add_to_stretch(noise, words, count, rest);
    for (int x = 0; x < count; ++x)
        signals[x] = rest[x];
}

}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace etalon {

HWY_EXPORT(StepCodes8);
HWY_EXPORT(StepCodes16);
HWY_EXPORT(AllFinite);
HWY_EXPORT(AddNoise);

int step_codes(const StepCells& cells, const std::uint32_t* entries, const float* values,
               bool is_rounded, int count, std::uint8_t* codes, std::uint16_t* doubtful) {
    return HWY_DYNAMIC_DISPATCH(StepCodes8)(cells, entries, values, is_rounded, count, codes,
                                            doubtful);
}

int step_codes(const StepCells& cells, const std::uint32_t* entries, const float* values,
               bool is_rounded, int count, std::uint16_t* codes, std::uint16_t* doubtful) {
    return HWY_DYNAMIC_DISPATCH(StepCodes16)(cells, entries, values, is_rounded, count, codes,
                                             doubtful);
}

bool all_finite(const float* values, int count) {
    return HWY_DYNAMIC_DISPATCH(AllFinite)(values, count);
}

void add_noise(SensorNoise noise, const NoiseKey& key, std::uint64_t first_pixel, int count,
               double* signals) {
    HWY_DYNAMIC_DISPATCH(AddNoise)(noise, key, first_pixel, count, signals);
}

}  // namespace etalon

#endif  // HWY_ONCE
