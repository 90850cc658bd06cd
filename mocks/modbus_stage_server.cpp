#include "mocks/modbus_stage_server.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <mutex>
#include <stop_token>
#include <thread>
#include <utility>

#include "core/errors.h"
#include "mocks/stage_registers.h"

namespace etalon {
namespace {

using Bytes = std::vector<std::uint8_t>;
using namespace std::chrono_literals;

constexpr std::size_t max_clients = 16;
constexpr auto tick = 10ms;           // how often the watchdog is looked at
constexpr std::size_t header = 7;     // MBAP: transaction, protocol, length, unit
constexpr std::size_t max_pdu = 253;  // function code and data

enum Exception : std::uint8_t {
    none = 0,
    illegal_function = 1,
    illegal_address = 2,
    illegal_value = 3
};

class FileDescriptor {
public:
    explicit FileDescriptor(int fd = -1) : fd_(fd) {}
    FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
    FileDescriptor& operator=(FileDescriptor&& other) noexcept {
        std::swap(fd_, other.fd_);
        return *this;
    }
    ~FileDescriptor() {
        if (fd_ >= 0)
            ::close(fd_);
    }
    int get() const { return fd_; }

private:
    int fd_;
};

int word_at(const Bytes& bytes, std::size_t at) {
    return bytes[at] << 8 | bytes[at + 1];
}

void append_word(Bytes& bytes, int word) {
    bytes.push_back(static_cast<std::uint8_t>(word >> 8));
    bytes.push_back(static_cast<std::uint8_t>(word & 0xFF));
}

// What a PDU asks. Everything is checked here, before anything is done.
Exception decode(const Bytes& pdu, ModbusRequest& request) {
    request.function = pdu[0];
    const bool reads = request.function == 3 || request.function == 4;
    if (!reads && request.function != 6 && request.function != 16)
        return illegal_function;
    if (pdu.size() < 5)
        return illegal_value;
    request.address = word_at(pdu, 1);
    request.count = request.function == 6 ? 1 : word_at(pdu, 3);
    if (request.function == 6)
        request.values.push_back(static_cast<std::uint16_t>(word_at(pdu, 3)));
    if (request.function != 16)
        return pdu.size() == 5 && request.count >= 1 && request.count <= 125 ? none : illegal_value;
    const auto bytes = static_cast<std::size_t>(request.count) * 2;
    if (request.count < 1 || request.count > 123 || pdu.size() != 6 + bytes || pdu[5] != bytes)
        return illegal_value;
    for (std::size_t at = 6; at < pdu.size(); at += 2)
        request.values.push_back(static_cast<std::uint16_t>(word_at(pdu, at)));
    return none;
}

// Carries the request out and returns the reply's PDU.
Bytes answer(StageRegisters& registers, const ModbusRequest& request) {
    Bytes pdu = {static_cast<std::uint8_t>(request.function)};
    const Bytes no_such_register = {static_cast<std::uint8_t>(request.function | 0x80),
                                    illegal_address};
    if (request.values.empty()) {
        const auto values =
            registers.read(RegisterSpace::holding_registers, request.address, request.count);
        if (!values)
            return no_such_register;
        pdu.push_back(static_cast<std::uint8_t>(2 * values->size()));
        for (const std::uint16_t value : *values)
            append_word(pdu, value);
        return pdu;
    }
    if (!registers.write(RegisterSpace::holding_registers, request.address, request.values))
        return no_such_register;
    append_word(pdu, request.address);
    append_word(pdu, request.function == 6 ? request.values[0] : request.count);
    return pdu;
}

FileDescriptor listen_on(int port) {
    const std::string device = fmt::format("stage controller 127.0.0.1:{}", port);
    if (port < 0 || port > 65535)
        throw ConfigError({device}, "the port must be 0 (any) to 65535");
    FileDescriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const int on = 1;
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const bool listens =
        socket.get() >= 0 &&
        setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
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
        throw DeviceError("stage controller", "find the bound port", std::strerror(errno));
    return ntohs(address.sin_port);
}

struct Client {
    FileDescriptor socket;
    Bytes received;
    bool closing = false;
};

struct DelayedReply {
    int socket;
    Bytes frame;
    Instant due;
};

}  // namespace

class ModbusStageServer::Worker {
public:
    Worker(SimulatedStage& stage, const StageProfile& profile, int port)
        : registers_(stage, profile),
          listener_(listen_on(port)),
          wake_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
          port_(bound_port(listener_)) {
        if (wake_.get() < 0)
            throw DeviceError("stage controller", "eventfd", std::strerror(errno));
        thread_ = std::jthread([this](std::stop_token stop) { serve(stop); });
    }

    ~Worker() {
        thread_.request_stop();
        wake();
    }

    int port() const { return port_; }

    void set_script(ModbusScript script) {
        const std::scoped_lock lock(mutex_);
        script_ = std::move(script);
    }

    void close_connections() {
        close_requested_ = true;
        wake();
    }

    std::vector<ModbusRequest> writes() const {
        const std::scoped_lock lock(mutex_);
        return writes_;
    }

private:
    void wake() { eventfd_write(wake_.get(), 1); }

    void serve(std::stop_token stop) {
        while (!stop.stop_requested()) {
            const std::vector<pollfd> ready = wait_for_events();
            eventfd_t ignored = 0;
            eventfd_read(wake_.get(), &ignored);
            for (std::size_t i = 0; i < clients_.size(); ++i) {
                if (ready[2 + i].revents != 0)
                    receive(clients_[i]);
            }
            send_due_replies();
            const bool all = close_requested_.exchange(false);
            if (all)
                delayed_.clear();
            std::erase_if(clients_, [all](const Client& client) { return all || client.closing; });
            accept_clients();
            registers_.check_watchdog();
        }
    }

