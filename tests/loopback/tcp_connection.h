// A raw TCP client of a server on loopback, without manners: what the server outlasts.
#pragma once

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <utility>

#include "tests/test.h"

namespace etalon {

// One connection. Closed on destruction.
class TcpConnection {
public:
    explicit TcpConnection(int port, const char* address = "127.0.0.1")
        : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(static_cast<std::uint16_t>(port));
        inet_pton(AF_INET, address, &to.sin_addr);
        is_open_ = connect(socket_, reinterpret_cast<sockaddr*>(&to), sizeof(to)) == 0;
    }
    ~TcpConnection() {
        if (socket_ >= 0)
            close(socket_);
    }
    TcpConnection(TcpConnection&& other) noexcept
        : socket_(std::exchange(other.socket_, -1)), is_open_(other.is_open_) {}
    TcpConnection(const TcpConnection&) = delete;
    TcpConnection& operator=(const TcpConnection&) = delete;

    // Whether somebody listened there.
    bool is_open() const { return is_open_; }
    // False when the other side has had enough.
    bool send(std::string_view text) {
        while (!text.empty()) {
            const ssize_t count = ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL);
            if (count <= 0)
                return false;
            text.remove_prefix(static_cast<std::size_t>(count));
        }
        return true;
    }
    // Nothing more is sent.
    void end() { shutdown(socket_, SHUT_WR); }
    // The next bytes; empty when the other side has closed, or nothing has come for so long.
    std::string read(std::chrono::milliseconds patience) {
        pollfd entry{socket_, POLLIN, 0};
        char bytes[4096];
        const ssize_t count = poll(&entry, 1, static_cast<int>(patience.count())) == 1
                                  ? recv(socket_, bytes, sizeof(bytes), 0)
                                  : -1;
        is_closed_ = count == 0 || (count < 0 && entry.revents != 0);
        return count > 0 ? std::string(bytes, static_cast<std::size_t>(count)) : "";
    }
    // All that comes until the other side closes, or nothing has come for so long.
    std::string read_all(std::chrono::milliseconds patience = std::chrono::seconds(30)) {
        std::string all;
        for (std::string part = read(patience); !part.empty(); part = read(patience))
            all += part;
        return all;
    }
    // Whether it is closed by the other side within this time, with or without an answer.
    bool is_closed_within(std::chrono::milliseconds time) {
        read_all(time);
        return is_open_ && is_closed_;
    }

private:
    int socket_;
    bool is_open_ = false, is_closed_ = false;
};

}  // namespace etalon
