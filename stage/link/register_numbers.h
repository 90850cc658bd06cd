// Numbers in 16-bit registers, as controllers keep them. Every value of a type round-trips.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/config/strict_reader.h"

namespace etalon {

enum class NumberType { int16, uint16, int32, float32 };
enum class WordOrder { high_first, low_first };  // of the two registers of 32 bits

// int16, uint16, int32 or float32; high_first or low_first. Throw ConfigError for other words.
NumberType read_number_type(const Value& value);
WordOrder read_word_order(const Value& value);

constexpr int registers_of(NumberType type) {
    return type == NumberType::int32 || type == NumberType::float32 ? 2 : 1;
}

struct NumberRange {
    double low = 0.0, high = 0.0;
};
NumberRange range_of(NumberType type);

// The number in the first registers_of(type) of `registers`.
double number_from_registers(std::span<const std::uint16_t> registers, NumberType type,
                             WordOrder order);

// Appends registers_of(type) registers. Integers are rounded; throws std::out_of_range for a number
// that the type cannot hold, or that is none.
void append_number(std::vector<std::uint16_t>& registers, double number, NumberType type,
                   WordOrder order);

}  // namespace etalon
