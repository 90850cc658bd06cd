// A stage controller on Modbus TCP: the registers of a profile over real sockets on 127.0.0.1, in
// front of a simulated stage. For the twin and for tests, which script its faults.
//
// Written from "MODBUS Application Protocol V1.1b3" and "MODBUS Messaging on TCP/IP Implementation
// Guide V1.0b", without the library that the client uses: the two check each other.
// Function codes 3, 4 (the same registers), 6 and 16; everything else is answered by an exception.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "mocks/simulated_stage.h"
#include "stage/modbus_transport.h"
#include "stage/profile.h"

namespace etalon {

// What a scripted fault does with a request.
struct ModbusReaction {
    bool carry_out = true;               // false: as if the request had been lost
    bool reply = true;                   // false: as if the reply had been lost
    std::chrono::milliseconds delay{0};  // of the reply; the request is carried out at once
    bool close = false;                  // close the connection (after the reply, if any)
};
using ModbusScript = std::function<ModbusReaction(const ModbusRequest&)>;

class ModbusStageServer {
public:
    // Listens at once; port 0 takes any free one. Throws DeviceError when the port is taken,
    // ConfigError when it is none. The
    // stage must outlive the server. One thread serves every client (at most 16).
    ModbusStageServer(SimulatedStage& stage, const StageProfile& profile, int port = 0);
    ~ModbusStageServer();  // closes every connection and returns within milliseconds
    ModbusStageServer(const ModbusStageServer&) = delete;
    ModbusStageServer& operator=(const ModbusStageServer&) = delete;

    int port() const;  // the bound one

    // Asked about every request from now on, on the server's thread; an empty one ends the faults.
    // Safe from every thread.
    void set_script(ModbusScript script);

    // Closes every connection that is open now.
    void close_connections();

    // Every write that was carried out, in order. Safe from every thread.
    std::vector<ModbusRequest> writes() const;

private:
    class Worker;
    std::unique_ptr<Worker> worker_;
};

}  // namespace etalon
