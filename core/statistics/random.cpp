#include "core/statistics/random.h"

#include "core/statistics/box_muller.h"

namespace etalon {

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
