// The wire between a station and a twin's controller without one: in memory and on virtual time, so
// that thousands of moves with faults take seconds. Replies come late, broken or never as they
// would on a socket or a serial line: a socket's old replies end with their connection and carry
// the transaction they answer; a serial line's arrive whenever they like and look like any other.
//
// For one thread. A clock that is advanced by nobody else but the station's own waiting.
#pragma once

#include <fmt/format.h>

#include "core/time/clock.h"
#include "mocks/stage/modbus_controller.h"

namespace etalon {

// Of a client whose wire this is; a serial line's replies come up to `quiet` late.
inline StageLink memory_link(bool serial) {
    using namespace std::chrono_literals;
    StageLink link{.response_timeout = 100ms, .quiet = 250ms};
    if (serial)
        link.address = SerialPort{.device = "in memory"};
    return link;
}

class MemoryTransport final : public ModbusTransport {
public:
    // Both must outlive the transport.
    MemoryTransport(ModbusController& controller, VirtualClock& clock, bool serial)
        : controller_(controller), clock_(clock), serial_(serial) {}

    std::string connect(std::chrono::milliseconds) override {
        hung_up_ = deaf_ = false;
        return "";
    }
    void close() noexcept override {
        // A socket's replies are lost with it; a serial line still brings them.
        if (!serial_)
            line_.clear();
    }
    ModbusReply exchange(const ModbusRequest& request, std::chrono::milliseconds timeout) override {
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
    Heard discard(Duration wait) override {
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
            first->begin = clock_.now() + std::chrono::nanoseconds(1);  // the rest is still to come
        return Heard::something;
    }

private:
    static constexpr std::chrono::milliseconds round_trip{1};  // of an ordinary request

    static std::size_t bytes_of(const ModbusRequest& request) {
        return request.values.empty() ? 5U + 2U * static_cast<std::size_t>(request.count) : 8U;
    }

    struct Frame {
        Instant begin, end;  // of its arrival
        int transaction = 0;
        ModbusRequest request;  // that it answers
        int exception = no_exception;
        std::vector<std::uint16_t> values;
        bool garbage = false;
    };

    void advance_to(Instant until) {
        while (clock_.now() < until) {
            clock_.wait_until(std::min(until, clock_.now() + modbus_tick), {});
            controller_.tick();
        }
    }
    void queue(const ModbusRequest& request, const ModbusAnswer& answer) {
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
    ModbusReply judge(const Frame& frame, const ModbusRequest& request) const {
        // What a client can see of a reply. On a serial line that is the unit, the function and the
        // length, but not the address.
        ModbusReply reply;
        const ModbusRequest& answered = frame.request;
        const bool fits =
            serial_ ? answered.unit == request.unit : frame.transaction == transaction_;
        if (frame.garbage)
            reply.cause = serial_ ? "Invalid CRC" : "Invalid data";
        else if (!fits)
            reply.cause = serial_ ? "an answer of another unit" : "an answer to another request";
        else if (answered.function != request.function || answered.count != request.count)
            reply.cause = "an answer that does not fit the request";
        else if (frame.exception != no_exception)
            reply = {ModbusReply::Outcome::refused,
                     frame.exception,
                     {},
                     fmt::format("exception {}", frame.exception)};
        else
            reply = {ModbusReply::Outcome::answered, 0, frame.values, {}};
        return reply;
    }

    ModbusController& controller_;
    VirtualClock& clock_;
    bool serial_;
    bool hung_up_ = false, deaf_ = false;
    int transaction_ = 0;
    std::vector<Frame> line_;  // on their way to the station
};

}  // namespace etalon
