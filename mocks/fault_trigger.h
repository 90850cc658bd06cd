// When a scripted fault of the twin happens. One of (twin.yaml's `at`):
//     {time_ms: 2500}   2.5 s after power-on
//     {move: 7}         as the 7th move is started
//     {request: 120}    with the 120th Modbus request, of all clients together
//     {register: 200}   with the first request that writes it (coils: the same)
#pragma once

namespace etalon {

struct FaultTrigger {
    enum class When { time_ms, move, request, write_to };
    When when = When::time_ms;
    int value = 0;  // as above; moves and requests are counted from 1
};

}  // namespace etalon
