#include "stage/registers.h"

namespace etalon {

std::int32_t int32_from_registers(std::uint16_t high, std::uint16_t low) {
    return static_cast<std::int32_t>(static_cast<std::uint32_t>(high) << 16 | low);
}

RegisterPair registers_from_int32(std::int32_t value) {
    const auto bits = static_cast<std::uint32_t>(value);
    return {static_cast<std::uint16_t>(bits >> 16), static_cast<std::uint16_t>(bits & 0xFFFFU)};
}

}  // namespace etalon
