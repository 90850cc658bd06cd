// Modbus RTU through libmodbus and a pseudo-terminal: what a serial line adds to TCP.
#include <time.h>

#include "core/statistics/random.h"
#include "stage/link/modbus_link.h"
#include "tests/loopback/stage_rig.h"

namespace etalon {
namespace {

using Kind = ModbusFault::Kind;

// Registers 100 to 131 of the generic profile keep what is written to them.
constexpr int first_register = 100, register_count = 32;

std::uint16_t content_of(int address) {
    return static_cast<std::uint16_t>(address * 7 + 5);
}

std::vector<std::uint16_t> contents(int first, int count) {
    std::vector<std::uint16_t> values;
    for (int i = 0; i < count; ++i)
        values.push_back(content_of(first + i));
    return values;
}

TEST(Rtu, OnlyTheUnitThatIsAskedAnswers) {
    StageRig rig(60ms, Wire::rtu);
    StageLink link = rig.link();
    ModbusLink bus(link, rig.clock);
    bus.write(1, RegisterSpace::holding_registers, first_register, contents(first_register, 5));
    EXPECT_THROW(bus.read(7, RegisterSpace::holding_registers, first_register, 5, 1), DeviceError);
    EXPECT_EQ(bus.read(1, RegisterSpace::holding_registers, first_register, 5, 1),
              contents(first_register, 5));
}

TEST(Rtu, ALineHasOneMaster) {
    StageRig rig(300ms, Wire::rtu);
    ModbusLink first(rig.link(), rig.clock), second(rig.link(), rig.clock);
    first.read(1, RegisterSpace::holding_registers, first_register, 1);
    try {
        second.read(1, RegisterSpace::holding_registers, first_register, 1, 1);
        ADD_FAILURE() << "two masters";
    } catch (const DeviceError& error) {
        EXPECT_EQ(error.cause(), "cannot connect: another program uses the line");
    }
    first.close();
    second.read(1, RegisterSpace::holding_registers, first_register, 1, 1);
}

TEST(Rtu, ALineThatIsNotThereIsADeviceErrorThatSaysSo) {
    SteadyClock clock;
    ModbusLink link({.address = SerialPort{.device = "/dev/etalon-no-such-line"}}, clock);
    EXPECT_EQ(device_error_of([&] { link.read(1, RegisterSpace::holding_registers, 0, 1, 1); }),
              "stage /dev/etalon-no-such-line unit 1: read register 0: cannot "
              "connect: No such file or directory");
}

TEST(Rtu, ALineWhoseOtherEndIsGoneIsAnErrorAtOnce) {
    StageRig rig(300ms, Wire::rtu);
    ModbusLink link(rig.link(), rig.clock);
    link.read(1, RegisterSpace::holding_registers, first_register, 1);
    rig.server.reset();
    rig.line.reset();
    const Instant start = rig.clock.now();
    EXPECT_THROW(link.read(1, RegisterSpace::holding_registers, first_register, 1), DeviceError);
    EXPECT_LT(rig.clock.now() - start, 1s);
}

// The danger itself: without the guard the next request takes the late reply for its own.
TEST(Rtu, ALateReplyLooksLikeTheNextRequestsReply) {
    StageRig rig(300ms, Wire::rtu);
    ModbusLink(rig.link(), rig.clock)
        .write(1, RegisterSpace::holding_registers, first_register,
               contents(first_register, register_count));
    rig.server->set_script([](const ModbusRequest& request) {
        return ModbusReaction{.delay = request.address == 103 ? 60ms : 90ms};
    });
    const auto bare = make_modbus_transport(rig.link());
    ASSERT_EQ(bare->connect(100ms), "");
    EXPECT_EQ(bare->exchange({1, 3, 103, 2, {}}, 20ms).outcome, ModbusReply::Outcome::unknown);
    const ModbusReply reply = bare->exchange({1, 3, 107, 2, {}}, 1s);
    EXPECT_EQ(reply.values, contents(103, 2)) << "107 was asked for";
}

// 1 reply in 70 comes 0.5 to 2.5 time-outs after its request. The line counts as quiet only after
// a pause that is longer than the slowest reply takes, so that none of them is left.
TEST(RtuEvidence, NoWrongValueInTenThousandReadsWithLateReplies) {
    StageRig rig(20ms, Wire::rtu);
    StageLink settings = rig.link();
    settings.quiet = 80ms;
    ModbusLink link(settings, rig.clock);
    link.write(1, RegisterSpace::holding_registers, first_register,
               contents(first_register, register_count));
    RandomStream late(7, 1), choice(7, 2);
    int delayed = 0, wrong = 0, failed = 0;
    rig.server->set_script([&](const ModbusRequest&) {
        const bool is_late = late.uniform() < 1.0 / 70;
        delayed += is_late;
        const auto delay = 10ms + std::chrono::milliseconds(static_cast<int>(late.uniform() * 40));
        return ModbusReaction{.delay = is_late ? delay : 0ms};
    });
    for (int i = 0; i < 10'000; ++i) {
        const int address =
            first_register + static_cast<int>(choice.uniform() * (register_count - 1));
        try {
            wrong +=
                link.read(1, RegisterSpace::holding_registers, address, 2) != contents(address, 2);
        } catch (const DeviceError&) {
            ++failed;
        }
    }
    fmt::print("RTU: 10000 reads, {} replies late, {} wrong values, {} reads given up\n", delayed,
               wrong, failed);
    EXPECT_GT(delayed, 80);  // 143 expected, standard deviation 12
    EXPECT_EQ(wrong, 0);
    EXPECT_LT(failed, 10);
}

double cpu_seconds_of_this_thread() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

// The client's thread, which decodes the whole status each time. CPU time, so other programs on the
// machine do not count; the bound is of one core.
TEST(PollingEvidence, TwoHundredTimesASecondOverTcpCostsLessThanATwentiethOfACore) {
    StageRig rig;
    auto stage = rig.connect();
    constexpr int polls = 800;
    const double cpu_before = cpu_seconds_of_this_thread();
    const Instant start = rig.clock.now();
    for (int i = 1; i <= polls; ++i) {
        stage->status();
        rig.clock.wait_until(start + i * 5ms, {});
    }
    const double cpu = cpu_seconds_of_this_thread() - cpu_before;
    const std::chrono::duration<double> took = rig.clock.now() - start;
    const double share = cpu / (polls * 0.005);
    fmt::print("TCP: {} polls in {:.2f} s, {:.2f} % of one core at 200 Hz\n", polls, took.count(),
               100.0 * share);
    EXPECT_LT(share, 0.05);
}

}  // namespace
}  // namespace etalon
