// The fault table of docs/stage.md: every fault of the link and of the stage in mid-motion, over
// TCP and over a serial line: whether the move goes on, or the axes stop and whether that is
// confirmed, and in which time.
#include <future>

#include "stage/link/modbus_link.h"
#include "tests/loopback/stage_rig.h"

namespace etalon {
namespace {

using Kind = ModbusFault::Kind;

constexpr auto time_out = 250ms, quiet = 100ms;  // T and Q of the table; quiet as in StageRig
constexpr auto busy_machine = 700ms;             // on top of the table's times
constexpr int for_good = 1'000'000;

enum class Outcome { goes_on, stop_confirmed, stop_not_confirmed };

// Every fault of the wire, by name, over TCP and over a serial line.
struct LinkCase {
    const char* name;
    ModbusFault fault;
};

ModbusFault link_fault(ModbusFault::Kind kind, std::chrono::milliseconds delay = 0ms,
                       int code = 0) {
    return {.kind = kind, .at = {FaultTrigger::When::request, 1}, .delay = delay, .code = code};
}

// Those that may pass. A late reply comes after `late`, which must be longer than the time-out.
std::vector<LinkCase> link_cases(std::chrono::milliseconds late) {
    return {{"LateReply", link_fault(Kind::late_reply, late)},
            {"Silence", link_fault(Kind::silence)},
            {"Garbage", link_fault(Kind::garbage)},
            {"WrongId", link_fault(Kind::wrong_id)},
            {"HalfOpen", link_fault(Kind::half_open)},
            {"SlowBytes", link_fault(Kind::slow_bytes, 20ms)},
            {"Reset", link_fault(Kind::reset)},
            {"Busy", link_fault(Kind::exception, {}, 6)}};
}

using LinkCaseOnAWire = std::tuple<LinkCase, Wire>;

std::string case_name(const testing::TestParamInfo<LinkCaseOnAWire>& one) {
    return std::get<0>(one.param).name + name_of(std::get<1>(one.param));
}

// With an answer that will not pass.
std::vector<LinkCase> all_link_cases() {
    std::vector<LinkCase> cases = link_cases(320ms);
    cases.push_back({"Exception", link_fault(Kind::exception, 0ms, 4)});
    return cases;
}

// One move with a fault on its way.
class FaultRig : public StageRig {
public:
    explicit FaultRig(Wire wire) : StageRig(time_out, wire), stage(connect_and_home()) {}
    ~FaultRig() {  // the server's thread uses what is here
        stage.reset();
        server.reset();
    }

    Duration quiet_time() const { return line ? Duration(quiet) : Duration::zero(); }

    // Lets `begin` happen as soon as x is beyond 10 mm, and what it returns to the requests from
    // then on.
    void break_on_the_way(std::function<ModbusScript()> begin) {
        server->set_script([this, begin = std::move(begin)](const ModbusRequest& request) {
            if (!broken_at && is_beyond(10.0)) {
                broken_at = clock.now();
                faults_ = begin();
            }
            return faults_ ? faults_(request) : ModbusReaction{};
        });
    }
    void break_link(ModbusFault fault, int requests) {
        fault.requests = requests;
        break_on_the_way([this, fault] { return scripted_faults({fault}, simulation); });
    }

    // Moves to `x` mm; `error` is empty when it arrives.
    Outcome move(double x) {
        Outcome outcome = Outcome::goes_on;
        try {
            stage->move(std::vector{x, 0.25}, {});
        } catch (const DeviceError& failure) {
            error = failure.what();
            outcome = error.find("the axes were stopped") != std::string::npos
                          ? Outcome::stop_confirmed
                          : Outcome::stop_not_confirmed;
        }
        took = clock.now() - broken_at.value_or(clock.now());
        return outcome;
    }

    std::unique_ptr<Stage> stage;
    std::optional<Instant> broken_at;
    std::string error;
    Duration took{};  // since the fault

private:
    ModbusScript faults_;  // of the server's thread
};

// ---- faults of the link

class LinkFaultInMotion : public testing::TestWithParam<LinkCaseOnAWire> {
protected:
    const LinkCase& link_case() const { return std::get<0>(GetParam()); }
    bool is_exception() const { return link_case().fault.kind == Kind::exception; }
    bool is_final() const { return is_exception() && link_case().fault.code != 6; }

