#include "mocks/stage/modbus_framing.h"

#include "stage/link/register_numbers.h"

namespace etalon {
namespace {

constexpr std::size_t tcp_header = 7;  // transaction, protocol, length, unit
constexpr std::size_t max_pdu = 253;
constexpr std::size_t max_rtu_frame = 256;

int word_at(const Bytes& bytes, std::size_t at) {
    return bytes[at] << 8 | bytes[at + 1];
}

void append_word(Bytes& bytes, int word) {
    bytes.push_back(static_cast<std::uint8_t>(word >> 8));
    bytes.push_back(static_cast<std::uint8_t>(word & 0xFF));
}

Bytes take(Bytes& bytes, std::size_t count) {
    const auto end = bytes.begin() + static_cast<std::ptrdiff_t>(count);
    Bytes taken(bytes.begin(), end);
    bytes.erase(bytes.begin(), end);
    return taken;
}

std::optional<ModbusFrame> take_tcp(Bytes& received, bool& out_of_step) {
    if (received.size() < tcp_header)
        return std::nullopt;
    const auto length = static_cast<std::size_t>(word_at(received, 4));  // unit and PDU
    out_of_step = word_at(received, 2) != 0 || length < 2 || length > max_pdu + 1;
    if (out_of_step || received.size() < tcp_header - 1 + length)
        return std::nullopt;
    const Bytes bytes = take(received, tcp_header - 1 + length);
    return ModbusFrame{word_at(bytes, 0), bytes[6], {bytes.begin() + tcp_header, bytes.end()}};
}

// Of unit, PDU and check sum, told by the function; 0: not yet known.
std::size_t rtu_length(const Bytes& received) {
    const int function = received[1];
    if (function != 15 && function != 16)
        return function <= 6 ? 8 : received.size();
    return received.size() < 7 ? 0 : 9U + received[6];
}

std::optional<ModbusFrame> take_rtu(Bytes& received, bool& out_of_step) {
    if (received.size() < 4)
        return std::nullopt;
    const std::size_t length = rtu_length(received);
    out_of_step = length > max_rtu_frame;
    if (length == 0 || out_of_step || received.size() < length)
        return std::nullopt;
    const Bytes bytes = take(received, length);
    out_of_step = modbus_crc(bytes) != 0;
    if (out_of_step)
        return std::nullopt;
    return ModbusFrame{0, bytes[0], {bytes.begin() + 1, bytes.end() - 2}};
}

int most_values(int function) {
    const bool bits = function == 1 || function == 2 || function == 15;
    const auto space = bits ? RegisterSpace::coils : RegisterSpace::holding_registers;
    return function > 4 ? most_written(space) : most_read(space);
}

}  // namespace

std::optional<ModbusFrame> take_request(ModbusFraming framing, Bytes& received, bool& out_of_step) {
    out_of_step = false;
    return framing == ModbusFraming::tcp ? take_tcp(received, out_of_step)
                                         : take_rtu(received, out_of_step);
}

Bytes to_bytes(ModbusFraming framing, const ModbusFrame& frame) {
    Bytes bytes;
    if (framing == ModbusFraming::tcp) {
        append_word(bytes, frame.transaction);
        append_word(bytes, 0);
        append_word(bytes, static_cast<int>(frame.pdu.size()) + 1);
    }
    bytes.push_back(static_cast<std::uint8_t>(frame.unit));
    bytes.insert(bytes.end(), frame.pdu.begin(), frame.pdu.end());
    if (framing == ModbusFraming::rtu) {
        const std::uint16_t crc = modbus_crc(bytes);
        bytes.push_back(static_cast<std::uint8_t>(crc & 0xFF));
        bytes.push_back(static_cast<std::uint8_t>(crc >> 8));
    }
    return bytes;
}

// "MODBUS over Serial Line", 6.2.2: x^16 + x^15 + x^2 + 1, reflected; 0 over a frame and its sum.
std::uint16_t modbus_crc(std::span<const std::uint8_t> bytes) {
    unsigned crc = 0xFFFF;
    for (const std::uint8_t byte : bytes) {
        crc ^= byte;
        for (int bit = 0; bit < 8; ++bit)
            crc = (crc & 1U) != 0 ? crc >> 1 ^ 0xA001U : crc >> 1;
    }
    return static_cast<std::uint16_t>(crc);
}

ModbusException decode_request(const Bytes& pdu, ModbusRequest& request) {
    request.function = pdu[0];
    const bool several = request.function == 15 || request.function == 16;
    if (!several && (request.function < 1 || request.function > 6))
        return illegal_function;
    if (pdu.size() < 5)
        return illegal_value;
    const bool single = request.function == 5 || request.function == 6;
    const int second = word_at(pdu, 3);  // a count or a value
    request.address = word_at(pdu, 1);
    request.count = single ? 1 : second;
    if (request.count < 1 || request.count > most_values(request.function))
        return illegal_value;
    if (request.function == 5 && second != 0 && second != 0xFF00)
        return illegal_value;
    if (single)
        request.values = {static_cast<std::uint16_t>(request.function == 5 ? second != 0 : second)};
    if (!several)
        return pdu.size() == 5 ? no_exception : illegal_value;
    const bool bits = request.function == 15;
    const auto count = static_cast<std::size_t>(request.count);
    const std::size_t bytes = bits ? (count + 7) / 8 : 2 * count;
    if (pdu.size() != 6 + bytes || pdu[5] != bytes)
        return illegal_value;
    for (std::size_t i = 0; i < count; ++i)
        request.values.push_back(static_cast<std::uint16_t>(bits ? pdu[6 + i / 8] >> i % 8 & 1
                                                                 : word_at(pdu, 6 + 2 * i)));
    return no_exception;
}

Bytes encode_reply(const ModbusRequest& request, std::span<const std::uint16_t> values) {
    Bytes pdu = {static_cast<std::uint8_t>(request.function)};
    if (request.function > 4) {
        append_word(pdu, request.address);
        const int value = request.function == 5 && request.values[0] != 0 ? 0xFF00
                          : request.function < 15                         ? request.values[0]
                                                                          : request.count;
        append_word(pdu, value);
    } else if (request.function > 2) {
        pdu.push_back(static_cast<std::uint8_t>(2 * values.size()));
        for (const std::uint16_t value : values)
            append_word(pdu, value);
    } else {
        pdu.resize(2 + (values.size() + 7) / 8);
        pdu[1] = static_cast<std::uint8_t>(pdu.size() - 2);
        for (std::size_t i = 0; i < values.size(); ++i)
            pdu[2 + i / 8] = static_cast<std::uint8_t>(pdu[2 + i / 8] | (values[i] & 1) << i % 8);
    }
    return pdu;
}

Bytes encode_exception(int function, int code) {
    return {static_cast<std::uint8_t>(function | 0x80), static_cast<std::uint8_t>(code)};
}

}  // namespace etalon
