// Counter-based random numbers, pure functions of their key: the same for every platform, thread
// count and order. Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC
// 2011).
#pragma once

#include <array>
#include <cstdint>

namespace etalon {

// Two normal deviates from two words of random bits (Box and Muller, "A note on the generation of
// random normal deviates", Ann. Math. Stat. 29, 1958): for u and v uniform in (0, 1), sqrt(-2 ln u)
// cos(2 pi v) and sqrt(-2 ln u) sin(2 pi v).
//
// Only additions, multiplications, divisions and square roots of doubles in a given order, none
// fused: the same bits on every machine and from vectors (sim/sensor/sensor_simd.cpp). A word w
// stands for (2 w + 1) 2^-33, never 0 or 1; arguments are reduced without a rounding:
//   u = 2^-e m, sqrt(1/2) <= m < sqrt(2):  -2 ln u = e 2 ln 2 - 4 atanh(s),  s = (m - 1) / (m + 1)
//   |z| <= 1/4:                            cos(2 pi v) = sin(2 pi z),        z = |v - 1/2| - 1/4
// Both are the argument times a polynomial of its square, of degree 7, through the 8 Chebyshev
// nodes of 0 <= s^2 <= 0.0294372515, (sqrt(2) - 1)^2 / (sqrt(2) + 1)^2, and of 0 <= z^2 <= 1/16,
// computed with 70 digits and rounded: wrong by less than 3.1e-18 and 2.5e-16; the deviates are
// within 1.5e-15 of their own value.

// Of s^2 and of z^2, ascending.
inline constexpr double log_polynomial[8] = {
    0x1.0000000000000p+2, 0x1.55555555555aep+0, 0x1.999999997aeaap-1, 0x1.2492494513f76p-1,
    0x1.c71c50004ffdcp-2, 0x1.7466994f20a7ep-2, 0x1.3999bf614de2ap-2, 0x1.2f4d88c4faf3dp-2};
inline constexpr double sine_polynomial[8] = {
    0x1.921fb54442d17p+2, -0x1.4abbce625bd83p+5, 0x1.466bc677522bdp+6, -0x1.32d2cce1ea145p+6,
    0x1.5078327046959p+5, -0x1.e30631bdf732dp+3, 0x1.e89f6fe44fe7bp+1, -0x1.62903d02bb153p-1};
inline constexpr double twice_ln2 = 0x1.62e42fefa39efp+0;
inline constexpr std::uint64_t bits_of_sqrt_half = 0x3fe6a09e667f3bcd;  // of the double

struct NormalPair {
    double cosine, sine;
};

// About 20 ns.
NormalPair box_muller(std::uint32_t radius_word, std::uint32_t angle_word);

inline constexpr int philox_rounds = 10;
inline constexpr std::uint32_t philox_multipliers[] = {0xD2511F53, 0xCD9E8D57};
inline constexpr std::uint32_t philox_key_steps[] = {0x9E3779B9, 0xBB67AE85};

// Four independent 32-bit words for one (key, counter).
std::array<std::uint32_t, 4> philox(std::uint64_t key, std::array<std::uint32_t, 4> counter);

// A stream keyed by (seed, stream, index): the n-th number does not depend on how many were drawn
// elsewhere. Cheap to make; one per pixel is fine. Draw two for one call in braces, which keep
// their order: Eigen::Vector2d{random.normal(), random.normal()}.
class RandomStream {
public:
    RandomStream(std::uint64_t seed, std::uint32_t stream, std::uint64_t index = 0)
        : key_(seed),
          counter_{0, stream, static_cast<std::uint32_t>(index),
                   static_cast<std::uint32_t>(index >> 32)} {}

    std::uint32_t bits();
    double uniform();  // in (0, 1), never 0 or 1
    double normal();   // mean 0, standard deviation 1

private:
    std::uint64_t key_;
    std::array<std::uint32_t, 4> counter_;
    std::array<std::uint32_t, 4> block_{};
    int left_ = 0;
    bool has_spare_ = false;
    double spare_ = 0.0;
};

}  // namespace etalon
