// Where a stage controller is reached: a Modbus TCP address or a serial line with Modbus RTU, and
// how long to wait for it. Read from station.yaml; a profile knows what its family usually needs.
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

    // Serial only: the line counts as free of old replies when nothing arrived during this time.
    // A reply of a serial line does not say which request it answers, so this must be longer than
    // the controller's slowest reply takes: no file may say less than the response time-out.
    std::chrono::milliseconds quiet{300};

    bool is_serial() const { return std::holds_alternative<SerialPort>(address); }
};

// "127.0.0.1:502" or "/dev/ttyUSB0".
std::string describe(const StageLink& link);

// What a family of controllers needs where station.yaml says nothing; the address is not part of
// it.
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

// Throws ConfigError for a link that cannot exist: no host, a baud rate that serial lines do not
// have, a unit that cannot answer.
void require_usable(const StageLink& link);

}  // namespace etalon
