// The client of a Modbus stage against a real server: what it does, and that whatever fails, the
// axes stop and the error comes in time.
#include <atomic>
#include <future>

#include "tests/loopback/stage_rig.h"
#include "tests/loopback/tcp_connection.h"

namespace etalon {
namespace {

using Bytes = std::vector<std::uint8_t>;

TEST(ModbusStage, IsOpenedByTheNameOfItsProfile) {
    StageRig rig;
    const auto stage = open_stage(rig.link(), "generic", fast_axes(), rig.clock);
    EXPECT_EQ(stage->axes().size(), 2U);
    EXPECT_THROW(open_stage(rig.link(), "nobody's", fast_axes(), rig.clock), ConfigError);
}

TEST(ModbusStage, MovesNothingBeforeEnableAndHome) {
    StageRig rig;
    auto stage = rig.connect();
    const auto move_error = [&] {
        return device_error_of([&] { stage->move(std::vector{7.0, 0.5}, {}); });
    };
    EXPECT_TRUE(has(device_error_of([&] { stage->home({}); }), "the axes are not enabled"));
    EXPECT_TRUE(has(move_error(), "the axes are not homed"));
    EXPECT_TRUE(rig.server->writes().empty());
    stage->enable({});
    EXPECT_TRUE(has(move_error(), "the axes are not homed"));
    EXPECT_EQ(rig.count_writes(start_bit), 0);
}

TEST(ModbusStage, WritesNothingForATargetOutsideTheSoftLimits) {
    StageRig rig;
    auto stage = rig.connect_and_home();
    const std::size_t before = rig.server->writes().size();
    EXPECT_THROW(stage->move(std::vector{7.0, 2.001}, {}), ConfigError);
    EXPECT_THROW(stage->move(std::vector{-7.001, 0.5}, {}), ConfigError);
    EXPECT_THROW(stage->move(std::vector{7.0}, {}), ConfigError);
    EXPECT_THROW(stage->move(std::vector{std::nan(""), 0.5}, {}), ConfigError);
    EXPECT_EQ(rig.server->writes().size(), before);
    stage->move(std::vector{7.0, 0.5}, {});  // it is still in order
}

TEST(ModbusStage, ResetsAnOldAlarmWhenEnabledButNotOneThatStays) {
    StageRig rig;
    rig.simulation.raise_alarm(StageAlarm::watchdog);
    auto stage = rig.connect();
    EXPECT_EQ(stage->status()[0].alarm, StageAlarm::watchdog);
    stage->enable({});
    EXPECT_EQ(stage->status()[0].alarm, 0);

    rig.profile.sequences.reset[1].within = 50ms;
    rig.server->set_script([&](const ModbusRequest&) {
        rig.simulation.raise_alarm(5);
        return ModbusReaction{};
    });
    auto again = rig.connect();
    const std::string error = device_error_of([&] { again->enable({}); });
    EXPECT_TRUE(has(error, "reset the alarms: not done after 50 ms")) << error;
}

TEST(ModbusStage, SurvivesAConnectionClosedByTheDevice) {
    StageRig rig;
    auto stage = rig.connect_and_home();
    int closed = 0;
    rig.server->set_script([&](const ModbusRequest& request) {
        const bool now = closed < 2 && request.values.empty() && rig.is_beyond(10.0);
        closed += now;
        return ModbusReaction{.carry_out = !now, .reply = !now, .close = now};
    });
    stage->move(std::vector{70.0, 0.5}, {});
    EXPECT_EQ(closed, 2);
    EXPECT_NEAR(stage->position()[0], 70.0, 1e-9);
    rig.server->close_connections();
    EXPECT_NEAR(stage->position()[1], 0.5, 1e-6);
}

TEST(ModbusStage, StopsTheAxesWhenDestroyedInMidMove) {
    StageRig rig;
    auto stage = rig.connect_and_home();
    rig.simulation.start({690.0, 1.0}, {200.0, 2.0});
    EXPECT_TRUE(stage->status()[0].moving);
    stage.reset();
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_LT(rig.simulation.true_positions()[0], 600.0);
    EXPECT_TRUE(rig.simulation.status()[0].enabled) << "a vertical axis would drop";
}

// The reply to the first request comes when its time is long over and the axis elsewhere.
TEST(ModbusStage, ALateReplyIsNeverTakenForANewValue) {
    StageRig rig(100ms);
    auto stage = rig.connect_and_home();
    stage->move(std::vector{3.0, 0.0}, {});
    int requests = 0;
    rig.server->set_script([&](const ModbusRequest&) {
        ++requests;
        if (requests == 1)
            return ModbusReaction{.delay = 150ms};
        if (requests == 2) {
            rig.simulation.start({5.0, 0.0}, {200.0, 2.0});
            while (rig.simulation.is_moving())
                rig.clock.wait_for(1ms, {});
            return ModbusReaction{.delay = 30ms};
        }
        return ModbusReaction{};
    });
    EXPECT_NEAR(stage->status()[0].position, 5.0, 1e-9);
    EXPECT_EQ(requests, 2);
    EXPECT_NEAR(stage->status()[0].position, 5.0, 1e-9);
}

TEST(ModbusStage, AStartThatIsLostIsGivenAgainAfterReadingBack) {
    StageRig rig(100ms);
    auto stage = rig.connect_and_home();
    bool lost = false;
    std::vector<ModbusRequest> after;
    rig.server->set_script([&](const ModbusRequest& request) {
        if (lost)
            after.push_back(request);
        const bool lose = !lost && gives(request, start_bit);
        lost = lost || lose;
        return ModbusReaction{.carry_out = !lose, .reply = !lose};
    });
    stage->move(std::vector{70.0, 0.5}, {});
    rig.server->set_script({});
    EXPECT_EQ(rig.count_writes(start_bit), 1);
    ASSERT_GE(after.size(), 2U);
    EXPECT_TRUE(after[0].values.empty() && after[0].address == command_register);
    EXPECT_TRUE(gives(after[1], start_bit));
}

TEST(ModbusStage, AStuckAxisEndsTheMoveInTimeAndStopped) {
    StageRig rig;
    rig.profile.limits.move_margin = 200ms;
    auto stage = rig.connect_and_home();
    rig.simulation.jam(0);
    const Instant start = rig.clock.now();
    const std::string error = device_error_of([&] { stage->move(std::vector{20.0, 0.5}, {}); });
    // The longer way is the turn: 0.5 rad at 2 rad/s, times 1.5, plus 200 ms.
    EXPECT_TRUE(has(error,
                    "move: not done after 575 ms: x at 0.0000 mm and moving, rz at 28.6479 deg; "
                    "the axes were stopped"))
        << error;
    EXPECT_LT(rig.clock.now() - start, 2s);
    EXPECT_FALSE(rig.simulation.is_moving());
}

// A controller whose status bits say "there" all the time: the position has the last word.
TEST(ModbusStage, BelievesInPositionOnlyAtThePosition) {
    StageRig rig;
    rig.profile.signals[Signal::in_position] = rig.profile.signals[Signal::homed];
    rig.profile.signals[Signal::moving][0].bit = 9;  // never set
    auto stage = rig.connect();
    stage->enable({});
    stage->home({});
    while (rig.simulation.is_moving())
        rig.clock.wait_for(1ms, {});
    stage->move(std::vector{70.0, 0.5}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], 70.0, 1e-3);
}

TEST(ModbusStage, ASecondClientMayWatchAMove) {
    StageRig rig;
    auto stage = rig.connect_and_home();
    auto watcher = rig.connect();
    std::jthread mover([&] { stage->move(std::vector{70.0, 0.5}, {}); });
    double last = 0.0;
    bool saw_motion = false;
    while (last < 69.9999) {
        const auto status = watcher->status();
        EXPECT_GE(status[0].position, last - 1e-9);
        EXPECT_LE(status[0].position, 70.0001);
        saw_motion = saw_motion || status[0].moving;
        last = status[0].position;
    }
    EXPECT_TRUE(saw_motion);
    watcher.reset();  // a watcher stops nothing
    mover.join();
    EXPECT_EQ(rig.count_writes(stop_bit), 0);
}

TEST(ModbusStage, NobodyAnsweringIsADeviceErrorThatSaysWho) {
    StageRig rig;
    const StageLink link = rig.link();
    rig.server.reset();
    const std::string error = device_error_of(
        [&] { open_modbus_stage(link, builtin_stage_profile("generic"), fast_axes(), rig.clock); });
    EXPECT_EQ(error, "stage " + describe(link) +
                         " unit 1: read registers 0..7: cannot connect: Connection refused");
}

TEST(ModbusStage, RefusesAxesAndLinksThatDoNotFitTheProfile) {
    StageRig rig;
    const auto open = [&](StageLink link, std::vector<Axis> axes) {
        open_modbus_stage(link, rig.profile, std::move(axes), rig.clock);
    };
    EXPECT_THROW(open(rig.link(), {}), ConfigError);
    EXPECT_THROW(open(rig.link(), std::vector<Axis>(9, fast_axes()[0])), ConfigError);
    auto too_long = fast_axes();
    too_long[0].high = 300'000.0;  // 3e9 counts
    EXPECT_THROW(open(rig.link(), too_long), ConfigError);
    StageLink bad = rig.link();
    bad.unit = 250;
    EXPECT_THROW(open(bad, fast_axes()), ConfigError);
    bad = rig.link();
    bad.address = TcpAddress{"127.0.0.1", 70000};
    EXPECT_THROW(open(bad, fast_axes()), ConfigError);
}

TEST(ModbusStage, TellsItsLastExchanges) {
    StageRig rig;
    auto stage = rig.connect_and_home();
    EXPECT_TRUE(has(stage->trace(), "write register 200 = 0003")) << stage->trace();
    EXPECT_TRUE(has(stage->trace(), "read registers 0..7 = 000b 0000 0000 0000 000b"));
}

// ---- stage server

// The twin's Modbus server as a peer on the wire: hostile bytes, taken ports, several clients.

class RawClient {
public:
    explicit RawClient(int port) : connection_(port) {}

