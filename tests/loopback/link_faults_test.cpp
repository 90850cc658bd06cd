// What a read and a write make of every fault of the wire, and in which time.
#include "stage/link/modbus_link.h"
#include "tests/loopback/link_cases.h"

namespace etalon {
namespace {

class LinkFault : public testing::TestWithParam<LinkCaseOnAWire> {
protected:
    const ModbusFault& fault() const { return std::get<0>(GetParam()).fault; }
    void write(std::uint16_t first, std::uint16_t second) {
        const std::vector<std::uint16_t> values = {first, second};
        link.write(1, RegisterSpace::holding_registers, 104, values);
    }
    void break_next() { rig.server->set_script(scripted_faults({fault()}, rig.simulation)); }

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
    const bool done = fault().kind != ModbusFault::Kind::exception;  // which refuses for certain
    EXPECT_EQ(uncertain, done);
    EXPECT_EQ(link.read(1, RegisterSpace::holding_registers, 104, 2),
              done ? (std::vector<std::uint16_t>{9, 3}) : (std::vector<std::uint16_t>{7, 5}));
    EXPECT_EQ(rig.server->writes().size(), done ? 2U : 1U);
}

INSTANTIATE_TEST_SUITE_P(Every, LinkFault,
                         testing::Combine(testing::ValuesIn(link_cases(150ms)),
                                          testing::Values(Wire::tcp, Wire::rtu)),
                         case_name);

}  // namespace
}  // namespace etalon
