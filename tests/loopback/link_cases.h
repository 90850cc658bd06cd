// Every fault of the wire, by name, over TCP and over a serial line.
#pragma once

#include "tests/loopback/stage_rig.h"

namespace etalon {

struct LinkCase {
    const char* name;
    ModbusFault fault;
};

inline ModbusFault link_fault(ModbusFault::Kind kind,
                              std::chrono::milliseconds delay = std::chrono::milliseconds(0),
                              int code = 0) {
    return {.kind = kind, .at = {FaultTrigger::When::request, 1}, .delay = delay, .code = code};
}

// Those that may pass. A late reply comes after `late`, which must be longer than the time-out.
inline std::vector<LinkCase> link_cases(std::chrono::milliseconds late) {
    using Kind = ModbusFault::Kind;
    return {{"LateReply", link_fault(Kind::late_reply, late)},
            {"Silence", link_fault(Kind::silence)},
            {"Garbage", link_fault(Kind::garbage)},
            {"WrongId", link_fault(Kind::wrong_id)},
            {"HalfOpen", link_fault(Kind::half_open)},
            {"SlowBytes", link_fault(Kind::slow_bytes, std::chrono::milliseconds(20))},
            {"Reset", link_fault(Kind::reset)},
            {"Busy", link_fault(Kind::exception, {}, 6)}};
}

using LinkCaseOnAWire = std::tuple<LinkCase, Wire>;

inline std::string case_name(const testing::TestParamInfo<LinkCaseOnAWire>& one) {
    return std::get<0>(one.param).name + name_of(std::get<1>(one.param));
}

}  // namespace etalon
