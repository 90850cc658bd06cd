// Every shipped profile end to end, over TCP and over a serial line: the client and the twin's
// controller read the same file, and two axes do what they are told. Profiles of one axis drive
// them as two units on one bus.
#include <time.h>

#include "core/statistics/random.h"
#include "stage/link/modbus_link.h"
#include "tests/loopback/stage_rig.h"

namespace etalon {
namespace {

using Kind = ModbusFault::Kind;

// Half a count, and the last digit of the conversion.
double half_count(const StageRig& rig, std::size_t axis) {
    return 0.501 / std::abs(rig.profile.counts_of(rig.axes[axis], 1.0) -
                            rig.profile.counts_of(rig.axes[axis], 0.0));
}

void expect_at(StageRig& rig, Stage& stage, const std::vector<double>& target) {
    const std::vector<double> truth = rig.simulation.true_positions(), read = stage.position();
    for (std::size_t i = 0; i < target.size(); ++i) {
        EXPECT_NEAR(truth[i], target[i], half_count(rig, i));
        EXPECT_NEAR(read[i], target[i], half_count(rig, i));
    }
}

// Whether a request gives the command that starts a move.
bool starts(const StageProfile& profile, const ModbusRequest& request) {
    if (request.values.empty())
        return false;
    const auto input = profile.inputs.find(Input::start);
    if (input == profile.inputs.end())
        return request.address == profile.target.back().address;
    const InputPoint& point = input->second;
    return request.address == point.address &&
           (point.act == InputPoint::Act::code ? request.values[0] == point.code
                                               : (request.values[0] >> point.bit & 1) != 0);
}

class ProfileOnAWire : public testing::TestWithParam<std::tuple<std::string, Wire>> {
protected:
    Wire wire() const { return std::get<1>(GetParam()); }
    int units() const { return static_cast<int>(rig.simulation.controllers().size()); }

    StageProfile profile = builtin_stage_profile(std::get<0>(GetParam()));
    StageRig rig{2s, wire(), profile, axes_for(profile)};
};

TEST_P(ProfileOnAWire, EnablesHomesAndMovesToWhereItIsTold) {
    auto stage = rig.connect();
    EXPECT_TRUE(rig.server->writes().empty());
    stage->enable({});
    stage->home({});
    expect_at(rig, *stage, {0.0, 0.0});
    const std::vector<double> first = {7.1234, -0.25}, second = {-5.5, 0.375};
    stage->move(first, {});
    expect_at(rig, *stage, first);
    stage->move(second, {});
    expect_at(rig, *stage, second);
    for (const AxisStatus& axis : stage->status())
        EXPECT_TRUE(axis.enabled && axis.homed && axis.in_position && !axis.moving && !axis.alarm);
    EXPECT_EQ(rig.simulation.moves_started(), 2 * units());
}

TEST_P(ProfileOnAWire, StopsInMidMoveAndGoesOn) {
    auto stage = rig.connect_and_home();
    std::stop_source interrupt;
    rig.server->set_script([&](const ModbusRequest&) {
        if (rig.is_beyond(10.0))
            interrupt.request_stop();
        return ModbusReaction{};
    });
    EXPECT_THROW(stage->move(std::vector{690.0, 1.0}, interrupt.get_token()), Interrupted);
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_LT(rig.simulation.true_positions()[0], 600.0);
    rig.server->set_script({});
    const std::vector<double> target = {7.0, 0.5};
    stage->move(target, {});
    expect_at(rig, *stage, target);
}

TEST_P(ProfileOnAWire, AnAlarmStopsAllAxesAndIsResetWhenEnabledAgain) {
    auto stage = rig.connect_and_home();
    bool raised = false;
    rig.server->set_script([&](const ModbusRequest&) {
        if (!raised && rig.is_beyond(10.0)) {
            rig.simulation.raise_alarm(17);
            raised = true;
        }
        return ModbusReaction{};
    });
    const std::string error = device_error_of([&] { stage->move(std::vector{690.0, 1.0}, {}); });
    EXPECT_NE(error.find(profile.alarm_code ? "axis x: alarm 17" : "axis x: alarm without a"),
              std::string::npos)
        << error;
    EXPECT_NE(error.find("; the axes were stopped"), std::string::npos) << error;
    EXPECT_FALSE(rig.simulation.is_moving());
    rig.server->set_script({});
    stage.reset();
    stage = rig.connect_and_home();
    const std::vector<double> target = {7.0, 0.5};
    stage->move(target, {});
    expect_at(rig, *stage, target);
}

// What the controller takes for a start, however it is given.
TEST_P(ProfileOnAWire, AStartWhoseReplyIsLostIsNotGivenTwice) {
    StageRig impatient(300ms, wire(), profile, axes_for(profile));
    auto stage = impatient.connect_and_home();
    bool dropped = false;
    impatient.server->set_script([&](const ModbusRequest& request) {
        const bool drop = !dropped && starts(profile, request);
        dropped = dropped || drop;
        return ModbusReaction{.reply = !drop};
    });
    const std::vector<double> target = {70.0, 0.5};
    stage->move(target, {});
    EXPECT_TRUE(dropped);
    EXPECT_EQ(impatient.simulation.moves_started(), units());
    expect_at(impatient, *stage, target);
}

INSTANTIATE_TEST_SUITE_P(Every, ProfileOnAWire,
                         testing::Combine(testing::ValuesIn(builtin_stage_profile_names()),
                                          testing::Values(Wire::tcp, Wire::rtu)),
                         [](const auto& one) {
                             std::string name = std::get<0>(one.param);
                             std::erase(name, '-');
                             return name + name_of(std::get<1>(one.param));
                         });

// ---- rtu

// Modbus RTU through libmodbus and a pseudo-terminal: what a serial line adds to TCP.

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
