// One connection to Modbus devices on TCP or a serial line, with the guards that libmodbus leaves
// to its user. Every request ends in time and stays within the protocol's limits. A broken
// connection is closed at once and opened again with a growing pause, so that no late reply is
// taken for another's. A serial line, which keeps late replies, is read until it is quiet.
//
// Reading is repeated after a failure. A write NEVER is: without its reply only the caller can find
// out by reading back. Blocks its caller; one thread at a time, except last_exchanges().
#pragma once

#include <deque>
#include <functional>

#include "stage/link/modbus_transport.h"
#include "stage/link/register_numbers.h"

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
    int unit = 0;
    std::string request;                // "read registers 0..13"
    std::vector<std::uint16_t> values;  // read or written; empty for a read that failed
    std::string failure;                // empty: answered as it should be
};

class ModbusLink {
public:
    // Connects with the first request. The clock must outlive the link; it times the pauses and the
    // exchanges. Host names are looked up for every connection. Throws ConfigError for a link that
    // cannot be. Without a transport libmodbus is taken.
    ModbusLink(const StageLink& link, Clock& clock,
               std::unique_ptr<ModbusTransport> transport = nullptr);

    // Reads 1 to 125 registers, or 1 to 2000 coils or inputs. Tries up to `attempts` times, over a
    // fresh connection each time, then throws DeviceError; at most about
    // attempts * (2 * response time-out + 4 * quiet of a serial line) + pauses. A Modbus exception
    // is an answer: not repeated, unless it says that the device is busy or not heard.
    std::vector<std::uint16_t> read(int unit, RegisterSpace space, int address, int count,
                                    int attempts = 3);

    // Writes 1 to 123 holding registers (function 16) or 1 to 1968 coils (5 for one, 15) once.
    // Throws DeviceError when the device refused or nothing was sent, UncertainWrite when the
    // reply is missing or says that the write may still be carried out.
    void write(int unit, RegisterSpace space, int address, std::span<const std::uint16_t> values);

    // From the next request on, until told otherwise by nothing: for stopping. Each request gives
    // half of the time left to the connection, emptying the line included, and half of the rest to
    // its reply. A write is sent even on a noisy line: better than no stop. Reading is not.
    void hurry(std::optional<Instant> deadline) { deadline_ = deadline; }

    // Closes the connection; the next request opens a new one, without a pause.
    void close();

    // The last 200 requests, oldest first, failed connections included. Safe from every thread.
    std::vector<ModbusExchange> last_exchanges() const;

    // Called with every exchange from now on, on the thread that makes it; an empty one ends that.
    // An exception of its own leaves read() or write() after the exchange, and ends it too.
    void set_trace(std::function<void(const ModbusExchange&)> sink) { sink_ = std::move(sink); }

    std::string device(int unit) const;                    // "stage 127.0.0.1:1502 unit 1"
    const std::string& device() const { return device_; }  // of the link's own unit

private:
    ModbusReply transact(const ModbusRequest& request, RegisterSpace space);
    ModbusReply exchange(const ModbusRequest& request);
    std::chrono::milliseconds reply_time() const;
    std::string make_connection(const ModbusRequest& request);
    ModbusTransport::Heard drain();
    void drop_connection();
    void pause_after_failures();
    void record(const ModbusExchange& exchange);

    StageLink link_;
    Clock& clock_;
    std::string device_;
    std::unique_ptr<ModbusTransport> transport_;
    bool connected_ = false;
    int failures_ = 0;  // in a row
    std::optional<Instant> deadline_;
    std::function<void(const ModbusExchange&)> sink_;
    mutable std::mutex trace_mutex_;
    std::deque<ModbusExchange> trace_;
};

// One line, its start in ms relative to `origin`: "+5.0 ms, took 0.4 ms: unit 1: read register 7 =
// 0005".
std::string describe(const ModbusExchange& exchange, Instant origin);

// One line per exchange, times relative to the last: for records and error reports.
std::string describe(const std::vector<ModbusExchange>& exchanges);

}  // namespace etalon
