#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "stage/profile/profile_layers.h"

namespace etalon {
namespace {

constexpr int max_address = 65535;
constexpr std::uint16_t whole = 0xFFFF;

// In the order of the spaces: as a block names them, {space: holding, ...}, and a point,
// {register: 7, ...}.
constexpr const char* block_words[] = {"coils", "discrete_inputs", "holding", "input"};
constexpr const char* point_words[] = {"coil", "discrete_input", "register", "input_register"};

const char* point_word(RegisterSpace space) {
    return point_words[static_cast<std::size_t>(space)];
}

bool flag_or(const Value& mapping, const char* key, bool otherwise) {
    const auto value = mapping.find(key);
    return value ? value->flag() : otherwise;
}

// As manuals give addresses and codes: 0x6002 or 24578.
int read_word(const Value& value, int low, int high) {
    const std::string text = value.is_scalar() ? value.text() : "";
    if (!text.starts_with("0x"))
        return value.integer(low, high);
    int number = 0;
    const char* end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data() + 2, end, number, 16);
    if (error != std::errc{} || rest != end || number < low || number > high)
        value.fail(fmt::format("must be {} to 0x{:x}, not '{}'", low, high, text));
    return number;
}

struct Place {
    RegisterSpace space;
    int address;
};

// {register: 7}, {input_register: 7}, {coil: 7} or {discrete_input: 7}
Place read_place(const Value& point) {
    std::optional<Place> found;
    for (const auto space : {RegisterSpace::holding_registers, RegisterSpace::input_registers,
                             RegisterSpace::coils, RegisterSpace::discrete_inputs}) {
        const auto value = point.find(point_word(space));
        if (!value)
            continue;
        if (found)
            value->fail(fmt::format("is at '{}' already", point_word(found->space)));
        found = {space, read_word(*value, 0, max_address)};
    }
    if (!found)
        point.fail("must have 'register', 'input_register', 'coil' or 'discrete_input'");
    return *found;
}

int read_bit(const Value& point, RegisterSpace space) {
    return is_bits(space) ? 0 : point.at("bit").integer(0, 15);
}

std::uint16_t mask_of(RegisterSpace space, int bit) {
    return is_bits(space) ? whole : static_cast<std::uint16_t>(1U << bit);
}

// Reads everything that has an address and sees to it that no bit means two things.
class RegisterReader {
public:
    RegisterReader(const Layers& root, StageProfile& profile) : root_(root), profile_(profile) {}

    void read() {
        for (const Value& block : root_.at("poll").items())
            read_block(block);
        profile_.position = read_number(root_.at("position"), "position");
        if (const auto code = root_.find("alarm_code")) {
            profile_.alarm_code = read_number(*code, "alarm_code");
            if (profile_.alarm_code->type == NumberType::float32)
                code->fail("must be a whole number");
        }
        read_signals(root_.section("signals"));
        read_inputs(root_.section("inputs"));
        read_target(root_.at("target"));
        if (const auto watchdog = root_.find("watchdog"))
            read_watchdog(*watchdog);
    }

private:
    // One register or bit of the controller; written ones are no matter of polls.
    void claim(const Value& at, Place place, std::uint16_t mask, const std::string& meaning) {
        for (const Claim& claim : claims_) {
            if (claim.place.space == place.space && claim.place.address == place.address &&
                (claim.mask & mask) != 0)
                at.fail(
                    fmt::format("{} {} is '{}' already",
                                mask == whole ? point_word(place.space) : "this bit of register",
                                place.address, claim.meaning));
        }
        claims_.push_back({place, mask, meaning});
    }

    void claim_written(const Value& at, Place place, std::uint16_t mask,
                       const std::string& meaning) {
        if (place.address > max_address)
            at.fail(fmt::format("reaches beyond register {}", max_address));
        if (block_of(place, profile_.max_axes))
            at.fail(fmt::format("{} {} lies in a block that is polled", point_word(place.space),
                                place.address));
        claim(at, place, mask, meaning);
    }

