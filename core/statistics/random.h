// Counter-based random numbers: a value is a pure function of its key, so the same pose and pixel
// get the same noise on every platform and for every number of threads, in any order.
//
// Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011); normal
// deviates by Box and Muller in double precision (core/statistics/box_muller.h).
#pragma once

#include <array>
#include <cstdint>

namespace etalon {

inline constexpr int philox_rounds = 10;
inline constexpr std::uint32_t philox_multipliers[] = {0xD2511F53, 0xCD9E8D57};
inline constexpr std::uint32_t philox_key_steps[] = {0x9E3779B9, 0xBB67AE85};

// Four independent 32-bit words for one (key, counter).
std::array<std::uint32_t, 4> philox(std::uint64_t key, std::array<std::uint32_t, 4> counter);

// A stream keyed by (seed, stream, index): the n-th number does not depend on how many were drawn
// elsewhere. Cheap to make; one per pixel is fine.
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
