#include "stage/link/modbus_link.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include "core/file/file_descriptor.h"
#include "mocks/stage/modbus_framing.h"
#include "mocks/stage/serial_pair.h"
#include "stage/link/register_numbers.h"
#include "stage/link/stage_link.h"
#include "tests/fakes/memory_transport.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Registers = std::vector<std::uint16_t>;

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

// ---- transport

constexpr auto answer_time = 5s;  // the answers below lie ready: for a busy machine

// What a request for register 3 of unit 5 makes of an answer with one value, 7.
ModbusReply reply_on_line(int unit) {
    const SerialPair line;
    const auto transport =
        make_modbus_transport({.address = SerialPort{.device = line.device(), .baud = 115200}});
    EXPECT_EQ(transport->connect(answer_time), "");
    const Bytes answer = to_bytes(ModbusFraming::rtu, {0, unit, {3, 2, 0, 7}});
    EXPECT_EQ(::write(line.controller_end(), answer.data(), answer.size()), std::ssize(answer));
    return transport->exchange({5, 3, 3, 1, {}}, answer_time);
}

// The same on a socket, as the first transaction.
ModbusReply reply_on_tcp(int unit, int transaction = 1, Bytes pdu = {3, 2, 0, 7}) {
    const FileDescriptor listener(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    const auto any = reinterpret_cast<sockaddr*>(&address);
    EXPECT_EQ(bind(listener.get(), any, size), 0);
    EXPECT_EQ(listen(listener.get(), 1), 0);
    EXPECT_EQ(getsockname(listener.get(), any, &size), 0);
    const auto transport =
        make_modbus_transport({.address = TcpAddress{"127.0.0.1", ntohs(address.sin_port)}});
    EXPECT_EQ(transport->connect(answer_time), "");
    const FileDescriptor controller(accept(listener.get(), nullptr, nullptr));
    const Bytes answer = to_bytes(ModbusFraming::tcp, {transaction, unit, std::move(pdu)});
    EXPECT_EQ(::write(controller.get(), answer.data(), answer.size()), std::ssize(answer));
    return transport->exchange({5, 3, 3, 1, {}}, answer_time);
}

TEST(ModbusTransport, TakesNoAnswerOfAnotherUnit) {
    for (const auto reply : {+[](int unit) { return reply_on_tcp(unit); }, &reply_on_line}) {
        EXPECT_EQ(reply(5).outcome, ModbusReply::Outcome::answered);
        EXPECT_EQ(reply(5).values, Registers{7});
        for (const int unit : {6, 0}) {
            EXPECT_EQ(reply(unit).outcome, ModbusReply::Outcome::unknown) << unit;
            EXPECT_EQ(reply(unit).cause, "an answer of another unit");
        }
    }
}

TEST(ModbusTransport, TakesNoAnswerThatDoesNotFit) {
    EXPECT_EQ(reply_on_tcp(5, 2).cause, "an answer to another request");
    for (const Bytes& pdu : {Bytes{3, 4, 0, 7, 0, 9}, Bytes{4, 2, 0, 7}, Bytes{1, 1, 1}})
        EXPECT_EQ(reply_on_tcp(5, 1, pdu).cause, "an answer that does not fit the request");
    const ModbusReply refused = reply_on_tcp(5, 1, {0x83, 2});
    EXPECT_EQ(refused.outcome, ModbusReply::Outcome::refused);
    EXPECT_EQ(refused.exception, 2);
    EXPECT_EQ(reply_on_tcp(5, 1, {0x83, 99}).outcome, ModbusReply::Outcome::unknown);
}

// A label of a name has 63 characters at most (RFC 1035, 2.3.4): no server is asked.
TEST(ModbusTransport, SaysThatAHostIsNotKnown) {
    const std::string name(64, 'a');
    EXPECT_THAT(make_modbus_transport({.address = TcpAddress{name, 502}})->connect(answer_time),
                StartsWith("cannot connect: no host '" + name + "' is known: "));
}

// ---- memory transport

// The link's guards against what a wire can do, on virtual time: thousands of faults in a moment.

// Registers 100 to 131 of the generic profile keep what is written to them.
constexpr int first_register = 100, register_count = 32;

std::uint16_t content_of(int address) {
    return static_cast<std::uint16_t>(address * 7 + 5);
}

struct LinkRig {
    explicit LinkRig(bool serial)
        : link(memory_link(serial), clock,
               std::make_unique<MemoryTransport>(controller, clock, serial)) {
        std::vector<std::uint16_t> values;
        for (int i = 0; i < register_count; ++i)
            values.push_back(content_of(first_register + i));
        link.write(1, RegisterSpace::holding_registers, first_register, values);
    }

    VirtualClock clock;
    StageProfile profile = builtin_stage_profile("generic");
    SimulatedStage stage{{{.name = "x", .low = -7.0, .high = 700.0, .speed = 50.0}}, {}, clock};
    ModbusController controller{stage, profile, 1};
    ModbusLink link;
};

// What the guards are for: without them the next request takes the old reply for its own.
TEST(MemoryTransport, GivesALateSerialReplyToTheNextRequest) {
    LinkRig rig(true);
    MemoryTransport bare(rig.controller, rig.clock, true);
    ASSERT_EQ(bare.connect(100ms), "");
    rig.controller.set_script([&](const ModbusRequest& request) {
        return ModbusReaction{.delay = request.address == 103 ? 150ms : 0ms};
    });
    EXPECT_EQ(bare.exchange({1, 3, 103, 2, {}}, 100ms).outcome, ModbusReply::Outcome::unknown);
    rig.clock.advance(45ms);
    bare.close();
    ASSERT_EQ(bare.connect(100ms), "");
    rig.controller.set_script([](const ModbusRequest&) { return ModbusReaction{.delay = 20ms}; });
    const ModbusReply reply = bare.exchange({1, 3, 107, 2, {}}, 100ms);
    EXPECT_EQ(reply.outcome, ModbusReply::Outcome::answered);
    EXPECT_EQ(reply.values.front(), content_of(103)) << "of another register";
}

// Every fault at random, one request in five, on a socket and on a serial line. A wrong value or a
// write that is carried out twice would show.
TEST(MemoryTransport, NoFaultMakesAWrongValue) {
    for (const bool serial : {false, true}) {
        LinkRig rig(serial);
        RandomStream random(7, 5, serial ? 1 : 0);
        const auto draw = [&](int count) { return static_cast<int>(random.uniform() * count); };
        int faults = 0;
        rig.controller.set_script([&](const ModbusRequest&) {
            if (draw(5) != 0)
                return ModbusReaction{};
            ++faults;
            ModbusFault fault{.kind = static_cast<ModbusFault::Kind>(draw(8)),
                              .delay = std::chrono::milliseconds(draw(240)),
                              .code = 6,
                              .carried_out = draw(2) == 0};
            if (fault.kind == ModbusFault::Kind::slow_bytes)
                fault.delay /= 10;
            return reaction_to(fault);
        });
        int failed = 0, wrong = 0;
        for (int i = 0; i < 10'000; ++i) {
            const int address = first_register + draw(register_count - 1);
            try {
                const auto values = rig.link.read(1, RegisterSpace::holding_registers, address, 2);
                wrong += values != std::vector{content_of(address), content_of(address + 1)};
            } catch (const DeviceError&) {
                ++failed;
            }
        }
        EXPECT_EQ(wrong, 0);
        EXPECT_GT(faults, 2000);
        EXPECT_LT(failed, 300) << "three attempts each: 1 in 125, more where faults last";
        EXPECT_EQ(rig.controller.writes().size(), 1U);
    }
}

TEST(MemoryTransport, TheWatchdogRunsWhileTheStationWaits) {
    LinkRig rig(false);
    const std::vector<std::uint16_t> watchdog = {70};
    for (const std::uint16_t command : {1, 3, 1}) {  // enable, home
        rig.link.write(1, RegisterSpace::holding_registers, 200, std::span(&command, 1));
        rig.clock.advance(30s);
    }
    rig.link.write(1, RegisterSpace::holding_registers, 201, watchdog);
    rig.stage.start({690.0}, {50.0});
    rig.controller.set_script([](const ModbusRequest&) { return ModbusReaction{.reply = false}; });
    EXPECT_THROW(rig.link.read(1, RegisterSpace::holding_registers, 100, 1, 1), DeviceError);
    EXPECT_EQ(rig.stage.status()[0].alarm, StageAlarm::watchdog);
    // 70 ms after the write, looked at every 10 ms; 50 mm/s.
    EXPECT_LT(rig.stage.true_positions()[0], 50.0 * 0.1);
}

// ---- stage link

StrictFile file_with(const std::string& link) {
    return StrictFile::from_text("etalon: station/1\nlink: " + link + "\n", "s.yaml", "station/1");
}

StageLink read(const std::string& text, const LinkDefaults& defaults = {}) {
    const StrictFile file = file_with(text);
    const StageLink link = read_stage_link(file.root().at("link"), defaults);
    file.finish();
    require_usable(link);
    return link;
}

std::string fault(const std::string& text) {
    return config_error_of([&] { read(text); });
}

TEST(StageLink, ReadsATcpAddress) {
    const StageLink link = read("{host: 10.0.7.5, port: 1502, unit: 3, response_timeout_ms: 700}");
    EXPECT_EQ(describe(link), "10.0.7.5:1502");
    EXPECT_FALSE(link.is_serial());
    EXPECT_EQ(link.unit, 3);
    EXPECT_EQ(link.response_timeout, 700ms);
}

TEST(StageLink, ReadsASerialLine) {
    const StageLink link = read(
        "{device: /dev/ttyUSB5, baud: 115200, parity: even, data_bits: 7, stop_bits: 2, unit: 9, "
        "response_timeout_ms: 150, quiet_ms: 190}");
    const SerialPort& port = std::get<SerialPort>(link.address);
    EXPECT_EQ(describe(link), "/dev/ttyUSB5");
    EXPECT_EQ(port.baud, 115200);
    EXPECT_EQ(port.parity, 'E');
    EXPECT_EQ(port.data_bits, 7);
    EXPECT_EQ(port.stop_bits, 2);
    EXPECT_EQ(link.unit, 9);
    EXPECT_EQ(link.quiet, 190ms);
}

TEST(StageLink, TakesFromTheProfileWhatTheStationLeavesOut) {
    const StrictFile file = file_with("{transport: rtu, baud: 9600, parity: odd, quiet_ms: 330}");
    const LinkDefaults defaults = read_link_defaults(file.root().at("link"));
    EXPECT_EQ(defaults.transport, LinkDefaults::Transport::rtu);
    const StageLink link = read("{device: /dev/ttyS3, baud: 19200}", defaults);
    const SerialPort& port = std::get<SerialPort>(link.address);
    EXPECT_EQ(port.baud, 19200);
    EXPECT_EQ(port.parity, 'O');
    EXPECT_EQ(port.data_bits, 8);
    EXPECT_EQ(link.quiet, 330ms);
    EXPECT_EQ(link.response_timeout, 300ms);
}

std::string fault_of_defaults(const std::string& text) {
    return config_error_of([&] { read_link_defaults(file_with(text).root().at("link")); });
}

// A reply may take as long as the response time-out: a line that was quiet for less can bring one.
TEST(StageLink, RefusesALineThatIsTakenForQuietBeforeAReplyIsLate) {
    EXPECT_EQ(fault("{device: /dev/ttyS3, response_timeout_ms: 190, quiet_ms: 189}"),
              "s.yaml:2: link.quiet_ms: quiet_ms (189) may not be shorter than response_timeout_ms "
              "(190): a late reply would be taken for the next one's");
    EXPECT_EQ(fault("{device: /dev/ttyS3, response_timeout_ms: 190, quiet_ms: 190}"), "no error");
    EXPECT_THAT(fault("{device: /dev/ttyS3, response_timeout_ms: 301}"),
                HasSubstr("s.yaml:2: link.response_timeout_ms: quiet_ms (300) may not"));
    EXPECT_EQ(fault("{host: a, port: 7, response_timeout_ms: 700}"), "no error") << "no draining";
    EXPECT_THAT(fault_of_defaults("{transport: rtu, response_timeout_ms: 170, quiet_ms: 110}"),
                HasSubstr("s.yaml:2: link.quiet_ms: quiet_ms (110) may not"));
    EXPECT_THAT(fault_of_defaults("{transport: rtu, response_timeout_ms: 700}"),
                HasSubstr("link.response_timeout_ms: quiet_ms (300) may not"));
    EXPECT_EQ(fault_of_defaults("{transport: tcp, response_timeout_ms: 700}"), "no error");
}

TEST(StageLink, RefusesWhatNoLinkCanBe) {
    EXPECT_THAT(fault("{host: a, port: 0}"), HasSubstr("s.yaml:2: link.port: must be"));
    EXPECT_THAT(fault("{host: a}"), HasSubstr("link.port"));
    EXPECT_THAT(fault("{host: a, port: 7, device: /dev/ttyS3}"), HasSubstr("link.host"));
    EXPECT_THAT(fault("{host: a, port: 7, baud: 9600}"), HasSubstr("link.baud"));
    EXPECT_THAT(fault("{device: /dev/ttyS3, baud: 9601}"), HasSubstr("9601 is not a baud rate"));
    EXPECT_THAT(fault("{device: /dev/ttyS3, parity: N}"), HasSubstr("link.parity"));
    EXPECT_THAT(fault("{device: \"\"}"), HasSubstr("must not be empty"));
    EXPECT_THAT(fault("{device: /dev/ttyS3, unit: 0}"), HasSubstr("link.unit"));
    EXPECT_THAT(fault("{host: a, port: 7, unit: 250}"), HasSubstr("unit: must be"));
    EXPECT_THAT(fault("{host: a, port: 7, response_timeout_ms: 9}"),
                HasSubstr("response_timeout_ms"));
}

// ---- register numbers

Registers registers(double number, NumberType type, WordOrder order = WordOrder::high_first) {
    Registers written;
    append_number(written, number, type, order);
    return written;
}

TEST(RegisterNumbers, PutTheWordsInTheOrderAsked) {
    constexpr double number = 7 * 65536 + 5;
    EXPECT_EQ(registers(number, NumberType::int32), (Registers{7, 5}));
    EXPECT_EQ(registers(number, NumberType::int32, WordOrder::low_first), (Registers{5, 7}));
    EXPECT_EQ(number_from_registers(Registers{7, 5}, NumberType::int32, WordOrder::high_first),
              number);
    EXPECT_EQ(number_from_registers(Registers{5, 7}, NumberType::int32, WordOrder::low_first),
              number);
    // IEEE 754: -6.25 = -1.5625 * 2^2.
    EXPECT_EQ(registers(-6.25, NumberType::float32), (Registers{0xC0C8, 0}));
    EXPECT_EQ(registers(-6.25, NumberType::float32, WordOrder::low_first), (Registers{0, 0xC0C8}));
    EXPECT_EQ(registers(-7, NumberType::int16), Registers{0xFFF9});
    EXPECT_EQ(number_from_registers(Registers{0xFFF9}, NumberType::uint16, WordOrder::high_first),
              65529);
}

TEST(RegisterNumbers, RoundTripWhereSignedMacrosFail) {
    constexpr std::int32_t least = std::numeric_limits<std::int32_t>::min();
    constexpr std::int32_t most = std::numeric_limits<std::int32_t>::max();
    for (const std::int32_t value :
         {0, 1, -1, 32767, 32768, -32768, -32769, 65535, 65536, -65536, 40000, -40000, least, most})
        for (const WordOrder order : {WordOrder::high_first, WordOrder::low_first})
            EXPECT_EQ(number_from_registers(registers(value, NumberType::int32, order),
                                            NumberType::int32, order),
                      value);
}

TEST(RegisterNumbers, RefuseWhatTheTypeCannotHold) {
    EXPECT_THROW(registers(32768, NumberType::int16), std::out_of_range);
    EXPECT_THROW(registers(-1, NumberType::uint16), std::out_of_range);
    EXPECT_THROW(registers(2147483648.0, NumberType::int32), std::out_of_range);
    EXPECT_THROW(registers(std::nan(""), NumberType::int32), std::out_of_range);
    EXPECT_THROW(registers(1e39, NumberType::float32), std::out_of_range);
}

}  // namespace
}  // namespace etalon