    // The block that polls this place, looking at the first `axes` axes.
    const PollBlock* block_of(Place place, int axes) const {
        for (const PollBlock& block : profile_.poll) {
            const int end = block.address + (axes - 1) * block.stride + block.count;
            if (block.space == place.space && place.address >= block.address && place.address < end)
                return &block;
        }
        return nullptr;
    }

    void require_polled(const Value& at, Place place, int count) const {
        const PollBlock* first = block_of(place, 1);
        if (!first || first != block_of({place.space, place.address + count - 1}, 1))
            at.fail("lies in no block of 'poll'");
    }

    void read_block(const Value& value) {
        PollBlock block;
        const std::string space =
            value.at("space").one_of({"holding", "input", "coils", "discrete_inputs"});
        block.space =
            static_cast<RegisterSpace>(std::ranges::find(block_words, space) - block_words);
        block.address = read_word(value.at("address"), 0, max_address);
        block.count = value.at("count").integer(1, most_read(block.space));
        const auto stride = value.find("stride");
        if (!stride && profile_.max_axes > 1)
            value.at("stride");  // throws: it is missing
        block.stride = stride ? stride->integer(0, most_read(block.space)) : block.count;
        if (block.stride != 0 && block.stride < block.count)
            stride->fail(fmt::format("the axes' {} registers overlap", block.count));
        const int reach = (profile_.max_axes - 1) * block.stride + block.count;
        if (reach > most_read(block.space))
            value.fail(fmt::format("{} registers do not fit into one request of {}", reach,
                                   most_read(block.space)));
        if (block.address + reach - 1 > max_address)
            value.fail(fmt::format("reaches beyond register {}", max_address));
        for (int i = 0; i < reach; ++i)
            if (block_of({block.space, block.address + i}, profile_.max_axes))
                value.fail("overlaps with another block");
        profile_.poll.push_back(block);
    }

    PolledNumber read_number(const Value& value, const std::string& meaning) {
        const Place place = read_place(value);
        if (is_bits(place.space))
            value.fail("a number needs registers");
        const PolledNumber number{place.space, place.address, read_number_type(value.at("type"))};
        require_polled(value, place, registers_of(number.type));
        for (int i = 0; i < registers_of(number.type); ++i)
            claim(value, {place.space, place.address + i}, whole, meaning);
        return number;
    }

    void read_signals(const Layers& signals) {
        for (std::size_t i = 0; i < std::size(signal_words); ++i) {
            const auto signal = static_cast<Signal>(i);
            const char* word = signal_words[i];
            const Value value = signals.at(word);
            if (value.is_scalar()) {
                value.one_of({"unavailable"});
                if (signal == Signal::moving || signal == Signal::alarm)
                    value.fail("must be available: without it no motion is safe");
                continue;
            }
            const std::vector<Value> bits = value.is_list() ? value.items() : std::vector{value};
            if (bits.empty())
                value.fail("must have at least one bit, or be 'unavailable'");
            for (const Value& bit : bits)
                profile_.signals[signal].push_back(read_signal_bit(bit, word));
        }
    }

    SignalBit read_signal_bit(const Value& value, const std::string& meaning) {
        const Place place = read_place(value);
        const SignalBit bit{place.space, place.address, read_bit(value, place.space),
                            flag_or(value, "inverted", false)};
        require_polled(value, place, 1);
        claim(value, place, mask_of(place.space, bit.bit), meaning);
        return bit;
    }

    void read_inputs(const Layers& inputs) {
        for (std::size_t i = 0; i < std::size(input_words); ++i) {
            const Value value = inputs.at(input_words[i]);
            if (!value.is_scalar())
                profile_.inputs[static_cast<Input>(i)] = read_input(value, input_words[i]);
            else
                value.one_of({"none"});
        }
    }

