// One request out, its reply in, with a time limit. By libmodbus for TCP and serial lines (here),
// by the twin in memory and virtual time. Retries are ModbusLink's. One thread.
#pragma once

#include <cstdint>

#include "core/time/clock.h"
#include "stage/link/stage_link.h"

namespace etalon {

struct ModbusRequest {
    int unit = 1;
    int function = 0;  // 1 to 5, 15, 16; a controller is also asked for 6
    int address = 0, count = 0;
    std::vector<std::uint16_t> values;  // of a write; of coils 0 or 1
};

struct ModbusReply {
    enum class Outcome {
        answered,
        refused,   // by a Modbus exception: an answer, the connection is in order
        not_sent,  // the device has not seen it
        unknown    // no answer, or none that can be trusted
    };
    Outcome outcome = Outcome::unknown;
    int exception = 0;                  // of a refusal; 1: illegal function, 2: no such register
    std::vector<std::uint16_t> values;  // of a read, as many as were asked for
    std::string cause;                  // of everything but an answer, for users
};

class ModbusTransport {
public:
    virtual ~ModbusTransport() = default;

    // Returns why not, or nothing. On a connection that is open it is undefined.
    virtual std::string connect(std::chrono::milliseconds timeout) = 0;
    virtual void close() noexcept = 0;

    // Sends the request once, takes the next reply, at the latest after the time-out. Needs a
    // connection, and values and counts within the protocol's limits.
    virtual ModbusReply exchange(const ModbusRequest& request,
                                 std::chrono::milliseconds timeout) = 0;

    // Waits at most so long for anything that nobody asked for, and throws away what has come.
    enum class Heard { nothing, something, hang_up };
    virtual Heard discard(Duration wait) = 0;
};

// Throws nothing; the link must be usable (stage/link/stage_link.h).
std::unique_ptr<ModbusTransport> make_modbus_transport(const StageLink& link);

}  // namespace etalon
