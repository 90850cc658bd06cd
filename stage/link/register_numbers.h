// Numbers in 16-bit registers, as controllers keep them. Every value of a type round-trips.
#pragma once

#include <cstdint>
#include <span>

#include "core/config/strict_reader.h"

namespace etalon {

// The four spaces of Modbus registers (MODBUS Application Protocol V1.1b3). Each has its own
// addresses, 0 to 65535. Of the bit spaces a value is 0 or 1.
enum class RegisterSpace {
    coils,              // read and written: functions 1, 5, 15
    discrete_inputs,    // read: 2
    holding_registers,  // read and written: 3, 6, 16
    input_registers     // read: 4
};

constexpr bool is_bits(RegisterSpace space) {
    return space == RegisterSpace::coils || space == RegisterSpace::discrete_inputs;
}
constexpr bool is_writable(RegisterSpace space) {
    return space == RegisterSpace::coils || space == RegisterSpace::holding_registers;
}

// Of one request.
constexpr int most_read(RegisterSpace space) {
    return is_bits(space) ? 2000 : 125;
}
constexpr int most_written(RegisterSpace space) {
    return is_bits(space) ? 1968 : 123;
}

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
