#include "stage/link/modbus_link.h"

#include "tests/test.h"

namespace etalon {
namespace {

constexpr auto holding = RegisterSpace::holding_registers;
const std::vector<std::uint16_t> one = {1};

// Answers as told, and writes down what the link does below.
class ScriptedTransport final : public ModbusTransport {
public:
    struct Record {
        std::vector<std::string> steps;  // "connect", "drain", "read 3 @7", ...
        std::vector<ModbusRequest> requests;
        std::vector<std::chrono::milliseconds> time_limits;  // of the requests
        std::vector<ModbusReply> replies;  // in order; then everything is answered
        std::vector<Heard> heard;          // by the next discards; then nothing
    };

    ScriptedTransport(Record& record, VirtualClock& clock) : record_(record), clock_(clock) {}

    std::string connect(std::chrono::milliseconds) override {
        record_.steps.push_back("connect");
        return {};
    }
    void close() noexcept override { record_.steps.push_back("close"); }
    ModbusReply exchange(const ModbusRequest& request, std::chrono::milliseconds limit) override {
        record_.steps.push_back("request");
        record_.time_limits.push_back(limit);
        record_.requests.push_back(request);
        if (record_.replies.empty())
            return {ModbusReply::Outcome::answered,
                    0,
                    request.values.empty()
                        ? std::vector<std::uint16_t>(static_cast<std::size_t>(request.count), 7)
                        : std::vector<std::uint16_t>{},
                    {}};
        const ModbusReply reply = record_.replies.front();
        record_.replies.erase(record_.replies.begin());
        return reply;
    }
    Heard discard(Duration wait) override {
        if (wait > Duration::zero())
            record_.steps.push_back("listen");
        const Heard heard = record_.heard.empty() ? Heard::nothing : record_.heard.front();
        if (!record_.heard.empty())
            record_.heard.erase(record_.heard.begin());
        clock_.advance(heard == Heard::nothing ? wait
                                               : std::max(wait / 2, std::min<Duration>(wait, 1ms)));
        return heard;
    }

private:
    Record& record_;
    VirtualClock& clock_;
};

struct ScriptedLink {
    explicit ScriptedLink(bool serial)
        : link(settings(serial), clock, std::make_unique<ScriptedTransport>(record, clock)) {}

    static StageLink settings(bool serial) {
        StageLink link{.quiet = 70ms};
        if (serial)
            link.address = SerialPort{.device = "/dev/ttyUSB5"};
        return link;
    }

