#include "mocks/stage/modbus_framing.h"

#include "tests/test.h"

namespace etalon {
namespace {

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

}  // namespace
}  // namespace etalon
