#include "stage/modbus_link.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <modbus.h>

#include <cerrno>
#include <utility>

namespace etalon {
namespace {

constexpr std::size_t trace_length = 200;

std::string describe_range(const char* verb, int address, int count) {
    return count == 1 ? fmt::format("{} register {}", verb, address)
                      : fmt::format("{} registers {}..{}", verb, address, address + count - 1);
}

// The device answered, but with a refusal; the connection is in order.
bool is_modbus_exception(int error) {
    return error >= EMBXILFUN && error <= EMBXGTAR;
}

void require_range(const std::string& device, const std::string& request, int address, int count,
                   int most) {
    if (address < 0 || count < 1 || count > most || address + count > 65536)
        throw DeviceError(device, request,
                          fmt::format("a request may hold 1 to {} registers up to 65535", most));
}

bool set_timeout(modbus_t* context, std::chrono::milliseconds timeout) {
    return modbus_set_response_timeout(context, static_cast<std::uint32_t>(timeout.count() / 1000),
                                       static_cast<std::uint32_t>(timeout.count() % 1000 * 1000)) ==
           0;
}

}  // namespace

struct ModbusLink::Connection {
    explicit Connection(modbus_t* made) : context(made) {}
    ~Connection() {
        if (!context)
            return;
        modbus_close(context);
        modbus_free(context);
    }
    Connection(const Connection&) = delete;
    Connection& operator=(const Connection&) = delete;

    modbus_t* context;
};

ModbusLink::ModbusLink(const StageLink& link, Clock& clock)
    : link_(link),
      clock_(clock),
      device_(fmt::format("stage {}:{} unit {}", link.host, link.port, link.unit)) {}

ModbusLink::~ModbusLink() = default;

void ModbusLink::close() {
    connection_.reset();
    failures_ = 0;
}

void ModbusLink::set_response_timeout(std::chrono::milliseconds timeout) {
    link_.response_timeout = timeout;
    if (connection_ && !set_timeout(connection_->context, timeout))
        connection_.reset();
}

void ModbusLink::record(const ModbusExchange& exchange) {
    const std::scoped_lock lock(trace_mutex_);
    trace_.push_back(exchange);
    if (trace_.size() > trace_length)
        trace_.pop_front();
}

std::vector<ModbusExchange> ModbusLink::last_exchanges() const {
    const std::scoped_lock lock(trace_mutex_);
    return {trace_.begin(), trace_.end()};
}

// 0, 20, 40, 80, 160, 160 ... ms: a device that restarts is not hammered.
void ModbusLink::pause_after_failures() {
    if (failures_ == 0)
        return;
    const std::chrono::milliseconds pause(10 << std::min(failures_, 4));
    clock_.wait_for(pause, {});
}

// Returns why not, or nothing.
std::string ModbusLink::connect() {
    const std::string port = std::to_string(link_.port);
    auto fresh = std::make_unique<Connection>(modbus_new_tcp_pi(link_.host.c_str(), port.c_str()));
    modbus_t* context = fresh->context;
    // No error recovery flags: libmodbus' own reconnecting hangs for ever when the server is gone.
    // Byte time-out 0: the response time-out then bounds the whole reply, however it trickles in.
    const bool connected = context && modbus_set_slave(context, link_.unit) == 0 &&
                           set_timeout(context, link_.response_timeout) &&
                           modbus_set_byte_timeout(context, 0, 0) == 0 &&
                           modbus_connect(context) == 0;
    if (!connected)
        return fmt::format("cannot connect: {}", modbus_strerror(errno));
    connection_ = std::move(fresh);
    return {};
}

// `call` carries out the request on the open connection: the number of registers, or -1 and errno.
// Whatever may still arrive after a failure belongs to that request, so the connection is given up.
template <class Call>
ModbusLink::Outcome ModbusLink::transact(ModbusExchange& exchange, int expected, Call call) {
    if (!connection_)
        pause_after_failures();
    exchange.start = clock_.now();
    Outcome outcome = Outcome::not_sent;
    if (!connection_)
        exchange.failure = connect();
    if (connection_) {
        const int done = call();
        const int error = done < 0 ? errno : EMBBADDATA;
        outcome = done == expected             ? Outcome::answered
                  : is_modbus_exception(error) ? Outcome::refused
                                               : Outcome::unknown;
        exchange.failure = outcome == Outcome::answered ? "" : describe_error(error);
    }
    exchange.took = clock_.now() - exchange.start;
    const bool link_works = outcome == Outcome::answered || outcome == Outcome::refused;
    failures_ = link_works ? 0 : failures_ + 1;
    if (!link_works)
        connection_.reset();
    record(exchange);
    return outcome;
}

std::string ModbusLink::describe_error(int error) const {
    return error == ETIMEDOUT
               ? fmt::format("no answer within {} ms", link_.response_timeout.count())
               : modbus_strerror(error);
}

std::vector<std::uint16_t> ModbusLink::read(int address, int count, int attempts) {
    const std::string request = describe_range("read", address, count);
    require_range(device_, request, address, count, MODBUS_MAX_READ_REGISTERS);
    std::string cause = "no attempt was allowed";
    for (int attempt = 0; attempt < attempts; ++attempt) {
        ModbusExchange exchange{.request = request, .values = {}, .failure = {}};
        std::vector<std::uint16_t> values(static_cast<std::size_t>(count));
        const Outcome outcome = transact(exchange, count, [&] {
            const int got =
                modbus_read_registers(connection_->context, address, count, values.data());
            exchange.values = got == count ? values : std::vector<std::uint16_t>{};
            return got;
        });
        if (outcome == Outcome::answered)
            return values;
        cause = exchange.failure;
        if (outcome == Outcome::refused)
            break;
    }
    throw DeviceError(device_, request, cause);
}

void ModbusLink::write(int address, std::span<const std::uint16_t> values) {
    const int count = static_cast<int>(std::min<std::size_t>(values.size(), 65536));
    const std::string request = describe_range("write", address, count);
    require_range(device_, request, address, count, MODBUS_MAX_WRITE_REGISTERS);
    ModbusExchange exchange{
        .request = request, .values = {values.begin(), values.end()}, .failure = {}};
    const Outcome outcome = transact(exchange, count, [&] {
        return modbus_write_registers(connection_->context, address, count, values.data());
    });
    if (outcome == Outcome::unknown)
        throw UncertainWrite(device_, request, exchange.failure);
    if (outcome != Outcome::answered)
        throw DeviceError(device_, request, exchange.failure);
}

std::int32_t int32_from_registers(std::uint16_t high, std::uint16_t low) {
    return static_cast<std::int32_t>(static_cast<std::uint32_t>(high) << 16 | low);
}

RegisterPair registers_from_int32(std::int32_t value) {
    const auto bits = static_cast<std::uint32_t>(value);
    return {static_cast<std::uint16_t>(bits >> 16), static_cast<std::uint16_t>(bits & 0xFFFFU)};
}

std::string describe(const std::vector<ModbusExchange>& exchanges) {
    using Milliseconds = std::chrono::duration<double, std::milli>;
    std::string text;
    for (const ModbusExchange& exchange : exchanges) {
        const Milliseconds age = exchange.start - exchanges.back().start, took = exchange.took;
        text += fmt::format("{:+.1f} ms, took {:.1f} ms: {}", age.count(), took.count(),
                            exchange.request);
        if (!exchange.values.empty())
            text += fmt::format(" = {:04x}", fmt::join(exchange.values, " "));
        text += exchange.failure.empty() ? "\n" : fmt::format(": {}\n", exchange.failure);
    }
    return text;
}

}  // namespace etalon
