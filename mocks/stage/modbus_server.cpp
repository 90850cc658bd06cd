#include "mocks/stage/modbus_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>

namespace etalon {

using namespace std::chrono_literals;

namespace {

constexpr std::size_t max_clients = 16;
constexpr auto end_of_frame = 20ms;  // on a serial line: what began before such a pause is lost

FileDescriptor listen_on(int port) {
    const std::string device = fmt::format("Modbus server 127.0.0.1:{}", port);
    if (port < 0 || port > 65535)
        throw ConfigError({device, 0, {}}, "the port must be 0 (any) to 65535");
    FileDescriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const int on = 1;
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const bool listens =
        socket && setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
        bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
        listen(socket.get(), static_cast<int>(max_clients)) == 0;
    if (!listens)
        throw DeviceError(device, "listen", std::strerror(errno));
    return socket;
}

int bound_port(const FileDescriptor& socket) {
    sockaddr_in address{};
    socklen_t size = sizeof address;
    if (getsockname(socket.get(), reinterpret_cast<sockaddr*>(&address), &size) != 0)
        throw DeviceError("Modbus server", "find the bound port", std::strerror(errno));
    return ntohs(address.sin_port);
}

// Until when the reply waits, and how its bytes are spread.
void queue(ModbusChannel& channel, const Bytes& bytes, const ModbusReaction& reaction) {
    Instant due = std::chrono::steady_clock::now() + reaction.delay;
    if (reaction.between_bytes == 0ms) {
        channel.outgoing.push_back({bytes, due});
        return;
    }
    for (const std::uint8_t byte : bytes) {
        channel.outgoing.push_back({{byte}, due});
        due += reaction.between_bytes;
    }
}

// A client that does not read its replies is given up.
void send_due(ModbusChannel& channel) {
    const Instant now = std::chrono::steady_clock::now();
    std::erase_if(channel.outgoing, [&](const ModbusChannel::Outgoing& outgoing) {
        if (outgoing.due > now)
            return false;
        const int file = channel.fd.get();
        const Bytes& bytes = outgoing.bytes;
        const ssize_t sent = channel.framing == ModbusFraming::tcp
                                 ? ::send(file, bytes.data(), bytes.size(), MSG_NOSIGNAL)
                                 : ::write(file, bytes.data(), bytes.size());
        if (sent != std::ssize(bytes))
            channel.give_up();
        return true;
    });
}

void reply(ModbusChannel& channel, ModbusFrame frame, const Bytes& pdu,
           const ModbusReaction& reaction) {
    frame.pdu = pdu;
    if (reaction.wrong_id) {
        frame.transaction = (frame.transaction + 7) & 0xFFFF;
        frame.unit += channel.framing == ModbusFraming::rtu ? 5 : 0;
    }
    Bytes bytes = to_bytes(channel.framing, frame);
    if (reaction.garbage)
        std::ranges::transform(bytes, bytes.begin(), [](std::uint8_t byte) {
            return static_cast<std::uint8_t>(byte ^ 0x5A);
        });
    if (reaction.reply)
        queue(channel, bytes, reaction);
    channel.deaf = channel.deaf || (reaction.half_open && channel.framing == ModbusFraming::tcp);
    if (reaction.close) {
        send_due(channel);
        channel.give_up();
    }
}

}  // namespace

ModbusServer::ModbusServer(ModbusUnits& units, int port)
    : units_(units), listener_(listen_on(port)), port_(bound_port(listener_)) {
    begin();
}

ModbusServer::ModbusServer(ModbusUnits& units, const SerialPair& line) : units_(units) {
    channels_.push_back(
        {.fd = FileDescriptor(dup(line.controller_end())), .framing = ModbusFraming::rtu});
    begin();
}

ModbusServer::~ModbusServer() {
    thread_.request_stop();
    wake();
}

void ModbusServer::close_connections() {
    close_requested_ = true;
    wake();
}

void ModbusServer::begin() {
    wake_ = FileDescriptor(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
    if (!wake_)
        throw DeviceError("Modbus server", "eventfd", std::strerror(errno));
    thread_ = std::jthread([this](std::stop_token stop) { serve(stop); });
}

void ModbusServer::wake() {
    eventfd_write(wake_.get(), 1);
}

void ModbusServer::serve(std::stop_token stop) {
    while (!stop.stop_requested()) {
        const std::vector<pollfd> ready = wait_for_events();
        eventfd_t ignored = 0;
        eventfd_read(wake_.get(), &ignored);
        for (std::size_t i = 0; i < channels_.size(); ++i) {
            if (ready[2 + i].revents != 0)
                receive(channels_[i]);
            send_due(channels_[i]);
        }
        close_channels();
        accept_clients();
        units_.tick();
    }
}

// Until the next reply is due, a tick at most.
std::vector<pollfd> ModbusServer::wait_for_events() {
    std::vector<pollfd> watched = {{wake_.get(), POLLIN, 0}, {listener_.get(), POLLIN, 0}};
    const Instant now = std::chrono::steady_clock::now();
    Duration wait = modbus_tick;
    for (const ModbusChannel& channel : channels_) {
        watched.push_back({channel.fd.get(), POLLIN, 0});
        for (const ModbusChannel::Outgoing& outgoing : channel.outgoing)
            wait = std::min(wait, outgoing.due - now);
    }
    const timespec limit{0, std::max<Duration>(wait, 0ms) / 1ns};
    if (ppoll(watched.data(), watched.size(), &limit, nullptr) <= 0)
        for (pollfd& entry : watched)
            entry.revents = 0;
    return watched;
}

void ModbusServer::close_channels() {
    const bool all = close_requested_.exchange(false);
    std::erase_if(channels_, [all](const ModbusChannel& channel) {
        return channel.closing || (all && channel.framing == ModbusFraming::tcp);
    });
}

void ModbusServer::accept_clients() {
    while (listener_) {
        FileDescriptor socket(
            accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
        if (!socket)
            return;
        const int on = 1;
        setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        if (channels_.size() < max_clients)
            channels_.push_back({.fd = std::move(socket)});
    }
}

void ModbusServer::receive(ModbusChannel& channel) {
    std::uint8_t chunk[1024];
    const ssize_t count = ::read(channel.fd.get(), chunk, sizeof chunk);
    if (count <= 0) {
        if (count == 0 || (errno != EAGAIN && errno != EINTR))
            channel.give_up();
        return;
    }
    const Instant now = std::chrono::steady_clock::now();
    if (channel.framing == ModbusFraming::rtu && now - channel.last_received > end_of_frame)
        channel.received.clear();
    channel.last_received = now;
    if (!channel.deaf)
        channel.received.insert(channel.received.end(), chunk, chunk + count);
    while (!channel.closing) {
        bool out_of_step = false;
        const auto frame = take_request(channel.framing, channel.received, out_of_step);
        if (out_of_step)
            channel.give_up();
        if (!frame)
            return;
        handle(channel, *frame);
    }
}

void ModbusServer::handle(ModbusChannel& channel, const ModbusFrame& frame) {
    ModbusRequest request{.unit = frame.unit, .values = {}};
    const ModbusException fault = decode_request(frame.pdu, request);
    ModbusAnswer answer;
    if (!units_.has_unit(frame.unit)) {
        answer.exception = target_silent;
        answer.reaction.reply = channel.framing == ModbusFraming::tcp;
    } else if (fault != no_exception)
        answer.exception = fault;
    else
        answer = units_.handle(request);
    reply(channel, frame,
          answer.exception == no_exception ? encode_reply(request, answer.values)
                                           : encode_exception(request.function, answer.exception),
          answer.reaction);
}

}  // namespace etalon