    std::vector<pollfd> wait_for_events() {
        std::vector<pollfd> watched = {{wake_.get(), POLLIN, 0}, {listener_.get(), POLLIN, 0}};
        for (const Client& client : clients_)
            watched.push_back({client.socket.get(), POLLIN, 0});
        if (::poll(watched.data(), watched.size(), static_cast<int>(tick.count())) <= 0) {
            for (pollfd& entry : watched)
                entry.revents = 0;
        }
        return watched;
    }

    void accept_clients() {
        for (;;) {
            FileDescriptor socket(
                accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
            if (socket.get() < 0)
                return;
            const int on = 1;
            setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
            if (clients_.size() < max_clients)
                clients_.push_back({std::move(socket), {}, false});
        }
    }

    void receive(Client& client) {
        std::uint8_t chunk[1024];
        const ssize_t count = recv(client.socket.get(), chunk, sizeof chunk, MSG_DONTWAIT);
        if (count <= 0) {
            client.closing = count == 0 || (errno != EAGAIN && errno != EINTR);
            return;
        }
        client.received.insert(client.received.end(), chunk, chunk + count);
        while (!client.closing && take_frame(client)) {
        }
    }

    // Handles one complete frame, if there is one.
    bool take_frame(Client& client) {
        Bytes& bytes = client.received;
        if (bytes.size() < header)
            return false;
        const auto length = static_cast<std::size_t>(word_at(bytes, 4));  // unit and PDU
        if (word_at(bytes, 2) != 0 || length < 2 || length > max_pdu + 1) {
            client.closing = true;  // not Modbus: there is no way back into step
            return false;
        }
        const auto end = bytes.begin() + static_cast<std::ptrdiff_t>(header - 1 + length);
        if (bytes.size() < header - 1 + length)
            return false;
        const Bytes frame(bytes.begin(), end);
        bytes.erase(bytes.begin(), end);
        handle(client, frame);
        return true;
    }

    void handle(Client& client, const Bytes& frame) {
        const Bytes pdu(frame.begin() + header, frame.end());
        ModbusRequest request{.unit = frame[6], .values = {}};
        ModbusReaction reaction;
        Bytes reply_pdu;
        if (const Exception exception = decode(pdu, request); exception != none) {
            reply_pdu = {static_cast<std::uint8_t>(request.function | 0x80), exception};
        } else {
            reaction = ask_script(request);
            if (reaction.carry_out)
                reply_pdu = carry_out(request);
        }
        if (reaction.reply && !reply_pdu.empty())
            reply(client, frame, reply_pdu, reaction.delay);
        client.closing = client.closing || reaction.close;
    }

    ModbusReaction ask_script(const ModbusRequest& request) {
        ModbusScript script;
        {
            const std::scoped_lock lock(mutex_);
            script = script_;
        }
        return script ? script(request) : ModbusReaction{};
    }

    Bytes carry_out(const ModbusRequest& request) {
        Bytes pdu = answer(registers_, request);
        const bool refused = (pdu[0] & 0x80) != 0;
        if (!request.values.empty() && !refused) {
            const std::scoped_lock lock(mutex_);
            writes_.push_back(request);
        }
        return pdu;
    }

    void reply(Client& client, const Bytes& request, const Bytes& pdu,
               std::chrono::milliseconds delay) {
        Bytes frame(request.begin(), request.begin() + 4);  // transaction and protocol
        append_word(frame, static_cast<int>(pdu.size()) + 1);
        frame.push_back(request[6]);
        frame.insert(frame.end(), pdu.begin(), pdu.end());
        if (delay > 0ms)
            delayed_.push_back(
                {client.socket.get(), std::move(frame), std::chrono::steady_clock::now() + delay});
        else
            send_frame(client, frame);
    }

    // A client that does not read its replies is given up.
    void send_frame(Client& client, const Bytes& frame) {
        const ssize_t sent =
            send(client.socket.get(), frame.data(), frame.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent != static_cast<ssize_t>(frame.size()))
            client.closing = true;
    }

    // Before clients are removed, so that a socket's number is still the same client's.
    void send_due_replies() {
        const Instant now = std::chrono::steady_clock::now();
        for (Client& client : clients_) {
            for (const DelayedReply& reply : delayed_) {
                if (reply.socket == client.socket.get() && reply.due <= now)
                    send_frame(client, reply.frame);
            }
        }
        std::erase_if(delayed_, [&](const DelayedReply& reply) {
            const bool gone = std::ranges::none_of(clients_, [&](const Client& client) {
                return client.socket.get() == reply.socket && !client.closing;
            });
            return gone || reply.due <= now;
        });
    }

    StageRegisters registers_;
    FileDescriptor listener_, wake_;
    int port_;
    std::vector<Client> clients_;        // of the server's thread
    std::vector<DelayedReply> delayed_;  // of the server's thread
    std::atomic<bool> close_requested_ = false;

    mutable std::mutex mutex_;
    ModbusScript script_;
    std::vector<ModbusRequest> writes_;
    std::jthread thread_;  // last, so that it ends first
};

ModbusStageServer::ModbusStageServer(SimulatedStage& stage, const StageProfile& profile, int port)
    : worker_(std::make_unique<Worker>(stage, profile, port)) {}

ModbusStageServer::~ModbusStageServer() = default;

int ModbusStageServer::port() const {
    return worker_->port();
}

void ModbusStageServer::set_script(ModbusScript script) {
    worker_->set_script(std::move(script));
}

void ModbusStageServer::close_connections() {
    worker_->close_connections();
}

std::vector<ModbusRequest> ModbusStageServer::writes() const {
    return worker_->writes();
}

}  // namespace etalon
