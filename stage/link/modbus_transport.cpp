#include "stage/link/modbus_transport.h"

#include <fmt/format.h>
#include <modbus.h>
#include <netdb.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <span>

namespace etalon {
namespace {

using FrameBytes = std::vector<std::uint8_t>;
using FrameView = std::span<const std::uint8_t>;

void append_word(FrameBytes& bytes, int word) {
    bytes.push_back(static_cast<std::uint8_t>(word >> 8));
    bytes.push_back(static_cast<std::uint8_t>(word & 0xff));
}

int word_at(FrameView bytes, std::size_t at) {
    return bytes[at] << 8 | bytes[at + 1];
}

// Function code and data ("MODBUS Application Protocol V1.1b3", 6).
FrameBytes pdu_of(const ModbusRequest& request) {
    const std::vector<std::uint16_t>& values = request.values;
    FrameBytes pdu = {static_cast<std::uint8_t>(request.function)};
    append_word(pdu, request.address);
    append_word(pdu, request.function == 5   ? (values.front() != 0 ? 0xff00 : 0)
                     : request.function == 6 ? values.front()
                                             : request.count);
    if (request.function == 15) {
        pdu.push_back(static_cast<std::uint8_t>((values.size() + 7) / 8));
        const std::size_t first = pdu.size();
        pdu.resize(first + pdu.back());
        for (std::size_t i = 0; i < values.size(); ++i)
            if (values[i] != 0)
                pdu[first + i / 8] = static_cast<std::uint8_t>(pdu[first + i / 8] | 1 << i % 8);
    } else if (request.function == 16) {
        pdu.push_back(static_cast<std::uint8_t>(2 * values.size()));
        for (const std::uint16_t value : values)
            append_word(pdu, value);
    }
    return pdu;
}

// The values of an answer to a read, or none; false where it does not fit the request.
bool take_answer(const ModbusRequest& request, FrameView pdu, std::vector<std::uint16_t>& values) {
    if (request.function > 4) {  // it repeats what the request begins with
        const FrameBytes asked = pdu_of(request);
        return std::ranges::equal(pdu, FrameView(asked).first(5));
    }
    const bool bits = request.function <= 2;
    const auto count = static_cast<std::size_t>(request.count);
    const std::size_t bytes = bits ? (count + 7) / 8 : 2 * count;
    if (pdu.size() != 2 + bytes || pdu[0] != request.function || pdu[1] != bytes)
        return false;
    for (std::size_t i = 0; i < count; ++i)
        values.push_back(static_cast<std::uint16_t>(bits ? pdu[2 + i / 8] >> i % 8 & 1
                                                         : word_at(pdu, 2 + 2 * i)));
    return true;
}

// What a whole answer of the unit says to the request. A refusal leaves the connection in order.
ModbusReply reply_of(const ModbusRequest& request, FrameView pdu) {
    ModbusReply reply;
    if (pdu.size() == 2 && pdu[0] == (request.function | 0x80)) {
        const int error = MODBUS_ENOBASE + pdu[1];
        const bool is_known = error >= EMBXILFUN && error <= EMBXGTAR;
        reply.cause = modbus_strerror(is_known ? error : EMBBADEXC);
        if (is_known) {
            reply.outcome = ModbusReply::Outcome::refused;
            reply.exception = pdu[1];
        }
    } else if (take_answer(request, pdu, reply.values)) {
        reply.outcome = ModbusReply::Outcome::answered;
    } else {
        reply.cause = "an answer that does not fit the request";
    }
    return reply;
}

// Of a name that nobody knows libmodbus says "Connection refused", too. Empty for one that leads to
// an address.
std::string name_failure(const StageLink& link) {
    const auto* address = std::get_if<TcpAddress>(&link.address);
    if (address == nullptr)
        return "";
    addrinfo* found = nullptr;
    const int failure = getaddrinfo(address->host.c_str(), nullptr, nullptr, &found);
    if (failure == 0)
        freeaddrinfo(found);
    return failure == 0
               ? ""
               : fmt::format("no host '{}' is known: {}", address->host, gai_strerror(failure));
}

modbus_t* make_context(const TcpAddress& address) {
    return modbus_new_tcp_pi(address.host.c_str(), std::to_string(address.port).c_str());
}

modbus_t* make_context(const SerialPort& port) {
    return modbus_new_rtu(port.device.c_str(), port.baud, port.parity, port.data_bits,
                          port.stop_bits);
}

// A second master on a serial line would take replies that are not its own.
bool takes_line_alone(modbus_t* context) {
    return flock(modbus_get_socket(context), LOCK_EX | LOCK_NB) == 0;
}

class LibmodbusTransport final : public ModbusTransport {
public:
    explicit LibmodbusTransport(const StageLink& link) : link_(link) {}
    ~LibmodbusTransport() override { close(); }
    LibmodbusTransport(const LibmodbusTransport&) = delete;
    LibmodbusTransport& operator=(const LibmodbusTransport&) = delete;

