#include "stage/link/modbus_link.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace etalon {
namespace {

using Outcome = ModbusReply::Outcome;

constexpr std::size_t trace_length = 200;

// Of a reply in a hurry: a controller that is there takes no longer.
constexpr std::chrono::milliseconds min_reply_time{5};

// Exceptions after which nobody knows whether a write is carried out: "accepted, takes long" and
// "the device behind the gateway did not answer".
constexpr int acknowledged = 5, gateway_heard_nothing = 11;
// Exceptions that may pass: reading is tried again.
constexpr int busy = 6;

const char* word_for(RegisterSpace space) {
    constexpr const char* words[] = {"coil", "discrete input", "register", "input register"};
    return words[static_cast<std::size_t>(space)];
}

std::string describe(const ModbusRequest& request, RegisterSpace space) {
    const char* verb = request.values.empty() ? "read" : "write";
    const char* word = word_for(space);
    return request.count == 1 ? fmt::format("{} {} {}", verb, word, request.address)
                              : fmt::format("{} {}s {}..{}", verb, word, request.address,
                                            request.address + request.count - 1);
}

void require_range(const std::string& device, const ModbusRequest& request, RegisterSpace space,
                   int most) {
    if (request.address < 0 || request.count < 1 || request.count > most ||
        request.address + request.count > 65536)
        throw DeviceError(
            device, describe(request, space),
            fmt::format("a request may hold 1 to {} {}s up to 65535", most, word_for(space)));
}

// The silence that begins a serial frame ("MODBUS over Serial Line V1.02", 2.5.1.1): 3.5 characters
// of 11 bits, at least 1.75 ms. TCP needs none.
Duration silence_before_frame(const StageLink& link) {
    using namespace std::chrono_literals;
    const auto* port = std::get_if<SerialPort>(&link.address);
    return port ? std::max<Duration>(1750us, Duration(38500ms) / port->baud) : Duration::zero();
}

bool may_be_carried_out(const ModbusReply& reply) {
    return reply.outcome == Outcome::unknown || reply.exception == acknowledged ||
           reply.exception == gateway_heard_nothing;
}

bool may_pass(const ModbusReply& reply) {
    return reply.outcome != Outcome::refused || reply.exception == busy ||
           reply.exception == acknowledged || reply.exception == gateway_heard_nothing;
}

}  // namespace

ModbusLink::ModbusLink(const StageLink& link, Clock& clock,
                       std::unique_ptr<ModbusTransport> transport)
    : link_(link), clock_(clock), transport_(std::move(transport)) {
    require_usable(link);
    device_ = device(link.unit);
    if (!transport_)
        transport_ = make_modbus_transport(link);
}

std::string ModbusLink::device(int unit) const {
    return fmt::format("stage {} unit {}", describe(link_), unit);
}

void ModbusLink::close() {
    drop_connection();
    failures_ = 0;
}

void ModbusLink::drop_connection() {
    transport_->close();
    connected_ = false;
}

std::chrono::milliseconds ModbusLink::reply_time() const {
    if (!deadline_)
        return link_.response_timeout;
    const auto half =
        std::chrono::duration_cast<std::chrono::milliseconds>((*deadline_ - clock_.now()) / 2);
    return std::clamp(half, min_reply_time, link_.response_timeout);
}

void ModbusLink::record(const ModbusExchange& exchange) {
    {
        const std::scoped_lock lock(trace_mutex_);
        trace_.push_back(exchange);
        if (trace_.size() > trace_length)
            trace_.pop_front();
    }
    // One that throws is gone: it fails once, and not the stop that follows.
    auto sink = std::exchange(sink_, {});
    if (!sink)
        return;
    sink(exchange);
    sink_ = std::move(sink);
}

std::vector<ModbusExchange> ModbusLink::last_exchanges() const {
    const std::scoped_lock lock(trace_mutex_);
    return {trace_.begin(), trace_.end()};
}

// 0, 20, 40, 80, 160, 160 ... ms: a device that restarts is not hammered.
void ModbusLink::pause_after_failures() {
    if (failures_ == 0)
        return;
    clock_.wait_for(std::chrono::milliseconds(10 << std::min(failures_, 4)), {});
}

// Returns why not, or nothing.
std::string ModbusLink::make_connection(const ModbusRequest& request) {
    std::string failure = transport_->connect(reply_time());
    connected_ = failure.empty();
    if (!connected_ || !link_.is_serial())
        return failure;
    const auto heard = drain();
    const bool stops = deadline_ && !request.values.empty();
    if (heard == ModbusTransport::Heard::hang_up)
        failure = "the line is gone";
    else if (heard == ModbusTransport::Heard::something && !stops)
        failure = "the line does not become quiet: another master, or wrong settings?";
    if (!failure.empty())
        drop_connection();
    return failure;
}

