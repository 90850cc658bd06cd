#include "stage/link/register_numbers.h"

#include "tests/test.h"

namespace etalon {
namespace {

using Registers = std::vector<std::uint16_t>;

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
