// The twin's Modbus server as a peer on the wire: hostile bytes, taken ports, several clients.
#include "tests/loopback/stage_rig.h"
#include "tests/loopback/tcp_connection.h"

namespace etalon {
namespace {

using Bytes = std::vector<std::uint8_t>;

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