    // No error recovery flags: libmodbus' own reconnecting hangs for ever when the server is gone.
    // Byte time-out 0: the response time-out then bounds the whole reply, however it trickles in.
    std::string connect(std::chrono::milliseconds timeout) override {
        context_ =
            std::visit([](const auto& address) { return make_context(address); }, link_.address);
        const bool connected = context_ && set_timeout(timeout) &&
                               modbus_set_byte_timeout(context_, 0, 0) == 0 &&
                               modbus_connect(context_) == 0;
        std::string failure;
        const int error = errno;
        if (!connected && error == ECONNREFUSED)
            failure = name_failure(link_);
        if (!connected && failure.empty())
            failure = modbus_strerror(error);
        else if (link_.is_serial() && !takes_line_alone(context_))
            failure = "another program uses the line";
        if (failure.empty())
            return "";
        close();
        return "cannot connect: " + failure;
    }

    // What a serial line has not sent yet must not go out later, and closing would wait for it.
    void close() noexcept override {
        if (!context_)
            return;
        if (link_.is_serial() && modbus_get_socket(context_) >= 0)
            tcflush(modbus_get_socket(context_), TCOFLUSH);
        modbus_close(context_);
        modbus_free(context_);
        context_ = nullptr;
    }

    // libmodbus' own functions take the answer of any unit on TCP: frames are made and read here.
    ModbusReply exchange(const ModbusRequest& request, std::chrono::milliseconds timeout) override {
        std::array<std::uint8_t, MODBUS_MAX_ADU_LENGTH> frame{};
        const bool sent =
            modbus_set_slave(context_, request.unit) == 0 && set_timeout(timeout) && send(request);
        const int length = sent ? modbus_receive_confirmation(context_, frame.data()) : -1;
        const int error = errno;
        ModbusReply reply;
        if (length < 0)
            reply.cause = error == ETIMEDOUT
                              ? fmt::format("no answer within {} ms", timeout.count())
                              : modbus_strerror(error);
        else
            reply = judged(request, FrameView(frame).first(static_cast<std::size_t>(length)));
        return reply;
    }

    Heard discard(Duration wait) override {
        const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(wait);
        const timespec limit{seconds.count(), (wait - seconds) / std::chrono::nanoseconds(1)};
        pollfd line{modbus_get_socket(context_), POLLIN, 0};
        const int ready = ppoll(&line, 1, &limit, nullptr);
        if (ready <= 0)
            return ready == 0 ? Heard::nothing : Heard::hang_up;
        std::uint8_t bytes[512];
        return ::read(line.fd, bytes, sizeof bytes) > 0 ? Heard::something : Heard::hang_up;
    }

private:
    bool set_timeout(std::chrono::milliseconds timeout) {
        const auto microseconds = static_cast<std::uint32_t>(timeout.count() % 1000 * 1000);
        return modbus_set_response_timeout(
                   context_, static_cast<std::uint32_t>(timeout.count() / 1000), microseconds) == 0;
    }

    // "MODBUS Messaging on TCP/IP Implementation Guide V1.0b", 3.1.3: transaction, protocol 0,
    // length, unit. On a serial line libmodbus adds the check sum, and keeps the sender's timing.
    bool send(const ModbusRequest& request) {
        const FrameBytes pdu = pdu_of(request);
        FrameBytes frame;
        if (!link_.is_serial()) {
            append_word(frame, ++transaction_);
            append_word(frame, 0);
            append_word(frame, static_cast<int>(pdu.size()) + 1);
        }
        frame.push_back(static_cast<std::uint8_t>(request.unit));
        frame.insert(frame.end(), pdu.begin(), pdu.end());
        if (link_.is_serial())
            return modbus_send_raw_request(context_, frame.data(), static_cast<int>(frame.size())) >
                   0;
        return ::send(modbus_get_socket(context_), frame.data(), frame.size(), MSG_NOSIGNAL) ==
               static_cast<ssize_t>(frame.size());
    }

    // Of a frame as libmodbus received it: empty from another unit of a serial line, whose check
    // sum it has compared otherwise.
    ModbusReply judged(const ModbusRequest& request, FrameView frame) const {
        const std::size_t head = link_.is_serial() ? 1 : 7, tail = link_.is_serial() ? 2 : 0;
        ModbusReply reply;
        if (frame.size() < head + 2 + tail || frame[head - 1] != request.unit)
            reply.cause = "an answer of another unit";
        else if (!link_.is_serial() &&
                 (word_at(frame, 0) != transaction_ || word_at(frame, 2) != 0))
            reply.cause = "an answer to another request";
        else
            reply = reply_of(request, frame.subspan(head, frame.size() - head - tail));
        return reply;
    }

    StageLink link_;
    modbus_t* context_ = nullptr;    // null: not connected
    std::uint16_t transaction_ = 0;  // of the last request on TCP
};

}  // namespace

std::unique_ptr<ModbusTransport> make_modbus_transport(const StageLink& link) {
    return std::make_unique<LibmodbusTransport>(link);
}

}  // namespace etalon
