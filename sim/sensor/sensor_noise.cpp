// Not for vectors of unknown size: a machine that has these takes its others.
#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/sensor/sensor_noise.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "core/statistics/random.h"
#include "sim/sensor/sensor_noise.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Doubles = hn::CappedTag<double, 8>;
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

// Pixels whose words are drawn before the first is used. Loops of few operations let the processor
// work on several vectors at once.
constexpr int stretch = 64;

// A word of random bits is the lower half of each; above it is what the products left.
struct Words {
    std::uint64_t radius[stretch], angle[stretch];
};

// The first two words of philox() of core/statistics/random.h for the counters (0, frame, pixel).
HWY_ATTR HWY_INLINE void draw_words(const PhiloxKeys& keys, std::uint32_t frame,
                                    std::uint64_t first_pixel, int count, Words& words) {
    const Integers d;
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

// Up to `stretch` signals, and those behind them that the last vector holds.
HWY_ATTR HWY_INLINE void add_to_stretch(SensorNoise noise, const Words& words, int count,
                                        double* signals) {
    const Doubles d;
    const Integers integers;
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

HWY_EXPORT(AddNoise);

void add_noise(SensorNoise noise, const NoiseKey& key, std::uint64_t first_pixel, int count,
               double* signals) {
    HWY_DYNAMIC_DISPATCH(AddNoise)(noise, key, first_pixel, count, signals);
}

}  // namespace etalon

#endif  // HWY_ONCE
