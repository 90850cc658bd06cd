#include "stage/link/stage_link.h"

#include "stage/link/register_numbers.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Registers = std::vector<std::uint16_t>;

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