// Reads the line empty until nothing has arrived for as long as the slowest reply takes, or the
// time for that is over. Returns what it came to: `something` is a line that is not quiet.
ModbusTransport::Heard ModbusLink::drain() {
    using Heard = ModbusTransport::Heard;
    const Instant start = clock_.now();
    Instant end = start + 4 * link_.quiet;
    if (deadline_)
        end = std::min(end, start + (*deadline_ - start) / 2);
    for (Instant now = start; now < end; now = clock_.now()) {
        const Duration wait = std::min<Duration>(link_.quiet, end - now);
        const Heard heard = transport_->discard(wait);
        if (heard == Heard::hang_up || (heard == Heard::nothing && wait == link_.quiet))
            return heard;
    }
    return Heard::something;
}

// Over the open connection, or a new one.
ModbusReply ModbusLink::exchange(const ModbusRequest& request) {
    if (!connected_) {
        std::string failure = make_connection(request);
        if (!failure.empty())
            return {.outcome = Outcome::not_sent, .values = {}, .cause = std::move(failure)};
    }
    return transport_->exchange(request, reply_time());
}

// Whatever may still arrive after a failure belongs to that request, so the connection is given up.
ModbusReply ModbusLink::transact(const ModbusRequest& request, RegisterSpace space) {
    if (connected_ &&
        transport_->discard(silence_before_frame(link_)) != ModbusTransport::Heard::nothing)
        drop_connection();
    if (!connected_)
        pause_after_failures();
    const Instant start = clock_.now();
    ModbusReply reply = exchange(request);
    const bool link_works = reply.outcome == Outcome::answered || reply.outcome == Outcome::refused;
    failures_ = link_works ? 0 : failures_ + 1;
    if (!link_works)
        drop_connection();
    record({start, clock_.now() - start, request.unit, describe(request, space),
            request.values.empty() ? reply.values : request.values, reply.cause});
    return reply;
}

std::vector<std::uint16_t> ModbusLink::read(int unit, RegisterSpace space, int address, int count,
                                            int attempts) {
    const ModbusRequest request{unit, 1 + static_cast<int>(space), address, count, {}};
    require_range(device(unit), request, space, most_read(space));
    std::string cause = "no attempt was allowed";
    for (int attempt = 0; attempt < attempts; ++attempt) {
        ModbusReply reply = transact(request, space);
        if (reply.outcome == Outcome::answered)
            return std::move(reply.values);
        cause = reply.cause;
        if (!may_pass(reply))
            break;
    }
    throw DeviceError(device(unit), describe(request, space), cause);
}

void ModbusLink::write(int unit, RegisterSpace space, int address,
                       std::span<const std::uint16_t> values) {
    const int count = static_cast<int>(std::min<std::size_t>(values.size(), 65536));
    const int function = space != RegisterSpace::coils ? 16 : count == 1 ? 5 : 15;
    const ModbusRequest request{unit, function, address, count, {values.begin(), values.end()}};
    const std::string device = this->device(unit), text = describe(request, space);
    require_range(device, request, space, is_writable(space) ? most_written(space) : 0);
    const ModbusReply reply = transact(request, space);
    if (reply.outcome == Outcome::answered)
        return;
    if (may_be_carried_out(reply))
        throw UncertainWrite(device, text, reply.cause);
    throw DeviceError(device, text, reply.cause);
}

std::string describe(const ModbusExchange& exchange, Instant origin) {
    using Milliseconds = std::chrono::duration<double, std::milli>;
    const Milliseconds start = exchange.start - origin, took = exchange.took;
    std::string text = fmt::format("{:+.1f} ms, took {:.1f} ms: unit {}: {}", start.count(),
                                   took.count(), exchange.unit, exchange.request);
    if (!exchange.values.empty())
        text += fmt::format(" = {:04x}", fmt::join(exchange.values, " "));
    if (!exchange.failure.empty())
        text += fmt::format(": {}", exchange.failure);
    return text;
}

std::string describe(const std::vector<ModbusExchange>& exchanges) {
    std::string text;
    for (const ModbusExchange& exchange : exchanges)
        text += describe(exchange, exchanges.back().start) + "\n";
    return text;
}

}  // namespace etalon