    VirtualClock clock;
    ScriptedTransport::Record record;
    ModbusLink link;
};

const ModbusReply silence{.values = {}, .cause = "no answer within 300 ms"};
ModbusReply refusal(int exception) {
    return {ModbusReply::Outcome::refused, exception, {}, "refused"};
}

// The error of a write that must fail and surely was not carried out.
std::string unsent_write(ModbusLink& link) {
    return device_error_of([&] {
        try {
            link.write(1, holding, 3, one);
        } catch (const UncertainWrite&) {
            ADD_FAILURE() << "it may have been carried out";
        }
    });
}
using Steps = std::vector<std::string>;
using Heard = ModbusTransport::Heard;

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
    EXPECT_EQ(unsent_write(link),
              "stage 127.0.0.1:1 unit 1: write register 3: cannot connect: Connection refused");
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

TEST(ModbusLink, AsksEverySpaceByItsFunctionAndEveryUnitByItsNumber) {
    ScriptedLink rig(false);
    const std::vector<std::uint16_t> three = {1, 0, 1};
    EXPECT_EQ(rig.link.read(3, RegisterSpace::coils, 20, 5).size(), 5U);
    rig.link.read(5, RegisterSpace::discrete_inputs, 21, 2000);
    rig.link.read(7, RegisterSpace::holding_registers, 22, 125);
    rig.link.read(9, RegisterSpace::input_registers, 23, 2);
    rig.link.write(11, RegisterSpace::coils, 24, one);
    rig.link.write(13, RegisterSpace::coils, 25, three);
    rig.link.write(15, RegisterSpace::holding_registers, 26, one);
    const auto& requests = rig.record.requests;
    const int functions[] = {1, 2, 3, 4, 5, 15, 16};
    ASSERT_EQ(requests.size(), 7U);
    for (std::size_t i = 0; i < requests.size(); ++i) {
        EXPECT_EQ(requests[i].function, functions[i]);
        EXPECT_EQ(requests[i].unit, 3 + 2 * static_cast<int>(i));
        EXPECT_EQ(requests[i].address, 20 + static_cast<int>(i));
    }
    EXPECT_EQ(requests[5].values, three);
    EXPECT_EQ(rig.link.last_exchanges()[1].request, "read discrete inputs 21..2020");
    EXPECT_EQ(rig.link.last_exchanges()[4].request, "write coil 24");

    EXPECT_THROW(rig.link.read(1, RegisterSpace::coils, 0, 2001), DeviceError);
    EXPECT_THROW(rig.link.write(1, RegisterSpace::discrete_inputs, 0, one), DeviceError);
    EXPECT_THROW(rig.link.write(1, RegisterSpace::input_registers, 0, one), DeviceError);
    EXPECT_EQ(requests.size(), 7U);
}

TEST(ModbusLink, DrainsASerialLineAfterOpeningItAndAfterEveryFailure) {
    ScriptedLink rig(true);
    rig.record.heard = {Heard::something, Heard::nothing};
    rig.record.replies = {silence};
    EXPECT_EQ(rig.link.read(1, holding, 5, 1).front(), 7);
    EXPECT_EQ(rig.record.steps, (Steps{"connect", "listen", "listen", "request", "close",  //
                                       "connect", "listen", "request"}));
    // Half the gap with the old reply, a whole one; 20 ms pause, a whole one.
    EXPECT_EQ(rig.clock.now().time_since_epoch(), 35ms + 70ms + 20ms + 70ms);
}

// 3.5 characters of 11 bits at 9600 baud: 4.01 ms; at 115200 the standard's 1.75 ms.
TEST(ModbusLink, BeginsASerialFrameWithSilence) {
    for (const int baud : {9600, 115200}) {
        VirtualClock clock;
        ScriptedTransport::Record record;
        ModbusLink link({.address = SerialPort{.device = "/dev/ttyUSB5", .baud = baud}}, clock,
                        std::make_unique<ScriptedTransport>(record, clock));
        link.read(1, holding, 5, 1);
        const Instant start = clock.now();
        link.read(1, holding, 5, 1);
        const double ms = std::chrono::duration<double, std::milli>(clock.now() - start).count();
        EXPECT_NEAR(ms, baud == 9600 ? 3.5 * 11 / 9.6 : 1.75, 1e-3);
    }
}

TEST(ModbusLink, SendsNothingOnALineThatDoesNotBecomeQuiet) {
    ScriptedLink rig(true);
    rig.record.heard.assign(7, Heard::something);
    EXPECT_EQ(unsent_write(rig.link),
              "stage /dev/ttyUSB5 unit 1: write register 3: the line does not become quiet: "
              "another master, or wrong settings?");
    EXPECT_TRUE(rig.record.requests.empty());
    EXPECT_LE(rig.clock.now().time_since_epoch(), 4 * 70ms);
}

// 300 ms are left: 150 for a line that chatters, then the stop goes out all the same, with half of
// the rest for its reply. What is read into the noise could be anybody's, so nothing is.
TEST(ModbusLink, AStopIsSentInTimeOnALineThatDoesNotBecomeQuietAndNothingIsReadThere) {
    ScriptedLink rig(true);
    rig.record.heard.assign(100, Heard::something);
    rig.link.hurry(rig.clock.now() + 300ms);
    rig.link.write(1, holding, 3, one);
    EXPECT_EQ(rig.record.requests.size(), 1U);
    const Duration sent = rig.clock.now().time_since_epoch();
    EXPECT_GE(sent, 150ms);
    EXPECT_LE(sent, 151ms);
    EXPECT_EQ(rig.record.time_limits.back(), 75ms);
    rig.link.close();
    EXPECT_THROW(rig.link.read(1, holding, 5, 1, 1), DeviceError);
    EXPECT_EQ(rig.record.requests.size(), 1U);
    EXPECT_LE(rig.clock.now().time_since_epoch(), 226ms);

    rig.link.hurry({});
    rig.record.heard.clear();
    rig.link.read(1, holding, 5, 1);
    EXPECT_EQ(rig.record.time_limits.back(), 300ms);
}

TEST(ModbusLink, TakesAFreshConnectionWhenSomethingCameUnasked) {
    for (const bool serial : {false, true}) {
        ScriptedLink rig(serial);
        rig.link.read(1, holding, 5, 1);
        rig.record.steps.clear();
        rig.record.heard = {Heard::something};
        rig.link.write(1, holding, 3, one);
        EXPECT_EQ(rig.record.steps, serial
                                        ? (Steps{"listen", "close", "connect", "listen", "request"})
                                        : (Steps{"close", "connect", "request"}));
    }
}

// 2: no such register; 5: accepted, takes long; 11: a gateway whose device did not answer.
TEST(ModbusLink, TellsARefusedWriteFromOneThatMayBeCarriedOut) {
    for (const int exception : {2, 4, 5, 11}) {
        ScriptedLink rig(false);
        rig.record.replies = {refusal(exception)};
        if (exception == 5 || exception == 11)
            EXPECT_THROW(rig.link.write(1, holding, 3, one), UncertainWrite) << exception;
        else
            EXPECT_NE(unsent_write(rig.link), "no error") << exception;
        EXPECT_EQ(rig.record.requests.size(), 1U) << "a write is never repeated";
        EXPECT_EQ(rig.record.steps, (Steps{"connect", "request"})) << "the connection is in order";
    }
}

TEST(ModbusLink, ReadsAgainOnlyWhatMayPass) {
    for (const int exception : {2, 6, 11}) {
        ScriptedLink rig(false);
        rig.record.replies = {refusal(exception)};
        if (exception == 2)
            EXPECT_THROW(rig.link.read(1, holding, 5, 1), DeviceError);
        else
            EXPECT_EQ(rig.link.read(1, holding, 5, 1).front(), 7);
        EXPECT_EQ(rig.record.requests.size(), exception == 2 ? 1U : 2U);
    }
}

TEST(ModbusLink, TellsEveryExchangeToItsTrace) {
    ScriptedLink rig(false);
    std::vector<std::string> lines;
    rig.link.set_trace(
        [&](const ModbusExchange& exchange) { lines.push_back(describe(exchange, Instant{})); });
    rig.record.replies = {silence};
    rig.link.read(3, holding, 5, 2);
    rig.link.set_trace({});
    rig.link.read(3, holding, 5, 2);
    ASSERT_EQ(lines.size(), 2U);
    EXPECT_EQ(lines[0],
              "+0.0 ms, took 0.0 ms: unit 3: read registers 5..6: no answer within 300 ms");
    EXPECT_EQ(lines[1], "+20.0 ms, took 0.0 ms: unit 3: read registers 5..6 = 0007 0007");
}

}  // namespace
}  // namespace etalon
