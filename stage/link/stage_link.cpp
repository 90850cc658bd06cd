#include "stage/link/stage_link.h"

#include <fmt/format.h>

#include <algorithm>

namespace etalon {
namespace {

using namespace std::chrono_literals;
using Milliseconds = std::chrono::milliseconds;

// What libmodbus can set; it takes any other number for 9600 without a word.
constexpr std::array baud_rates = {1200,   2400,   4800,   9600,   19200,  38400,  57600,
                                   115200, 230400, 460800, 500000, 921600, 1000000};

int integer_or(const Value& link, const char* key, int fallback, int low, int high) {
    const auto value = link.find(key);
    return value ? value->integer(low, high) : fallback;
}

Milliseconds milliseconds_or(const Value& link, const char* key, Milliseconds fallback) {
    return Milliseconds(integer_or(link, key, static_cast<int>(fallback.count()), 10, 10'000));
}

int read_baud(const Value& value) {
    const int baud = value.integer(1200, 1'000'000);
    if (std::ranges::find(baud_rates, baud) == baud_rates.end())
        value.fail(fmt::format("{} is not a baud rate of serial lines", baud));
    return baud;
}

char read_parity(const Value& value) {
    const std::string word = value.one_of({"none", "even", "odd"});
    return word == "none" ? 'N' : word == "even" ? 'E' : 'O';
}

SerialPort read_line(const Value& link, SerialPort port) {
    if (const auto baud = link.find("baud"))
        port.baud = read_baud(*baud);
    if (const auto parity = link.find("parity"))
        port.parity = read_parity(*parity);
    port.data_bits = integer_or(link, "data_bits", port.data_bits, 7, 8);
    port.stop_bits = integer_or(link, "stop_bits", port.stop_bits, 1, 2);
    return port;
}

// A line that is quiet for less than a reply may take can still bring an earlier one.
void require_quiet_enough(const Value& link, Milliseconds response_timeout, Milliseconds quiet) {
    if (quiet >= response_timeout)
        return;
    constexpr std::array keys = {"quiet_ms", "response_timeout_ms", "device"};
    const auto said =
        std::ranges::find_if(keys, [&](const char* key) { return link.find(key).has_value(); });
    link.at(*said).fail(fmt::format(
        "quiet_ms ({}) may not be shorter than response_timeout_ms ({}): a late reply would be "
        "taken for the next one's",
        quiet.count(), response_timeout.count()));
}

std::string non_empty(const Value& value) {
    if (value.text().empty())
        value.fail("must not be empty");
    return value.text();
}

}  // namespace

std::string describe(const StageLink& link) {
    if (const auto* port = std::get_if<SerialPort>(&link.address))
        return port->device;
    const auto& address = std::get<TcpAddress>(link.address);
    return fmt::format("{}:{}", address.host, address.port);
}

LinkDefaults read_link_defaults(const Value& link) {
    LinkDefaults defaults;
    if (const auto transport = link.find("transport"))
        defaults.transport = transport->one_of({"tcp", "rtu"}) == "rtu"
                                 ? LinkDefaults::Transport::rtu
                                 : LinkDefaults::Transport::tcp;
    defaults.serial = read_line(link, {});
    defaults.response_timeout =
        milliseconds_or(link, "response_timeout_ms", defaults.response_timeout);
    defaults.quiet = milliseconds_or(link, "quiet_ms", defaults.quiet);
    if (defaults.transport == LinkDefaults::Transport::rtu || link.find("quiet_ms"))
        require_quiet_enough(link, defaults.response_timeout, defaults.quiet);
    return defaults;
}

StageLink read_stage_link(const Value& link, const LinkDefaults& defaults) {
    StageLink read;
    read.quiet = defaults.quiet;
    if (const auto device = link.find("device")) {
        SerialPort port = read_line(link, defaults.serial);
        port.device = non_empty(*device);
        read.address = port;
        read.unit = integer_or(link, "unit", read.unit, 1, 247);
        read.quiet = milliseconds_or(link, "quiet_ms", read.quiet);
    } else {
        read.address = TcpAddress{non_empty(link.at("host")), link.at("port").integer(1, 65535)};
        read.unit = integer_or(link, "unit", read.unit, 0, 255);
    }
    read.response_timeout = milliseconds_or(link, "response_timeout_ms", defaults.response_timeout);
    if (read.is_serial())
        require_quiet_enough(link, read.response_timeout, read.quiet);
    return read;
}

void require_usable(const StageLink& link) {
    const auto require = [](bool holds, const char* key, const std::string& message) {
        if (!holds)
            throw ConfigError({"stage link", 0, key}, message);
    };
    const int unit = link.unit;
    if (const auto* port = std::get_if<SerialPort>(&link.address)) {
        require(!port->device.empty(), "device", "must not be empty");
        require(std::ranges::find(baud_rates, port->baud) != baud_rates.end(), "baud",
                fmt::format("{} is not a baud rate of serial lines", port->baud));
        require(std::string_view("NEO").find(port->parity) != std::string_view::npos, "parity",
                "must be N, E or O");
        require(port->data_bits == 7 || port->data_bits == 8, "data_bits", "must be 7 or 8");
        require(port->stop_bits == 1 || port->stop_bits == 2, "stop_bits", "must be 1 or 2");
        // To unit 0, all of them, nobody answers.
        require(unit >= 1 && unit <= 247, "unit", "must be 1 to 247");
    } else {
        const auto& address = std::get<TcpAddress>(link.address);
        require(!address.host.empty(), "host", "must not be empty");
        require(address.port >= 1 && address.port <= 65535, "port", "must be 1 to 65535");
        require((unit >= 0 && unit <= 247) || unit == 255, "unit", "must be 0 to 247, or 255");
    }
    require(link.response_timeout >= 10ms && link.response_timeout <= 10s, "response_timeout",
            "must be 10 ms to 10 s");
    require(link.quiet >= 10ms && link.quiet <= 10s, "quiet", "must be 10 ms to 10 s");
}

}  // namespace etalon