    void send(const Bytes& bytes) {
        ASSERT_TRUE(connection_.send({reinterpret_cast<const char*>(bytes.data()), bytes.size()}));
    }
    // The next bytes; empty when the server closed the connection or a second passed.
    Bytes receive() {
        const std::string bytes = connection_.read(1s);
        return {bytes.begin(), bytes.end()};
    }
    Bytes answer(const Bytes& request) {
        send(request);
        return receive();
    }
    bool is_closed() { return connection_.is_closed_within(1s); }

private:
    TcpConnection connection_;
};

TEST(ModbusStageServer, AnswersByTheLetterOfTheProtocol) {
    StageRig rig;
    RawClient client(rig.server->port());
    // Transaction 0x0705, unit 9: write 0x0001 to register 200, then read it.
    EXPECT_EQ(client.answer({7, 5, 0, 0, 0, 6, 9, 6, 0, 200, 0, 1}),
              (Bytes{7, 5, 0, 0, 0, 6, 9, 6, 0, 200, 0, 1}));
    EXPECT_EQ(client.answer({7, 6, 0, 0, 0, 6, 9, 3, 0, 200, 0, 1}),
              (Bytes{7, 6, 0, 0, 0, 5, 9, 3, 2, 0, 1}));
    EXPECT_EQ(client.answer({7, 7, 0, 0, 0, 11, 9, 16, 0, 100, 0, 2, 4, 0, 3, 0, 4}),
              (Bytes{7, 7, 0, 0, 0, 6, 9, 16, 0, 100, 0, 2}));
    EXPECT_EQ(client.answer({7, 8, 0, 0, 0, 6, 9, 3, 0, 100, 0, 2}),
              (Bytes{7, 8, 0, 0, 0, 7, 9, 3, 4, 0, 3, 0, 4}));
}

TEST(ModbusStageServer, AnswersWhatItCannotDoWithAnExceptionAtOnce) {
    StageRig rig;
    RawClient client(rig.server->port());
    const Instant start = rig.clock.now();
    EXPECT_EQ(client.answer({0, 1, 0, 0, 0, 2, 1, 0x2B}),
              (Bytes{0, 1, 0, 0, 0, 3, 1, 0xAB, 1}));  // unknown function
    EXPECT_EQ(client.answer({0, 2, 0, 0, 0, 6, 1, 3, 0, 90, 0, 1}),
              (Bytes{0, 2, 0, 0, 0, 3, 1, 0x83, 2}));  // no such register
    EXPECT_EQ(client.answer({0, 7, 0, 0, 0, 6, 1, 4, 0, 100, 0, 1}),
              (Bytes{0, 7, 0, 0, 0, 3, 1, 0x84, 2}));  // another space
    EXPECT_EQ(client.answer({0, 3, 0, 0, 0, 6, 1, 3, 0, 0, 0, 126}),
              (Bytes{0, 3, 0, 0, 0, 3, 1, 0x83, 3}));  // too many
    EXPECT_EQ(client.answer({0, 4, 0, 0, 0, 6, 1, 3, 0, 0, 0, 0}),
              (Bytes{0, 4, 0, 0, 0, 3, 1, 0x83, 3}));  // none
    EXPECT_EQ(client.answer({0, 5, 0, 0, 0, 9, 1, 16, 0, 100, 0, 2, 2, 0, 3}),
              (Bytes{0, 5, 0, 0, 0, 3, 1, 0x90, 3}));  // count and bytes disagree
    EXPECT_EQ(client.answer({0, 6, 0, 0, 0, 3, 1, 3, 0}),
              (Bytes{0, 6, 0, 0, 0, 3, 1, 0x83, 3}));  // cut short
    EXPECT_LT(rig.clock.now() - start, 400ms);
    EXPECT_TRUE(rig.server->writes().empty());
}

TEST(ModbusStageServer, ClosesAConnectionThatDoesNotSpeakModbus) {
    StageRig rig;
    RawClient client(rig.server->port());
    client.send({'G', 'E', 'T', ' ', '/', ' ', 'H', 'T'});
    EXPECT_TRUE(client.receive().empty());
    EXPECT_TRUE(client.is_closed());
}

TEST(ModbusStageServer, HalfARequestHoldsUpNobodyElse) {
    StageRig rig;
    RawClient slow(rig.server->port()), other(rig.server->port());
    slow.send({0, 1, 0, 0, 0, 6, 1, 3});
    other.send({0, 2, 0, 0, 0, 6, 1, 3, 0, 200, 0, 1});
    EXPECT_EQ(other.receive(), (Bytes{0, 2, 0, 0, 0, 5, 1, 3, 2, 0, 0}));
    slow.send({0, 201, 0, 1});
    EXPECT_EQ(slow.receive(), (Bytes{0, 1, 0, 0, 0, 5, 1, 3, 2, 0, 0}));
}

TEST(ModbusStageServer, AnOccupiedPortIsADeviceError) {
    StageRig rig;
    SimulatedStage another(fast_axes(), {}, rig.clock);
    EXPECT_GT(rig.server->port(), 1023);
    EXPECT_THROW(ModbusStageServer(another, rig.profile, rig.server->port()), DeviceError);
    EXPECT_THROW(ModbusStageServer(another, rig.profile, 70000), ConfigError);
}

TEST(ModbusStageServer, ItsPortIsFreeAgainAtOnce) {
    StageRig rig;
    const int port = rig.server->port();
    { RawClient client(port); }
    rig.server.reset();
    rig.server = std::make_unique<ModbusStageServer>(rig.simulation, rig.profile, port);
    EXPECT_EQ(rig.server->port(), port);
}

}  // namespace
}  // namespace etalon
