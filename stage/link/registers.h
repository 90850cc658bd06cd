// The four spaces of Modbus registers and the limits of one request (MODBUS Application Protocol
// V1.1b3).
#pragma once

namespace etalon {

// Each has its own addresses, 0 to 65535. Of the bit spaces a value is 0 or 1.
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

}  // namespace etalon
