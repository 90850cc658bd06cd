// A browser without manners: raw requests to a server on loopback, for tests of what it outlasts.
#pragma once

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <string>
#include <utility>

namespace etalon {

// One connection. Closed on destruction.
class WebConnection {
public:
    explicit WebConnection(int port, const char* address = "127.0.0.1")
        : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(static_cast<std::uint16_t>(port));
        inet_pton(AF_INET, address, &to.sin_addr);
        EXPECT_EQ(connect(socket_, reinterpret_cast<sockaddr*>(&to), sizeof(to)), 0);
    }
    ~WebConnection() {
        if (socket_ >= 0)
            close(socket_);
    }
    WebConnection(WebConnection&& other) noexcept : socket_(std::exchange(other.socket_, -1)) {}
    WebConnection(const WebConnection&) = delete;
    WebConnection& operator=(const WebConnection&) = delete;

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
    // All that comes until the other side closes, or nothing has come for so long.
    std::string read_all(std::chrono::milliseconds patience = std::chrono::seconds(30)) {
        std::string all;
        pollfd entry{socket_, POLLIN, 0};
        char bytes[4096];
        while (poll(&entry, 1, static_cast<int>(patience.count())) == 1) {
            const ssize_t count = recv(socket_, bytes, sizeof(bytes), 0);
            if (count <= 0)
                break;
            all.append(bytes, static_cast<std::size_t>(count));
        }
        return all;
    }
    // Whether it is closed by the other side within this time, with or without an answer.
    bool is_closed_within(std::chrono::milliseconds time) {
        pollfd entry{socket_, POLLIN, 0};
        char bytes[4096];
        while (poll(&entry, 1, static_cast<int>(time.count())) == 1)
            if (recv(socket_, bytes, sizeof(bytes), 0) <= 0)
                return true;
        return false;
    }

private:
    int socket_;
};

struct WebAnswer {
    int status = 0;
    std::string head, body;
};

inline WebAnswer answer_of(const std::string& text) {
    const std::size_t end = text.find("\r\n\r\n");
    if (end == std::string::npos || text.size() < 12)
        return {0, text, ""};
    return {std::stoi(text.substr(9, 3)), text.substr(0, end), text.substr(end + 4)};
}

}  // namespace etalon
