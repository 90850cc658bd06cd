// The wire between a station and a twin's controller without one: in memory and on virtual time, so
// that thousands of moves with faults take seconds. Replies come late, broken or never as they
// would on a socket or a serial line: a socket's old replies end with their connection and carry
// the transaction they answer; a serial line's arrive whenever they like and look like any other.
//
// For one thread. A clock that is advanced by nobody else but the station's own waiting.
#pragma once

#include "core/time/clock.h"
#include "mocks/stage/modbus_controller.h"
#include "stage/link/modbus_transport.h"

namespace etalon {

class MemoryTransport final : public ModbusTransport {
public:
    // Both must outlive the transport.
    MemoryTransport(ModbusController& controller, VirtualClock& clock, bool serial)
        : controller_(controller), clock_(clock), serial_(serial) {}

    std::string connect(std::chrono::milliseconds timeout) override;
    void close() noexcept override;
    ModbusReply exchange(const ModbusRequest& request, std::chrono::milliseconds timeout) override;
    Heard discard(Duration wait) override;

private:
    struct Frame {
        Instant begin, end;  // of its arrival
        int transaction = 0;
        ModbusRequest request;  // that it answers
        int exception = no_exception;
        std::vector<std::uint16_t> values;
        bool garbage = false;
    };

    void advance_to(Instant until);
    void queue(const ModbusRequest& request, const ModbusAnswer& answer);
    ModbusReply judge(const Frame& frame, const ModbusRequest& request) const;

    ModbusController& controller_;
    VirtualClock& clock_;
    bool serial_;
    bool hung_up_ = false, deaf_ = false;
    int transaction_ = 0;
    std::vector<Frame> line_;  // on their way to the station
};

}  // namespace etalon