    FaultRig rig{std::get<1>(GetParam())};
};

// Once: T + 20 ms + 2 Q until the next poll; but an exception is an answer, and one that will not
// pass ends the move.
TEST_P(LinkFaultInMotion, OnceIsRetriedUnlessItIsAFinalAnswer) {
    rig.break_link(link_case().fault, 1);
    const Outcome outcome = rig.move(60.0);
    if (is_final()) {
        EXPECT_EQ(outcome, Outcome::stop_confirmed) << rig.error;
        EXPECT_LT(rig.took, 200ms + busy_machine);
        EXPECT_LT(rig.simulation.true_positions()[0], 59.0);
        return;
    }
    EXPECT_EQ(outcome, Outcome::goes_on) << rig.error;
    EXPECT_NEAR(rig.simulation.true_positions()[0], 60.0, 1e-3);
    EXPECT_EQ(rig.simulation.moves_started(), 1);
    // Beside the 350 ms of the motion itself.
    EXPECT_LT(rig.took, 350ms + time_out + 20ms + 2 * rig.quiet_time() + busy_machine);
}

// Three polls and the first stop: 4 T + 160 ms + 8 Q.
TEST_P(LinkFaultInMotion, FourInARowEndTheMoveAndTheStopIsConfirmed) {
    rig.break_link(link_case().fault, 4);
    EXPECT_EQ(rig.move(690.0), Outcome::stop_confirmed) << rig.error;
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_LT(rig.simulation.true_positions()[0], 680.0);
    EXPECT_LT(rig.took, 4 * time_out + 160ms + 8 * rig.quiet_time() + 100ms + busy_machine);
}

// For good: 3 T + 60 ms + 4 Q until the move is given up, then the stop's time (here 600 ms) and
// the request that runs. Nobody confirms the stop, but the axes rest: they obeyed a stop that they
// could not answer, or the watchdog (here 400 ms) stopped them.
TEST_P(LinkFaultInMotion, ForGoodIsAnErrorInTimeAndTheAxesRest) {
    rig.stage.reset();
    rig.profile.sequences.stop[1].within = 600ms;
    rig.profile.watchdog->timeout = 400ms;
    rig.stage = rig.connect_and_home();
    ModbusFault fault = link_case().fault;
    fault.carried_out = false;
    rig.break_link(fault, for_good);
    EXPECT_EQ(rig.move(690.0), Outcome::stop_not_confirmed) << rig.error;
    EXPECT_NE(rig.error.find("NOT confirmed"), std::string::npos) << rig.error;
    EXPECT_LT(rig.took, 3 * time_out + 60ms + 8 * rig.quiet_time() + 600ms + 100ms + busy_machine);
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_LT(rig.simulation.true_positions()[0], 680.0);
    rig.server->set_script({});
}

// The start is carried out and its reply is lost, or it is lost itself: one motion in both cases.
TEST_P(LinkFaultInMotion, OfTheStartMakesNoSecondMotion) {
    for (const bool carried_out : {true, false}) {
        ModbusFault fault = link_case().fault;
        fault.carried_out = carried_out;
        const int before = rig.simulation.moves_started();
        bool done = false;
        rig.server->set_script([&, fault](const ModbusRequest& request) {
            const bool now = !done && gives(request, start_bit);
            done = done || now;
            return now ? reaction_to(fault) : ModbusReaction{};
        });
        const double target = carried_out ? 60.0 : 25.0;
        const Outcome outcome = rig.move(target);
        EXPECT_TRUE(done);
        if (is_exception()) {  // refused with certainty: not given again
            EXPECT_EQ(outcome, Outcome::stop_confirmed) << rig.error;
            EXPECT_EQ(rig.simulation.moves_started(), before);
            return;
        }
        EXPECT_EQ(outcome, Outcome::goes_on) << rig.error;
        EXPECT_EQ(rig.simulation.moves_started(), before + 1);
        EXPECT_NEAR(rig.simulation.true_positions()[0], target, 1e-3);
    }
}

INSTANTIATE_TEST_SUITE_P(Every, LinkFaultInMotion,
                         testing::Combine(testing::ValuesIn(all_link_cases()),
                                          testing::Values(Wire::tcp, Wire::rtu)),
                         case_name);

// ---- faults of the stage

class StageFaultInMotion : public testing::TestWithParam<Wire> {
protected:
    // The fault happens on the way to 300 mm.
    Outcome move_with(std::function<void()> fault) {
        rig.break_on_the_way([fault] {
            fault();
            return ModbusScript();
        });
        return rig.move(300.0);
    }
    void expect_stopped_within(Outcome outcome, Duration time, const char* cause) {
        EXPECT_EQ(outcome, Outcome::stop_confirmed) << rig.error;
        EXPECT_NE(rig.error.find(cause), std::string::npos) << rig.error;
        EXPECT_LT(rig.took, time + busy_machine);
        EXPECT_FALSE(rig.simulation.is_moving());
        EXPECT_LT(rig.simulation.true_positions()[0], 290.0);
    }

