#include "stage/link/register_numbers.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

namespace etalon {
namespace {

template <class T>
constexpr NumberRange whole_range{static_cast<double>(std::numeric_limits<T>::lowest()),
                                  static_cast<double>(std::numeric_limits<T>::max())};

std::uint32_t bits_of(double number, NumberType type) {
    if (type == NumberType::float32)
        return std::bit_cast<std::uint32_t>(static_cast<float>(number));
    return static_cast<std::uint32_t>(std::llround(number));  // modulo 2^32: two's complement
}

}  // namespace

NumberType read_number_type(const Value& value) {
    constexpr const char* words[] = {"int16", "uint16", "int32", "float32"};
    const std::string word = value.one_of({"int16", "uint16", "int32", "float32"});
    return static_cast<NumberType>(std::ranges::find(words, word) - words);
}

WordOrder read_word_order(const Value& value) {
    return value.one_of({"high_first", "low_first"}) == "low_first" ? WordOrder::low_first
                                                                    : WordOrder::high_first;
}

NumberRange range_of(NumberType type) {
    constexpr NumberRange ranges[] = {whole_range<std::int16_t>, whole_range<std::uint16_t>,
                                      whole_range<std::int32_t>, whole_range<float>};
    return ranges[static_cast<std::size_t>(type)];
}

double number_from_registers(std::span<const std::uint16_t> registers, NumberType type,
                             WordOrder order) {
    const std::uint16_t first = registers[0];
    if (type == NumberType::uint16)
        return first;
    if (type == NumberType::int16)
        return static_cast<std::int16_t>(first);
    const std::uint16_t second = registers[1];
    const bool high_first = order == WordOrder::high_first;
    const std::uint32_t high = high_first ? first : second, low = high_first ? second : first;
    const std::uint32_t bits = high << 16 | low;
    if (type == NumberType::float32)
        return std::bit_cast<float>(bits);
    return static_cast<std::int32_t>(bits);
}

void append_number(std::vector<std::uint16_t>& registers, double number, NumberType type,
                   WordOrder order) {
    const NumberRange range = range_of(type);
    const double held = type == NumberType::float32 ? number : std::round(number);
    if (!(held >= range.low && held <= range.high))
        throw std::out_of_range(
            fmt::format("{} is not {} to {} as its register holds", number, range.low, range.high));
    const std::uint32_t bits = bits_of(held, type);
    const auto high = static_cast<std::uint16_t>(bits >> 16);
    const auto low = static_cast<std::uint16_t>(bits & 0xFFFFU);
    if (registers_of(type) == 1)
        registers.push_back(low);
    else if (order == WordOrder::high_first)
        registers.insert(registers.end(), {high, low});
    else
        registers.insert(registers.end(), {low, high});
}

}  // namespace etalon
