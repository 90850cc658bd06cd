#include "mocks/stage/modbus_framing.h"

#include "mocks/stage/modbus_fault.h"
#include "mocks/stage/serial_pair.h"
#include "tests/test.h"

namespace etalon {
namespace {

using LinkFault = ModbusFault::Kind;
using When = FaultTrigger::When;

// "MODBUS over Serial Line V1.02", 6.2.2 and any other implementation: the frame 02 07 ends in
// 41 12 on the wire.
TEST(ModbusFraming, HasTheCheckSumOfTheStandardsExample) {
    const Bytes bytes = {0x02, 0x07};
    EXPECT_EQ(modbus_crc(bytes), 0x1241);
}

// The examples of the Application Protocol V1.1b3: 6.1 (read coils 20 to 38), 6.5, 6.11.
TEST(ModbusFraming, DecodesTheStandardsExamples) {
    ModbusRequest request;
    EXPECT_EQ(decode_request({0x01, 0x00, 0x13, 0x00, 0x13}, request), no_exception);
    EXPECT_EQ(request.address, 19);
    EXPECT_EQ(request.count, 19);
    EXPECT_TRUE(request.values.empty());
    const std::vector<std::uint16_t> coils = {1, 0, 1, 1, 0, 0, 1, 1, 1, 1,
                                              0, 1, 0, 1, 1, 0, 1, 0, 1};
    EXPECT_EQ(encode_reply(request, coils), (Bytes{0x01, 0x03, 0xCD, 0x6B, 0x05}));

    request = {};
    EXPECT_EQ(decode_request({0x05, 0x00, 0xAC, 0xFF, 0x00}, request), no_exception);
    EXPECT_EQ(request.address, 0xAC);
    EXPECT_EQ(request.values, std::vector<std::uint16_t>{1});
    EXPECT_EQ(encode_reply(request, {}), (Bytes{0x05, 0x00, 0xAC, 0xFF, 0x00}));

    request = {};
    EXPECT_EQ(decode_request({0x0F, 0x00, 0x13, 0x00, 0x0A, 0x02, 0xCD, 0x01}, request),
              no_exception);
    EXPECT_EQ(request.values, (std::vector<std::uint16_t>{1, 0, 1, 1, 0, 0, 1, 1, 1, 0}));
    EXPECT_EQ(encode_reply(request, {}), (Bytes{0x0F, 0x00, 0x13, 0x00, 0x0A}));
}

TEST(ModbusFraming, RefusesWhatIsNoRequest) {
    ModbusRequest request;
    EXPECT_EQ(decode_request({0x07}, request), illegal_function);
    EXPECT_EQ(decode_request({0x03, 0, 5, 0}, request), illegal_value);
    EXPECT_EQ(decode_request({0x03, 0, 5, 0, 126}, request), illegal_value);
    EXPECT_EQ(decode_request({0x01, 0, 5, 0x07, 0xD0}, request), no_exception);   // 2000
    EXPECT_EQ(decode_request({0x02, 0, 5, 0x07, 0xD1}, request), illegal_value);  // 2001
    EXPECT_EQ(decode_request({0x05, 0, 5, 0, 1}, request), illegal_value);
    EXPECT_EQ(decode_request({0x0F, 0, 5, 0, 9, 1, 0xFF}, request), illegal_value);
}

TEST(ModbusFraming, TakesSerialRequestsWholeAndOnlyWithTheirCheckSum) {
    // Unit 3: read registers 1 and 2, as libmodbus sends it.
    const Bytes whole = {0x03, 0x03, 0x00, 0x01, 0x00, 0x02, 0x94, 0x29};
    Bytes received(whole.begin(), whole.begin() + 7);
    bool out_of_step = false;
    EXPECT_FALSE(take_request(ModbusFraming::rtu, received, out_of_step));
    EXPECT_FALSE(out_of_step);
    received.push_back(whole.back());
    received.push_back(0x05);  // the next one begins
    const auto frame = take_request(ModbusFraming::rtu, received, out_of_step);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->unit, 3);
    EXPECT_EQ(frame->pdu, (Bytes{0x03, 0x00, 0x01, 0x00, 0x02}));
    EXPECT_EQ(received, Bytes{0x05});
    EXPECT_EQ(to_bytes(ModbusFraming::rtu, *frame), whole);

    for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
        received = whole;
        received[bit / 8] = static_cast<std::uint8_t>(received[bit / 8] ^ 1U << bit % 8);
        EXPECT_FALSE(take_request(ModbusFraming::rtu, received, out_of_step)) << bit;
    }
}

