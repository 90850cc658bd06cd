#include "stage/modbus_link.h"

#include <gtest/gtest.h>

#include <limits>

namespace etalon {
namespace {

using namespace std::chrono_literals;
constexpr auto holding = RegisterSpace::holding_registers;

TEST(ModbusInt32, HasTheHighWordFirst) {
    const auto [high, low] = registers_from_int32(0x00070005);
    EXPECT_EQ(high, 7);
    EXPECT_EQ(low, 5);
    EXPECT_EQ(int32_from_registers(7, 5), 7 * 65536 + 5);
}

TEST(ModbusInt32, RoundTripsWhereSignedMacrosFail) {
    constexpr std::int32_t least = std::numeric_limits<std::int32_t>::min();
    constexpr std::int32_t most = std::numeric_limits<std::int32_t>::max();
    for (const std::int32_t value : {0, 1, -1, 32767, 32768, -32768, -32769, 65535, 65536, -65536,
                                     40000, -40000, least, most}) {
        const auto [high, low] = registers_from_int32(value);
        EXPECT_EQ(int32_from_registers(high, low), value);
    }
    EXPECT_EQ(int32_from_registers(0xFFFF, 0xFFF9), -7);
}

TEST(ModbusLink, RefusesWhatDoesNotFitIntoARequestWithoutConnecting) {
    VirtualClock clock;
    ModbusLink link({.address = TcpAddress{"127.0.0.1", 1}}, clock);
    const std::vector<std::uint16_t> values(124);
    EXPECT_THROW(link.read(1, holding, 0, 126), DeviceError);
    EXPECT_THROW(link.read(1, holding, 0, 0), DeviceError);
    EXPECT_THROW(link.read(1, holding, -1, 5), DeviceError);
    EXPECT_THROW(link.read(1, holding, 65535, 2), DeviceError);
    EXPECT_THROW(link.write(1, holding, 0, values), DeviceError);
    EXPECT_THROW(link.write(1, holding, 0, {}), DeviceError);
    EXPECT_TRUE(link.last_exchanges().empty());
}

// Port 1 of the loopback is closed: refused at once. The pauses of 20 and 40 ms pass on the
// virtual clock; nothing was sent, so a write is not uncertain.
TEST(ModbusLink, PausesLongerAfterEachFailureAndKeepsATrace) {
    VirtualClock clock;
    ModbusLink link({.address = TcpAddress{"127.0.0.1", 1}}, clock);
    const Instant start = clock.now();
    EXPECT_THROW(link.read(1, holding, 7, 5), DeviceError);
    EXPECT_EQ(clock.now() - start, 60ms);
    const auto exchanges = link.last_exchanges();
    ASSERT_EQ(exchanges.size(), 3U);
    EXPECT_EQ(exchanges[0].request, "read registers 7..11");
    EXPECT_EQ(exchanges[2].failure, "cannot connect: Connection refused");
    EXPECT_EQ(describe(exchanges).substr(0, 59),
              "-60.0 ms, took 0.0 ms: unit 1: read registers 7..11: cannot");

    const std::uint16_t value = 5;
    try {
        link.write(1, holding, 3, std::span(&value, 1));
        FAIL() << "written to nobody";
    } catch (const UncertainWrite&) {
        FAIL() << "nothing was sent";
    } catch (const DeviceError& error) {
        EXPECT_STREQ(error.what(),
                     "stage 127.0.0.1:1 unit 1: write register 3: cannot connect: "
                     "Connection refused");
    }
}

TEST(ModbusLink, KeepsTheLastTwoHundredExchanges) {
    VirtualClock clock;
    ModbusLink link({.address = TcpAddress{"127.0.0.1", 1}}, clock);
    for (int address = 0; address < 207; ++address)
        EXPECT_THROW(link.read(1, holding, address, 1, 1), DeviceError);
    const auto exchanges = link.last_exchanges();
    ASSERT_EQ(exchanges.size(), 200U);
    EXPECT_EQ(exchanges.front().request, "read register 7");
    EXPECT_EQ(exchanges.back().request, "read register 206");
}

}  // namespace
}  // namespace etalon
