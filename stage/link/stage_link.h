// Where a stage controller is reached: Modbus TCP or Modbus RTU on a serial line, with time-outs.
#pragma once

#include <chrono>

#include "core/config/strict_reader.h"

namespace etalon {

struct TcpAddress {
    std::string host = "127.0.0.1";
    int port = 502;
};

struct SerialPort {
    std::string device;  // "/dev/ttyUSB0"
    int baud = 38400;
    char parity = 'N';  // 'N'one, 'E'ven, 'O'dd
    int data_bits = 8, stop_bits = 1;
};

struct StageLink {
    std::variant<TcpAddress, SerialPort> address;
    int unit = 1;  // of axes that name none
    std::chrono::milliseconds response_timeout{300};

    // Serial only: the line is free of old replies when nothing arrived during this time. Replies
    // do not say which request they answer, so no file may say less than the response time-out.
    std::chrono::milliseconds quiet{300};

    bool is_serial() const { return std::holds_alternative<SerialPort>(address); }
};

// "127.0.0.1:502" or "/dev/ttyUSB0".
std::string describe(const StageLink& link);

// What a family of controllers needs where station.yaml says nothing.
struct LinkDefaults {
    enum class Transport { tcp, rtu };
    Transport transport = Transport::tcp;  // the usual one
    SerialPort serial;                     // without the device
    std::chrono::milliseconds response_timeout{300}, quiet{300};
};

// Reads {transport: tcp or rtu, baud, parity: none, even or odd, data_bits, stop_bits,
// response_timeout_ms, quiet_ms}; everything is optional. Throws ConfigError.
LinkDefaults read_link_defaults(const Value& link);

// Reads {host, port, unit, response_timeout_ms} or {device, baud, parity, data_bits, stop_bits,
// unit, response_timeout_ms, quiet_ms}; required are host and port, or device. Throws ConfigError.
StageLink read_stage_link(const Value& link, const LinkDefaults& defaults = {});

// Throws ConfigError for an empty host, an impossible baud rate or a unit that cannot answer.
void require_usable(const StageLink& link);

}  // namespace etalon
