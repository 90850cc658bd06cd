// Faults of the link between station and stage, by name, at a scripted moment: what twin.yaml's
// `faults` lists beside those of the stage. The twin's server makes them.
#pragma once

#include <chrono>

#include "mocks/fault_trigger.h"

namespace etalon {

struct ModbusFault {
    // What happens to a request or its reply. Where nothing else is said the request is carried
    // out.
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
};

}  // namespace etalon
