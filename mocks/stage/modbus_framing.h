// Modbus messages as bytes, from the controller's side: "MODBUS Application Protocol V1.1b3",
// "MODBUS Messaging on TCP/IP Implementation Guide V1.0b", "MODBUS over Serial Line V1.02". Without
// the client's library, so that the two check each other. Pure functions.
#pragma once

#include <span>

#include "stage/link/modbus_transport.h"

namespace etalon {

using Bytes = std::vector<std::uint8_t>;

enum class ModbusFraming { tcp, rtu };

// A request or a reply without what carries it.
struct ModbusFrame {
    int transaction = 0;  // TCP only
    int unit = 0;
    Bytes pdu;  // function code and data
};

// Takes the first complete request out of `received`, if any. `out_of_step`: no request can begin
// so. TCP has no way back into step; a serial line loses the bytes until the next pause.
std::optional<ModbusFrame> take_request(ModbusFraming framing, Bytes& received, bool& out_of_step);

Bytes to_bytes(ModbusFraming framing, const ModbusFrame& frame);

// The check sum at a serial frame's end, low byte first.
std::uint16_t modbus_crc(std::span<const std::uint8_t> bytes);

enum ModbusException : std::uint8_t {
    no_exception = 0,
    illegal_function = 1,
    illegal_address = 2,
    illegal_value = 3,
    target_silent = 11  // a gateway's: the unit does not answer
};

// Decodes and checks a request's PDU. With an exception only the function code is set.
ModbusException decode_request(const Bytes& pdu, ModbusRequest& request);

// The PDU of an answer with the values that were read, or of an exception.
Bytes encode_reply(const ModbusRequest& request, std::span<const std::uint16_t> values);
Bytes encode_exception(int function, int code);

}  // namespace etalon
