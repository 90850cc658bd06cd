// One connection to a Modbus TCP device, with the guards that libmodbus leaves to its user: every
// request ends in time, a broken connection is closed at once and opened anew with a growing pause
// (so that a late reply can never be taken for another one's), and requests stay within the
// protocol's limits (Modbus Application Protocol V1.1b3: 125 registers read, 123 written).
//
// Reading has no effect on the device and is repeated after a failure. A write is NEVER repeated
// here: when its reply is missing nobody knows whether it was carried out, and only the caller can
// find out by reading back. Blocks its caller; one thread at a time, except last_exchanges().
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "core/clock.h"
#include "core/errors.h"
#include "stage/stage.h"

namespace etalon {

// A write whose reply is missing: it may or may not have been carried out.
class UncertainWrite : public DeviceError {
public:
    using DeviceError::DeviceError;
};

// One request and what became of it.
struct ModbusExchange {
    Instant start{};
    Duration took{};
    std::string request;                // "read registers 0..13"
    std::vector<std::uint16_t> values;  // read or written; empty for a read that failed
    std::string failure;                // empty: answered as it should be
};

class ModbusLink {
public:
    // Connects with the first request. The clock must outlive the link; it times the pauses and the
    // exchanges, the response time-out is the operating system's. A host name instead of an address
    // is looked up for every connection, however long the resolver takes.
    ModbusLink(const StageLink& link, Clock& clock);
    ~ModbusLink();
    ModbusLink(const ModbusLink&) = delete;
    ModbusLink& operator=(const ModbusLink&) = delete;

    // Reads holding registers (function 3), 1 to 125 of them. Tries up to `attempts` times, over a
    // fresh connection each time, then throws DeviceError; at most about
    // attempts * 2 * response time-out + pauses. A Modbus exception is an answer: not repeated.
    std::vector<std::uint16_t> read(int address, int count, int attempts = 3);

    // Writes holding registers (function 16), 1 to 123 of them, once. Throws DeviceError when
    // the device refused or nothing was sent, UncertainWrite when the reply is missing.
    void write(int address, std::span<const std::uint16_t> values);

    // From the next request on; for a caller with little time left.
    void set_response_timeout(std::chrono::milliseconds timeout);

    // Closes the connection; the next request opens a new one, without a pause.
    void close();

    // The last 200 requests, oldest first, failed connections included. Safe from every thread.
    std::vector<ModbusExchange> last_exchanges() const;

    const std::string& device() const { return device_; }  // "stage 127.0.0.1:1502 unit 1"

private:
    struct Connection;
    enum class Outcome { answered, refused, not_sent, unknown };

    template <class Call>
    Outcome transact(ModbusExchange& exchange, int expected, Call call);
    std::string connect();
    void pause_after_failures();
    void record(const ModbusExchange& exchange);
    std::string describe_error(int error) const;

    StageLink link_;
    Clock& clock_;
    std::string device_;
    std::unique_ptr<Connection> connection_;  // null: not connected
    int failures_ = 0;                        // in a row
    mutable std::mutex trace_mutex_;
    std::deque<ModbusExchange> trace_;
};

// 32-bit values in two registers, high word first. Every value round-trips.
std::int32_t int32_from_registers(std::uint16_t high, std::uint16_t low);
struct RegisterPair {
    std::uint16_t high, low;
};
RegisterPair registers_from_int32(std::int32_t value);

// One line per exchange, times in ms relative to the last: for records and error reports.
std::string describe(const std::vector<ModbusExchange>& exchanges);

}  // namespace etalon
