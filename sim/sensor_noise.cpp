// Vectors of at most eight doubles, which those of unknown size cannot be.
#undef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/sensor_noise.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "core/box_muller.h"
#include "core/random.h"
#include "sim/sensor_noise.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int most_lanes = 8;
using Doubles = hn::CappedTag<double, most_lanes>;
using Integers = hn::RebindToUnsigned<Doubles>;
using V = hn::Vec<Doubles>;
using W = hn::Vec<Integers>;

// The product of the lower halves of every lane.
HWY_ATTR HWY_INLINE W product(W a, std::uint32_t b) {
    const Integers d;
#if HWY_TARGET == HWY_SCALAR  // of one lane, which cannot be halved
    return hn::Set(d, (hn::GetLane(a) & 0xffffffff) * b);
#else
    const hn::Repartition<std::uint32_t, Integers> halves;
    return hn::MulEven(hn::BitCast(halves, a), hn::BitCast(halves, hn::Set(d, b)));
#endif
}

// A word of random bits is the lower half of its lane; above it is what the products left.
struct TwoWords {
    W first, second;
};

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

// philox() of core/random.h for the counters (0, frame, pixel), and of its words the two that make
// the first deviate.
HWY_ATTR HWY_INLINE TwoWords philox_words(const PhiloxKeys& keys, std::uint32_t frame, W pixel) {
    const Integers d;
    W c0 = hn::Zero(d), c1 = hn::Set(d, frame), c2 = pixel, c3 = hn::ShiftRight<32>(pixel);
    for (const auto& key : keys.words) {
        const W p0 = product(c0, philox_multipliers[0]), p1 = product(c2, philox_multipliers[1]);
        c0 = hn::Xor(hn::Xor(hn::ShiftRight<32>(p1), c1), hn::Set(d, key[0]));
        c1 = p1;
        c2 = hn::Xor(hn::Xor(hn::ShiftRight<32>(p0), c3), hn::Set(d, key[1]));
        c3 = p0;
    }
    return {c0, c1};
}

// The integers 0 <= n < 2^52 are the last bits of the doubles 2^52 + n.
constexpr std::uint64_t bits_of_2_52 = 0x4330000000000000;

// 2^52 + 2 w + 1.
HWY_ATTR HWY_INLINE V odd(W word) {
    const Integers d;
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
    const Integers integers;
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

constexpr int stretch = 64;

HWY_ATTR HWY_INLINE void add_to_stretch(SensorNoise noise, const PhiloxKeys& keys, std::uint32_t frame, std::uint64_t first_pixel, int count, double* signals) {
    const Doubles d;
    const Integers integers;
    const int n = static_cast<int>(hn::Lanes(d));
    std::uint64_t first[stretch], second[stretch];
    W pixel = hn::Iota(integers, first_pixel);
    for (int x = 0; x < count; x += n) {
        const TwoWords words = philox_words(keys, frame, pixel);
        hn::StoreU(words.first, integers, first + x);
        hn::StoreU(words.second, integers, second + x);
        pixel = hn::Add(pixel, hn::Set(integers, static_cast<std::uint64_t>(n)));
    }
    for (int x = 0; x < count; x += n) {
        const V deviate = hn::Mul(radius(hn::LoadU(integers, first + x)), cosine(hn::LoadU(integers, second + x)));
        hn::StoreU(noisy(noise, hn::LoadU(d, signals + x), deviate), d, signals + x);
    }
}

HWY_ATTR void AddNoise(SensorNoise noise, const NoiseKey& key, std::uint64_t first_pixel, int count,
                       double* signals) {
    const PhiloxKeys keys(key.seed);
    int x = 0;
    for (; x + stretch <= count; x += stretch)
        add_to_stretch(noise, keys, key.frame, first_pixel + static_cast<std::uint64_t>(x), stretch, signals + x);
    double last[stretch] = {};
    for (int i = 0; x + i < count; ++i)
        last[i] = signals[x + i];
    add_to_stretch(noise, keys, key.frame, first_pixel + static_cast<std::uint64_t>(x), count - x, last);
    for (int i = 0; x + i < count; ++i)
        signals[x + i] = last[i];
}

}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace etalon {

HWY_EXPORT(AddNoise);

void add_noise(SensorNoise noise, const NoiseKey& key, std::uint64_t first_pixel, int count,
               double* signals) {
    HWY_DYNAMIC_DISPATCH(AddNoise)(noise, key, first_pixel, count, signals);
}

}  // namespace etalon

#endif  // HWY_ONCE