TEST(ModbusFraming, TakesTcpRequestsByTheirLength) {
    Bytes received = {7, 5, 0, 0, 0, 6, 9, 3, 0, 1, 0, 2, 7};
    bool out_of_step = false;
    const auto frame = take_request(ModbusFraming::tcp, received, out_of_step);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->transaction, 0x0705);
    EXPECT_EQ(frame->unit, 9);
    EXPECT_EQ(frame->pdu, (Bytes{3, 0, 1, 0, 2}));
    EXPECT_EQ(received, Bytes{7});
    received = {'G', 'E', 'T', ' ', '/', ' ', 'H'};
    EXPECT_FALSE(take_request(ModbusFraming::tcp, received, out_of_step));
    EXPECT_TRUE(out_of_step);
}

// ---- modbus fault

struct FaultyLinkRig {
    VirtualClock clock;
    SimulatedStage stage{{{.name = "x", .low = -7.0, .high = 700.0, .speed = 50.0}}, {}, clock};
    const ModbusRequest reading{1, 3, 0, 5, {}};
    const ModbusRequest writing{1, 16, 100, 3, {1, 2, 3}};
};

TEST(ScriptedFaults, HappenWithTheCountedRequestAndAsManyInARow) {
    FaultyLinkRig rig;
    const auto script = scripted_faults(
        {{.kind = LinkFault::silence, .at = {When::request, 3}, .requests = 2}}, rig.stage);
    std::vector<bool> replies;
    for (int i = 0; i < 6; ++i)
        replies.push_back(script(rig.reading).reply);
    EXPECT_EQ(replies, (std::vector<bool>{true, true, false, false, true, true}));
}

TEST(ScriptedFaults, HappenWithTheFirstWriteToARegister) {
    FaultyLinkRig rig;
    const auto script = scripted_faults(
        {{.kind = LinkFault::exception, .at = {When::write_to, 102}, .code = 4}}, rig.stage);
    EXPECT_EQ(script({1, 3, 102, 1, {}}).exception, 0) << "only reads";
    EXPECT_EQ(script({1, 6, 103, 1, {7}}).exception, 0) << "beside it";
    EXPECT_EQ(script(rig.writing).exception, 4);
    EXPECT_EQ(script(rig.writing).exception, 0);
}

TEST(ScriptedFaults, HappenAfterATimeAndAfterAMove) {
    FaultyLinkRig rig;
    const auto script =
        scripted_faults({{.kind = LinkFault::slow_bytes, .at = {When::time_ms, 250}, .delay = 5ms},
                         {.kind = LinkFault::reset, .at = {When::move, 1}, .carried_out = false}},
                        rig.stage);
    EXPECT_EQ(script(rig.reading).between_bytes, 0ms);
    rig.clock.advance(251ms);
    EXPECT_EQ(script(rig.reading).between_bytes, 5ms);
    EXPECT_FALSE(script(rig.reading).close);
    rig.stage.enable(true);
    rig.stage.home();
    rig.clock.advance(30s);
    rig.stage.start({7.0}, {50.0});
    const ModbusReaction reaction = script(rig.reading);
    EXPECT_TRUE(reaction.close);
    EXPECT_FALSE(reaction.carry_out);
    EXPECT_FALSE(script(rig.reading).close);
}

// ---- serial link

namespace fs = std::filesystem;

TEST(SerialLink, IsThereAsLongAsTheLine) {
    const TemporaryFolder folder;
    const fs::path path = folder / "stage";
    {
        const SerialLink link(path);
        EXPECT_EQ(fs::read_symlink(path), link.pair().device());
    }
    EXPECT_FALSE(fs::exists(fs::symlink_status(path)));
}

TEST(SerialLink, ReplacesOneThatIsLeftAndLeavesALaterOneAlone) {
    const TemporaryFolder folder;
    const fs::path path = folder / "stage";
    fs::create_symlink("/dev/pts/gone", path);
    {
        const SerialLink link(path);
        EXPECT_EQ(fs::read_symlink(path), link.pair().device());
        fs::remove(path);
        fs::create_symlink("/dev/pts/other", path);
    }
    EXPECT_EQ(fs::read_symlink(path), "/dev/pts/other");
}

TEST(SerialLink, ReplacesNothingElse) {
    const TemporaryFolder folder;
    const fs::path path = folder / "stage";
    write_text(path, "notes");
    EXPECT_THROW(SerialLink{path}, DeviceError);
    EXPECT_EQ(read_text(path), "notes");
    EXPECT_THROW(SerialLink{folder / "missing/stage"}, DeviceError);
}

}  // namespace
}  // namespace etalon
