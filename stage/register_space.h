// The four address spaces of Modbus (Application Protocol V1.1b3, 4.3). Each has its own addresses
// 0 to 65535, as on the wire; coils and discrete inputs are bits, registers have 16 bits.
#pragma once

namespace etalon {

enum class RegisterSpace { coils, discrete_inputs, holding_registers, input_registers };

inline bool is_bits(RegisterSpace space) {
    return space == RegisterSpace::coils || space == RegisterSpace::discrete_inputs;
}
inline bool is_writable(RegisterSpace space) {
    return space == RegisterSpace::coils || space == RegisterSpace::holding_registers;
}

}  // namespace etalon
