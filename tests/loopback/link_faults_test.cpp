// Every fault of the wire, by name, over TCP and over a serial line: what a read and a write make
// of it, and in which time.
#include <gtest/gtest.h>

#include "stage/link/modbus_link.h"
#include "tests/loopback/stage_rig.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;
using Kind = ModbusFault::Kind;

struct FaultCase {
    const char* name;
    ModbusFault fault;
    bool write_is_refused = false;  // with certainty, instead of left uncertain
};

std::vector<FaultCase> cases() {
    const auto fault = [](Kind kind, std::chrono::milliseconds delay = 0ms, int code = 0) {
        return ModbusFault{
            .kind = kind, .at = {FaultTrigger::When::request, 1}, .delay = delay, .code = code};
    };
    return {{"LateReply", fault(Kind::late_reply, 150ms)},
            {"Silence", fault(Kind::silence)},
            {"Exception", fault(Kind::exception, 0ms, 6), true},
            {"Garbage", fault(Kind::garbage)},
            {"WrongId", fault(Kind::wrong_id)},
            {"HalfOpen", fault(Kind::half_open)},
            {"SlowBytes", fault(Kind::slow_bytes, 20ms)},
            {"Reset", fault(Kind::reset)}};
}

class LinkFault : public testing::TestWithParam<std::tuple<FaultCase, Wire>> {
protected:
    const FaultCase& fault_case() const { return std::get<0>(GetParam()); }

    void write(std::uint16_t first, std::uint16_t second) {
        const std::vector<std::uint16_t> values = {first, second};
        link.write(1, RegisterSpace::holding_registers, 104, values);
    }
    void break_next() {
        rig.server->set_script(scripted_faults({fault_case().fault}, rig.simulation));
    }

    StageRig rig{100ms, std::get<1>(GetParam())};
    ModbusLink link{rig.link(), rig.clock};
};

// One attempt of 100 ms, a pause of 20 ms, 200 ms until the line is quiet, one more attempt; the
// rest is for a busy machine.
TEST_P(LinkFault, AReadGetsTheRightValueAllTheSame) {
    write(7, 5);
    break_next();
    const Instant start = rig.clock.now();
    EXPECT_EQ(link.read(1, RegisterSpace::holding_registers, 104, 2),
              (std::vector<std::uint16_t>{7, 5}));
    EXPECT_LT(rig.clock.now() - start, 900ms);
    EXPECT_EQ(link.read(1, RegisterSpace::holding_registers, 105, 1),
              std::vector<std::uint16_t>{5});
}

TEST_P(LinkFault, AWriteIsSentOnceAndCanBeReadBack) {
    write(7, 5);
    break_next();
    bool uncertain = false;
    try {
        write(9, 3);
        ADD_FAILURE() << "no error";
    } catch (const UncertainWrite&) {
        uncertain = true;
    } catch (const DeviceError&) {
    }
    EXPECT_EQ(uncertain, !fault_case().write_is_refused);
    const bool done = !fault_case().write_is_refused;
    EXPECT_EQ(link.read(1, RegisterSpace::holding_registers, 104, 2),
              done ? (std::vector<std::uint16_t>{9, 3}) : (std::vector<std::uint16_t>{7, 5}));
    EXPECT_EQ(rig.server->writes().size(), done ? 2U : 1U);
}

INSTANTIATE_TEST_SUITE_P(Every, LinkFault,
                         testing::Combine(testing::ValuesIn(cases()),
                                          testing::Values(Wire::tcp, Wire::rtu)),
                         [](const auto& one) {
                             return std::get<0>(one.param).name + name_of(std::get<1>(one.param));
                         });

}  // namespace
}  // namespace etalon