    FaultRig rig{GetParam()};
};

// One poll, one write, braking (50 ms) and three polls.
constexpr auto one_poll_and_braking = 200ms;

TEST_P(StageFaultInMotion, AnAlarmStops) {
    const Outcome outcome = move_with([&] { rig.simulation.raise_alarm(17); });
    expect_stopped_within(outcome, one_poll_and_braking, "axis x: alarm 17");
}

TEST_P(StageFaultInMotion, ALimitSwitchStops) {
    const Outcome outcome = move_with([&] { rig.simulation.hit_limit(0); });
    expect_stopped_within(outcome, one_poll_and_braking, "axis x");
    EXPECT_NE(rig.error.find("limit"), std::string::npos) << rig.error;
}

TEST_P(StageFaultInMotion, AnEmergencyStopStops) {
    const Outcome outcome = move_with([&] { rig.simulation.press_emergency_stop(); });
    expect_stopped_within(outcome, one_poll_and_braking, "emergency stop");
}

TEST_P(StageFaultInMotion, AnEncoderThatJumpsStops) {
    const Outcome outcome = move_with([&] { rig.simulation.jump_encoder(0, 250.0); });
    expect_stopped_within(outcome, one_poll_and_braking, "cannot have come so far");
}

TEST_P(StageFaultInMotion, AnEncoderThatJumpsAtRestRefusesTheNextMove) {
    rig.stage->move(std::vector{20.0, 0.5}, {});
    rig.simulation.jump_encoder(0, 0.05);
    EXPECT_EQ(rig.move(300.0), Outcome::stop_confirmed);
    EXPECT_NE(rig.error.find("not where they were left"), std::string::npos) << rig.error;
    EXPECT_EQ(rig.simulation.moves_started(), 1);
}

// The longest way is 300 mm at 200 mm/s; times 1.5, plus the margin, here 200 ms.
TEST_P(StageFaultInMotion, AStuckAxisStopsAtTheTimeLimit) {
    rig.stage.reset();
    rig.profile.limits.move_margin = 200ms;
    rig.stage = rig.connect_and_home();
    const Outcome outcome = move_with([&] { rig.simulation.jam(0); });
    expect_stopped_within(outcome, 2250ms + 200ms + one_poll_and_braking, "not done after 2450 ms");
}

TEST_P(StageFaultInMotion, AFalseInPositionIsNotBelieved) {
    EXPECT_EQ(move_with([&] { rig.simulation.claim_arrival(0); }), Outcome::goes_on) << rig.error;
    EXPECT_NEAR(rig.simulation.true_positions()[0], 300.0, 1e-3);
}

// As ForGoodIsAnErrorInTime, but the other end is gone.
TEST_P(StageFaultInMotion, AControllerThatDiesIsAnErrorInTime) {
    std::promise<void> under_way;
    rig.break_on_the_way([&] {
        under_way.set_value();
        return ModbusScript();
    });
    std::jthread killer([&, on_its_way = under_way.get_future()]() mutable {
        on_its_way.wait();
        rig.server.reset();
    });
    EXPECT_EQ(rig.move(690.0), Outcome::stop_not_confirmed) << rig.error;
    EXPECT_LT(rig.took, 3 * time_out + 60ms + 8 * rig.quiet_time() + 2s + 100ms + busy_machine);
}

INSTANTIATE_TEST_SUITE_P(Every, StageFaultInMotion, testing::Values(Wire::tcp, Wire::rtu),
                         [](const auto& one) { return name_of(one.param); });

// ---- link faults

// What a read and a write make of every fault of the wire, and in which time.

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
