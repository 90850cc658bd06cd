#include "tests/fakes/memory_transport.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr auto round_trip = 1ms;  // of an ordinary request

std::size_t bytes_of(const ModbusRequest& request) {
    return request.values.empty() ? 5U + 2U * static_cast<std::size_t>(request.count) : 8U;
}

}  // namespace

void MemoryTransport::advance_to(Instant until) {
    while (clock_.now() < until) {
        clock_.wait_until(std::min(until, clock_.now() + modbus_tick), {});
        controller_.tick();
    }
}

std::string MemoryTransport::connect(std::chrono::milliseconds) {
    hung_up_ = deaf_ = false;
    return "";
}

// A socket's replies are lost with it; a serial line still brings them.
void MemoryTransport::close() noexcept {
    if (!serial_)
        line_.clear();
}

ModbusReply MemoryTransport::exchange(const ModbusRequest& request,
                                      std::chrono::milliseconds timeout) {
    const Instant deadline = clock_.now() + timeout;
    controller_.tick();
    ++transaction_;
    if (!deaf_ && !hung_up_ && controller_.has_unit(request.unit))
        queue(request, controller_.handle(request));
    if (hung_up_ && !serial_) {
        advance_to(clock_.now() + round_trip);
        return {.values = {}, .cause = "Connection reset by peer"};
    }
    const auto first = std::ranges::min_element(line_, {}, &Frame::end);
    if (first == line_.end() || first->end > deadline) {
        advance_to(deadline);
        return {.values = {}, .cause = fmt::format("no answer within {} ms", timeout.count())};
    }
    const Frame frame = *first;
    line_.erase(first);
    advance_to(frame.end);
    return judge(frame, request);
}

void MemoryTransport::queue(const ModbusRequest& request, const ModbusAnswer& answer) {
    const ModbusReaction& reaction = answer.reaction;
    deaf_ = reaction.half_open && !serial_;
    hung_up_ = reaction.close;
    if (!reaction.reply)
        return;
    const Instant begin = clock_.now() + round_trip + reaction.delay;
    Frame frame{begin,
                begin + static_cast<int>(bytes_of(request)) * reaction.between_bytes,
                transaction_,
                request,
                answer.exception,
                answer.values,
                reaction.garbage};
    if (reaction.wrong_id) {
        frame.transaction += 7;
        frame.request.unit += serial_ ? 5 : 0;
    }
    line_.push_back(std::move(frame));
}

// What a client can see of a reply. On a serial line that is the unit, the function and the length,
// but not the address.
ModbusReply MemoryTransport::judge(const Frame& frame, const ModbusRequest& request) const {
    ModbusReply reply;
    const ModbusRequest& answered = frame.request;
    const bool fits = serial_ ? answered.unit == request.unit : frame.transaction == transaction_;
    if (frame.garbage)
        reply.cause = serial_ ? "Invalid CRC" : "Invalid data";
    else if (!fits)
        reply.cause = serial_ ? "Response not from requested slave" : "Invalid data";
    else if (answered.function != request.function || answered.count != request.count)
        reply.cause = "Invalid data";
    else if (frame.exception != no_exception)
        reply = {ModbusReply::Outcome::refused,
                 frame.exception,
                 {},
                 fmt::format("exception {}", frame.exception)};
    else
        reply = {ModbusReply::Outcome::answered, 0, frame.values, {}};
    return reply;
}

ModbusTransport::Heard MemoryTransport::discard(Duration wait) {
    if (hung_up_ && !serial_)
        return Heard::hang_up;
    const Instant until = clock_.now() + wait;
    const auto first = std::ranges::min_element(line_, {}, &Frame::begin);
    if (first == line_.end() || first->begin > until) {
        advance_to(until);
        return Heard::nothing;
    }
    advance_to(std::min(first->end, until));
    if (first->end <= clock_.now())
        line_.erase(first);
    else
        first->begin = clock_.now() + 1ns;  // the rest is still to come
    return Heard::something;
}

}  // namespace etalon
