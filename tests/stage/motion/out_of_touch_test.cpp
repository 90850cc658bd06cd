// The client of a stage whose machine was suspended, and one whose line somebody else chatters on.
#include "tests/stage/motion/modbus_rig.h"

namespace etalon {
namespace {

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

// ---- smallest steps

// A controller counts in steps, of the way and of the speed, which may be larger than what it is
// asked for.

// Below one count nothing could be told to arrive: every move would end at its time limit.
TEST(ModbusStageSteps, AnAxisThatCountsCoarserThanItsToleranceIsRefused) {
    Rig rig;  // 1 um, 0.0002 degree
    rig.profile.counts.per_mm = 990.0;
    EXPECT_THAT(config_error_of([&] { rig.connect(); }),
                HasSubstr("stage axes: x: one of its counts, 0.0010101 mm, is more than the "
                          "profile's tolerance, 0.001 mm"));
    rig.profile.counts = {.per_mm = -1000.0, .per_deg = 4900.0};
    EXPECT_THAT(config_error_of([&] { rig.connect(); }),
                HasSubstr("stage axes: rz: one of its counts"));
    rig.profile.counts.per_deg = 5000.0;
    EXPECT_NO_THROW(rig.connect());
}

TEST(ModbusStageSteps, AnApproachOfLessThanTwoCountsIsRefused) {
    std::vector<Axis> axes = fast_axes();
    axes[0].approach = -1;
    axes[0].overrun = 0.0019;
    Rig rig(builtin_stage_profile("generic"), axes);
    rig.profile.counts.per_mm = 1000.0;
    EXPECT_THAT(
        config_error_of([&] { rig.connect(); }),
        HasSubstr("stage axes: x: its overrun before the approach, 0.0019 mm, is less than two "
                  "of its counts, 0.002 mm"));
    rig.profile.counts.per_mm = 1100.0;
    EXPECT_NO_THROW(rig.connect());
}

// 200 counts a mm: 5 um, and limits in mid count. Rounded to the nearest both would be beyond them.
TEST(ModbusStageSteps, NoTargetIsRoundedToBeyondASoftLimit) {
    std::vector<Axis> axes = fast_axes();
    axes[0].low = -7.0029;
    axes[0].high = 50.0029;
    HomedRig rig(by_code, axes);
    rig.stage->move(std::vector{50.0029, 0.5}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], 50.0, 1e-6);
    rig.stage->move(std::vector{-7.0029, 0.5}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], -7.0, 1e-6);
    rig.stage->move(std::vector{7.0029, 0.5}, {});
    EXPECT_NEAR(rig.simulation.true_positions()[0], 7.005, 1e-6) << "elsewhere to the nearest";
}

// Speeds in whole steps of 5 counts a second, 25 um/s: 1.9 of them are 1, and less would be faster
// than was asked for.
TEST(ModbusStageSteps, ASpeedBelowTheSmallestStepIsRefusedAndNotMadeFaster) {
    HomedRig rig(by_code);
    rig.stage->limit_speed(1.9 * 0.025 / 200.0);
    const Instant start = rig.clock.now();
    rig.stage->move(std::vector{0.1, 0.0}, {});
    EXPECT_NEAR(std::chrono::duration<double>(rig.clock.now() - start).count(), 4.0, 0.2);
    EXPECT_THAT(config_error_of([&] { rig.stage->limit_speed(0.99 * 0.025 / 200.0); }),
                HasSubstr("stage axes: x: 0.012375 % of its speed is not 1 to 65535 in the speed "
                          "register"));
}

// ---- tacit controller

// A controller that does not tell whether its axes are homed.

class ATacitController : public testing::Test {
protected:
    static constexpr int inputs = 0x7D, home_bit = 0x10;  // of base/oriental

    ATacitController() {
        axes[0].counts_per_unit = 800.0;
        rig = std::make_unique<Rig>(builtin_stage_profile("oriental-ar"), axes);
    }
    void ignore_homing() {
        rig->controller.set_script([this](const ModbusRequest& request) {
            const bool home = writes_to(request, inputs) && (request.values[0] & home_bit) != 0;
            homings += home;
            return ModbusReaction{.carry_out = !home};
        });
    }

    std::vector<Axis> axes = {fast_axes()[0]};
    std::unique_ptr<Rig> rig;
    int homings = 0;
};

TEST_F(ATacitController, IsHomedWhenItsAxesWereSeenToMoveForIt) {
    rig->connect_and_home()->move(std::vector{7.0}, {});
    EXPECT_NEAR(rig->simulation.true_positions()[0], 7.0, 1e-6);
}

TEST_F(ATacitController, IsNotTakenForHomedBecauseItRests) {
    ignore_homing();
    auto stage = rig->connect();
    stage->enable({});
    const std::string error = device_error_of([&] { stage->home({}); });
    EXPECT_THAT(
        error,
        HasSubstr("home: axis x did not move, and its controller does not tell whether it is "
                  "homed"));
    EXPECT_THAT(error, HasSubstr("--homed"));
    EXPECT_EQ(homings, 1);
    EXPECT_THROW(stage->move(std::vector{7.0}, {}), DeviceError);
    EXPECT_EQ(rig->simulation.moves_started(), 0);
}

TEST_F(ATacitController, StandsAtItsZeroWhenTheOperatorSaysSo) {
    ignore_homing();
    auto stage = rig->connect();
    stage->take_for_homed();
    stage->enable({});
    EXPECT_EQ(device_error_of([&] { stage->home({}); }), "no error");
    EXPECT_EQ(homings, 1) << "homing is commanded all the same";
}

TEST_F(ATacitController, IsMovedByHandOnTheOperatorsWordAlone) {
    rig->connect_and_home();
    auto stage = rig->connect();
    EXPECT_THAT(device_error_of([&] { stage->resume(); }),
                HasSubstr("say that they are (--homed)"));
    EXPECT_THROW(stage->move(std::vector{7.0}, {}), DeviceError);
    stage->take_for_homed();
    stage->resume();
    stage->move(std::vector{7.0}, {});
    EXPECT_NEAR(rig->simulation.true_positions()[0], 7.0, 1e-6);
}

// What a controller tells, nobody's word outweighs.
TEST(ModbusStageMoves, AControllerThatSaysItIsNotHomedIsBelieved) {
    Rig rig;
    auto stage = rig.connect();
    stage->enable({});
    stage->take_for_homed();
    EXPECT_THAT(device_error_of([&] { stage->resume(); }), HasSubstr("axis x is not homed"));
}

}  // namespace
}  // namespace etalon