    InputPoint read_input(const Value& value, const std::string& meaning) {
        const Place place = read_place(value);
        if (!is_writable(place.space))
            value.fail("cannot be written: an input needs 'register' or 'coil'");
        InputPoint point{.space = place.space, .address = place.address};
        const std::string act = value.at("act").one_of({"level", "edge", "code"});
        if (act == "code") {
            read_code(value, point, meaning);
            return point;
        }
        point.act = act == "level" ? InputPoint::Act::level : InputPoint::Act::edge;
        point.bit = read_bit(value, place.space);
        point.inverted = flag_or(value, "inverted", false);
        point.read_back = flag_or(value, "read_back", true);
        claim_written(value, place, mask_of(place.space, point.bit), meaning);
        return point;
    }

    // Codes may share a register with other codes.
    void read_code(const Value& value, InputPoint& point, const std::string& meaning) {
        if (is_bits(point.space))
            value.fail("a code needs a register");
        point.act = InputPoint::Act::code;
        point.code = static_cast<std::uint16_t>(read_word(value.at("code"), 1, 65535));
        point.read_back = false;
        if (!codes_.emplace(point.address, point.code).second)
            value.at("code").fail(fmt::format("code {} is used twice", point.code));
        if (code_registers_.insert(point.address).second)
            claim_written(value, {point.space, point.address}, whole, meaning);
    }

    void read_target(const Value& value) {
        const std::vector<Value> blocks = value.is_list() ? value.items() : std::vector{value};
        int targets = 0, speeds = 0;
        for (const Value& block : blocks) {
            profile_.target.push_back(read_target_block(block));
            for (const TargetBlock::Field& field : profile_.target.back().fields) {
                targets += field.is == TargetBlock::Field::Is::target;
                speeds += field.is == TargetBlock::Field::Is::speed;
            }
            if (profile_.target.back().starts && profile_.target.size() != blocks.size())
                block.at("starts").fail("only the last block may start the motion");
        }
        if (targets != 1 || speeds != 1)
            value.fail(
                fmt::format("must have one target and one speed, not {} and {}", targets, speeds));
    }

    TargetBlock read_target_block(const Value& value) {
        TargetBlock block;
        block.address = read_word(value.at("register"), 0, max_address);
        block.starts = value.at("starts").flag();
        block.read_back = value.at("read_back").flag();
        for (const Value& field : value.at("fields").items())
            block.fields.push_back(read_field(field));
        if (block.fields.empty())
            value.at("fields").fail("must have at least one field");
        const int count = profile_.max_axes * block.size();
        const int most = most_written(RegisterSpace::holding_registers);
        if (count > most)
            value.fail(fmt::format("{} registers do not fit into one request of {}", count, most));
        for (int i = 0; i < count; ++i)
            claim_written(value, {RegisterSpace::holding_registers, block.address + i}, whole,
                          "target");
        return block;
    }

    // {target: int32}, {speed: int32} or {constant: 7, type: int32}
    static TargetBlock::Field read_field(const Value& value) {
        using Is = TargetBlock::Field::Is;
        if (const auto type = value.find("target"))
            return {Is::target, read_number_type(*type)};
        if (const auto type = value.find("speed"))
            return {Is::speed, read_number_type(*type)};
        const NumberType type = read_number_type(value.at("type"));
        const NumberRange range = range_of(type);
        const Value constant = value.at("constant");
        const double number = constant.number({range.low, range.high});
        if (type != NumberType::float32 && number != std::floor(number))
            constant.fail("must be a whole number");
        return {Is::constant, type, number};
    }

    void read_watchdog(const Value& value) {
        const int address = read_word(value.at("register"), 0, max_address);
        claim_written(value, {RegisterSpace::holding_registers, address}, whole, "watchdog");
        // Less than a second could expire while one request is repeated.
        profile_.watchdog = {
            address, std::chrono::milliseconds(value.at("timeout_ms").integer(1000, 65535))};
    }

    struct Claim {
        Place place;
        std::uint16_t mask;
        std::string meaning;
    };

    const Layers& root_;
    StageProfile& profile_;
    std::vector<Claim> claims_;
    std::set<std::pair<int, std::uint16_t>> codes_;
    std::set<int> code_registers_;
};

}  // namespace

void read_profile_registers(const Layers& root, StageProfile& profile) {
    RegisterReader(root, profile).read();
}

}  // namespace etalon
