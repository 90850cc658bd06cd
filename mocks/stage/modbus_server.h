// Modbus TCP (127.0.0.1) or Modbus RTU on a serial line, in front of what answers the requests: a
// stage controller (modbus_controller.h) or a room's sensor (room_sensor_server.h). Function codes
// 1 to 6, 15 and 16; others are answered by an exception.
#pragma once

#include <poll.h>

#include <atomic>
#include <thread>

#include "mocks/stage/modbus_fault.h"
#include "mocks/stage/modbus_framing.h"
#include "mocks/stage/serial_pair.h"

namespace etalon {

// How often the units are told that time passes.
inline constexpr std::chrono::milliseconds modbus_tick{10};

// What is said to a request, before it goes onto the wire.
struct ModbusAnswer {
    ModbusReaction reaction;
    int exception = no_exception;
    std::vector<std::uint16_t> values;  // of a read
};

// The devices on a bus. The server calls them on its one thread.
class ModbusUnits {
public:
    virtual ~ModbusUnits() = default;
    virtual bool has_unit(int unit) const = 0;
    virtual ModbusAnswer handle(const ModbusRequest& request) = 0;  // of a unit that is there
    virtual void tick() {}
};

// A client's connection, or the serial line.
struct ModbusChannel {
    struct Outgoing {
        Bytes bytes;
        Instant due;
    };

    FileDescriptor fd;
    ModbusFraming framing = ModbusFraming::tcp;
    Bytes received = {};
    Instant last_received{};
    std::vector<Outgoing> outgoing = {};
    bool deaf = false;  // half open: read, but not listened to
    bool closing = false;

    // A serial line is not closed; what has been received of the next request is lost.
    void give_up() {
        received.clear();
        closing = framing == ModbusFraming::tcp;
    }
};

class ModbusServer {
public:
    // Listens at once; port 0 takes any free one. Throws DeviceError when the port is taken,
    // ConfigError for no port. The units must outlive the server. One thread for up to 16 clients.
    ModbusServer(ModbusUnits& units, int port);

    // Answers on the serial line, which must outlive the server.
    ModbusServer(ModbusUnits& units, const SerialPair& line);

    ~ModbusServer();  // closes every connection and returns within milliseconds

    int port() const { return port_; }  // the bound one; 0 on a serial line
    void close_connections();           // those that are open now; a serial line has none

private:
    void begin();
    void wake();
    void serve(std::stop_token stop);
    std::vector<pollfd> wait_for_events();
    void close_channels();
    void accept_clients();
    void receive(ModbusChannel& channel);
    void handle(ModbusChannel& channel, const ModbusFrame& frame);

    ModbusUnits& units_;
    FileDescriptor listener_, wake_;  // no listener on a serial line
    int port_ = 0;
    std::vector<ModbusChannel> channels_;  // of the server's thread
    std::atomic<bool> close_requested_ = false;
    std::jthread thread_;  // last, so that it ends first
};

}  // namespace etalon
