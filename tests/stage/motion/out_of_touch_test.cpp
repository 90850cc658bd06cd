// The client of a stage whose machine was suspended, and one whose line somebody else chatters on.

#include "tests/stage/motion/modbus_rig.h"

namespace etalon {
namespace {

using namespace test;

// ---- a machine that is suspended

// The monotonic clock does not count while the machine is suspended; the world does.
class MonotonicClock final : public Clock {
public:
    explicit MonotonicClock(VirtualClock& world) : world_(world) {}
    Instant now() const override { return world_.now() - suspended; }
    bool wait_until(Instant until, std::stop_token stop) override {
        return world_.wait_until(until + suspended, std::move(stop));
    }
    Duration suspended{};

private:
    VirtualClock& world_;
};

// For an hour. The controller sees to its watchdogs every 10 ms.
void suspend(Rig& rig, MonotonicClock& clock) {
    for (Duration slept{}; slept < 2s; slept += 10ms) {
        rig.clock.advance(10ms);
        rig.controller.tick();
    }
    rig.clock.advance(1h - 2s);
    clock.suspended += 1h;
}

std::unique_ptr<Stage> connect_and_home(Rig& rig, Clock& clock) {
    auto stage = open_modbus_stage(
        StageLink{.response_timeout = 100ms}, rig.profile, rig.simulation.axes(), clock,
        std::make_unique<MemoryTransport>(rig.controller, rig.clock, false));
    stage->enable({});
    stage->home({});
    return stage;
}

TEST(ModbusStageMoves, AMachineSuspendedInMidMoveFindsTheWatchdogsAlarmOrAnAxisTooFar) {
    for (const bool watched : {true, false}) {
        Rig rig;
        if (!watched)
            rig.profile.watchdog.reset();
        MonotonicClock clock(rig.clock);
        const auto stage = connect_and_home(rig, clock);
        rig.once_beyond(20.0, [&] { suspend(rig, clock); });
        const std::string error = error_of_move(*stage, {600.0, 1.0});
        EXPECT_THAT(error, HasSubstr(watched ? "alarm 3 (watchdog expired while moving)"
                                             : "axis x cannot have come so far in "));
        EXPECT_THAT(error, HasSubstr("; the axes were stopped"));
        EXPECT_EQ(rig.simulation.true_positions()[0] < 400.0, watched);
    }
}

TEST(ModbusStageMoves, AMachineSuspendedAtRestGoesOn) {
    Rig rig;
    MonotonicClock clock(rig.clock);
    const auto stage = connect_and_home(rig, clock);
    stage->move(std::vector{70.0, 0.5}, {});
    suspend(rig, clock);
    stage->move(std::vector{30.0, 1.0}, {});
    EXPECT_NEAR(stage->position()[0], 30.0, 1e-6);
}

// ---- a line that somebody else chatters on

// A serial line that is never quiet from some moment on; what is asked there comes through.
class ChatteringTransport final : public ModbusTransport {
public:
    ChatteringTransport(ModbusController& controller, VirtualClock& clock, const bool& chatters)
        : line_(controller, clock, true), clock_(clock), chatters_(chatters) {}
    std::string connect(std::chrono::milliseconds timeout) override {
        return line_.connect(timeout);
    }
    void close() noexcept override { line_.close(); }
    ModbusReply exchange(const ModbusRequest& request, std::chrono::milliseconds limit) override {
        return line_.exchange(request, limit);
    }
    Heard discard(Duration wait) override {
        if (!chatters_)
            return line_.discard(wait);
        clock_.advance(std::min<Duration>(wait, 7ms));
        return Heard::something;
    }

private:
    MemoryTransport line_;
    VirtualClock& clock_;
    const bool& chatters_;
};

// 4 x quiet, 2.8 s, is longer than the profile gives to stopping, 2 s.
TEST(ModbusStageLine, AStopIsToldInTimeOnALineThatChatters) {
    Rig rig;
    bool chatters = false;
    const auto stage = open_modbus_stage(
        StageLink{.address = SerialPort{.device = "/dev/ttyUSB5"}, .quiet = 700ms}, rig.profile,
        rig.simulation.axes(), rig.clock,
        std::make_unique<ChatteringTransport>(rig.controller, rig.clock, chatters));
    stage->enable({});
    stage->home({});
    std::optional<Instant> told;
    rig.controller.set_script([&](const ModbusRequest& request) {
        if (gives(request, stop_bit))
            told = told.value_or(rig.clock.now());
        return ModbusReaction{};
    });
    chatters = true;
    const Instant begin = rig.clock.now();
    EXPECT_FALSE(stage->stop()) << "what is heard on such a line confirms nothing";
    ASSERT_TRUE(told);
    EXPECT_LE(*told - begin, 1010ms);
    EXPECT_LE(rig.clock.now() - begin, 2050ms);
}

}  // namespace
}  // namespace etalon
