#include "core/statistics/random.h"

#include <bit>
#include <cmath>

namespace etalon {
namespace {

// Estrin's order.
double polynomial(const double (&c)[8], double x) {
    const double x2 = x * x;
    const double low = (c[0] + c[1] * x) + (c[2] + c[3] * x) * x2;
    const double high = (c[4] + c[5] * x) + (c[6] + c[7] * x) * x2;
    return low + high * (x2 * x2);
}

// 2 w + 1, of 33 bits.
double odd(std::uint32_t word) {
    return static_cast<double>(2 * std::uint64_t{word} + 1);
}

double radius(std::uint32_t word) {
    const std::uint64_t above = std::bit_cast<std::uint64_t>(odd(word)) - bits_of_sqrt_half;
    const auto exponent = 33.0 - static_cast<double>(above >> 52);
    const auto m = std::bit_cast<double>((above & 0xfffffffffffff) + bits_of_sqrt_half);
    const double s = (m - 1.0) / (m + 1.0);
    return std::sqrt(exponent * twice_ln2 - s * polynomial(log_polynomial, s * s));
}

// Of z turns, |z| <= 1/4.
double sine(double z) {
    return z * polynomial(sine_polynomial, z * z);
}

}  // namespace

NormalPair box_muller(std::uint32_t radius_word, std::uint32_t angle_word) {
    const double length = radius(radius_word);
    const double half_turn_off = odd(angle_word) * 0x1p-33 - 0.5;  // v - 1/2, never 0
    const double from_quarter = std::abs(half_turn_off) - 0.25;
    const double height = 0.25 - std::abs(from_quarter);
    return {length * sine(from_quarter), length * sine(half_turn_off < 0.0 ? height : -height)};
}

std::array<std::uint32_t, 4> philox(std::uint64_t key, std::array<std::uint32_t, 4> c) {
    auto k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
    for (int round = 0; round < philox_rounds; ++round) {
        const std::uint64_t p0 = std::uint64_t{philox_multipliers[0]} * c[0];
        const std::uint64_t p1 = std::uint64_t{philox_multipliers[1]} * c[2];
        c = {static_cast<std::uint32_t>(p1 >> 32) ^ c[1] ^ k0, static_cast<std::uint32_t>(p1),
             static_cast<std::uint32_t>(p0 >> 32) ^ c[3] ^ k1, static_cast<std::uint32_t>(p0)};
        k0 += philox_key_steps[0];
        k1 += philox_key_steps[1];
    }
    return c;
}

std::uint32_t RandomStream::bits() {
    if (left_ == 0) {
        block_ = philox(key_, counter_);
        ++counter_[0];
        left_ = 4;
    }
    return block_[static_cast<std::size_t>(4 - left_--)];
}

double RandomStream::uniform() {
    return (bits() + 0.5) * 0x1p-32;
}

double RandomStream::normal() {
    if (has_spare_) {
        has_spare_ = false;
        return spare_;
    }
    const std::uint32_t radius_word = bits();
    const NormalPair pair = box_muller(radius_word, bits());
    spare_ = pair.sine;
    has_spare_ = true;
    return pair.cosine;
}

}  // namespace etalon
