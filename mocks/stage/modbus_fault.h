// Scripted faults of the link between station and stage (twin.yaml's `faults`, beside the stage's).
#pragma once

#include "mocks/stage/simulated_stage.h"
#include "stage/link/modbus_transport.h"

namespace etalon {

struct ModbusFault {
    // What happens to a request or its reply. The request is carried out unless said otherwise.
    enum class Kind {
        late_reply,  // the reply comes `delay` late
        silence,     // no reply
        exception,   // not carried out; the exception `code`
        garbage,     // bytes that are no reply
        wrong_id,    // the reply of another transaction (TCP) or unit (RTU)
        half_open,   // no reply, and the connection stays open but dead
        slow_bytes,  // the reply comes byte by byte, `delay` between two of them
        reset        // no reply, and the connection is closed
    };
    Kind kind = Kind::silence;
    FaultTrigger at;   // a time or a move: the next request after it
    int requests = 1;  // so many in a row
    std::chrono::milliseconds delay{0};
    int code = 0;  // 1 to 255

    // False: as if the request itself had been lost (silence, garbage, wrong_id, half_open, reset).
    bool carried_out = true;
};

// What the controller does with one request and its reply.
struct ModbusReaction {
    bool carry_out = true;               // false: as if the request had been lost
    bool reply = true;                   // false: as if the reply had been lost
    std::chrono::milliseconds delay{0};  // of the reply; the request is carried out at once
    bool close = false;                  // the connection, after the reply; a line has none
    int exception = 0;                   // instead of carrying it out
    bool garbage = false;                // instead of the reply
    bool wrong_id = false;               // of the reply
    std::chrono::milliseconds between_bytes{0};
    bool half_open = false;  // from now on this connection is not listened to; a line: this once
};
using ModbusScript = std::function<ModbusReaction(const ModbusRequest&)>;

ModbusReaction reaction_to(const ModbusFault& fault);

// The faults at their moments; requests are counted from now on. The stage, which tells time and
// moves, must outlive the script. For one thread.
ModbusScript scripted_faults(std::vector<ModbusFault> faults, SimulatedStage& stage);

}  // namespace etalon
