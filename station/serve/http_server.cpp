#include "station/serve/http_server.h"

#include <fmt/format.h>
#include <httplib.h>
#include <net/if.h>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#undef _res  // of <resolv.h>: Eigen has variables of this name

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>

#include "core/file/text.h"
#include "core/program/errors.h"
#include "core/time/clock.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

// A connection that ends when its request is too large or late, or its answer is not taken in time.
// The library bounds the body and each read, not the whole: its own stream (0.11.4) kept endless
// headers in memory, 125 MB in 5 s, and a request of a byte each 2 s held its thread.
class BoundedStream final : public httplib::Stream {
public:
    BoundedStream(int socket, const ServerLimits& limits)
        : socket_(socket), limits_(limits), end_(now() + limits.request_time) {}

    bool is_readable() const override { return ready(POLLIN, end_ - now()); }
    bool is_writable() const override { return ready(POLLOUT, limits_.write_time) && is_open(); }

    ssize_t read(char* to, std::size_t size) override {
        if (first_ == last_ && !fill())
            return -1;
        const std::size_t count = std::min(size, last_ - first_);
        std::copy_n(buffer_.data() + first_, count, to);
        first_ += count;
        return static_cast<ssize_t>(count);
    }
    ssize_t write(const char* from, std::size_t size) override {
        return ready(POLLOUT, limits_.write_time) ? send(socket_, from, size, MSG_NOSIGNAL) : -1;
    }
    // Of the library from 0.18 on, which asks these.
    bool wait_readable() const { return is_readable(); }
    bool wait_writable() const { return is_writable(); }
    time_t duration() const { return 0; }
    void get_remote_ip_and_port(std::string& ip, int& port) const override {
        name_by(getpeername, ip, port);
    }
    void get_local_ip_and_port(std::string& ip, int& port) const override {
        name_by(getsockname, ip, port);
    }
    socket_t socket() const override { return socket_; }

private:
    static Instant now() { return SteadyClock().now(); }

    bool ready(short what, Duration time) const {
        pollfd entry{socket_, what, 0};
        const auto milliseconds = std::chrono::ceil<std::chrono::milliseconds>(time).count();
        return milliseconds > 0 && poll(&entry, 1, static_cast<int>(milliseconds)) == 1;
    }
    // A reader that has closed its side takes nothing more.
    bool is_open() const {
        char byte = 0;
        const ssize_t count = recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
        return count > 0 || (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK));
    }
    bool fill() {
        const std::size_t left = limits_.request_bytes - std::min(limits_.request_bytes, taken_);
        if (left == 0 || !ready(POLLIN, end_ - now()))
            return false;
        const ssize_t count = recv(socket_, buffer_.data(), std::min(left, buffer_.size()), 0);
        if (count <= 0)
            return false;
        taken_ += static_cast<std::size_t>(count);
        first_ = 0;
        last_ = static_cast<std::size_t>(count);
        return true;
    }
    template <class Ask>
    void name_by(Ask ask, std::string& ip, int& port) const {
        sockaddr_storage address{};
        socklen_t size = sizeof(address);
        std::array<char, INET6_ADDRSTRLEN + IF_NAMESIZE + 1> number{};
        std::array<char, 8> service{};
        auto* const name = reinterpret_cast<sockaddr*>(&address);
        if (ask(socket_, name, &size) != 0 ||
            getnameinfo(name, size, number.data(), number.size(), service.data(), service.size(),
                        NI_NUMERICHOST | NI_NUMERICSERV) != 0)
            return;
        ip = number.data();
        ip.erase(std::min(ip.find('%'), ip.size()));  // an interface is no part of a Host
        port = std::atoi(service.data());
    }

    int socket_;
    const ServerLimits& limits_;
    Instant end_;  // of the request
    std::array<char, 4096> buffer_{};
    std::size_t first_ = 0, last_ = 0, taken_ = 0;
};

bool has_doubled_header(const httplib::Request& request) {
    for (const char* name : {"Host", "Origin", "Authorization", "Cookie", "Content-Length",
                             "Transfer-Encoding", "X-Etalon-Action", "Sec-Fetch-Site"})
        if (request.get_header_value_count(name) > 1)
            return true;
    return false;
}

// Two lengths of a body, or one that is no number: the library takes "abc" for 0.
bool has_doubtful_length(const httplib::Request& request) {
    if (!request.has_header("Content-Length"))
        return false;
    const std::string length = request.get_header_value("Content-Length");
    return request.has_header("Transfer-Encoding") || length.empty() || length.size() > 18 ||
           !std::ranges::all_of(length, [](char c) { return c >= '0' && c <= '9'; });
}

// Nothing that the library would unpack: parts, forms, compressed bytes.
bool has_plain_json(const httplib::Request& request) {
    const std::string type = request.get_header_value("Content-Type");
    return lower(trimmed(type.substr(0, type.find(';')))) == "application/json" &&
           !request.has_header("Content-Encoding");
}

// RFC 9110, 14.2: a server may ignore it. The library would cut every answer, errors too.
void ignore_range(httplib::Request& request) {
    request.ranges.clear();
}

WebRequest request_of(const httplib::Request& request) {
    WebRequest asked;
    asked.method = request.method;
    asked.path = request.path;
    asked.fields = {request.params.begin(), request.params.end()};
    asked.body = request.body;
    asked.host = request.get_header_value("Host");
    asked.origin = request.get_header_value("Origin");
    asked.fetch_site = request.get_header_value("Sec-Fetch-Site");
    asked.authorization = request.get_header_value("Authorization");
    asked.cookie = request.get_header_value("Cookie");
    asked.action_token = request.get_header_value("X-Etalon-Action");
    asked.local_address = request.local_addr;
    asked.local_port = request.local_port;
    return asked;
}

class HttplibServer final : public HttpServer, private httplib::Server {
public:
    HttplibServer(const ServerLimits& limits, std::function<WebReply(const WebRequest&)> answer)
        : limits_(limits), answer_(std::move(answer)) {
        constexpr int spare_threads = 4;  // which close the connections that are too many
        new_task_queue = [this] {
            return new httplib::ThreadPool(
                static_cast<std::size_t>(limits_.connections + spare_threads));
        };
        set_payload_max_length(limits_.request_bytes);
        // The library's own way lets two servers share a port, and each gets some of the requests.
        set_socket_options([](socket_t socket) {
            const int yes = 1;
            setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
        });
        // Before any route: none of the library's own is reached. A POST's body is read after it.
        set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& reply) {
            const bool is_doubtful = has_doubtful_length(request);
            if (request.method == "POST" && has_plain_json(request) && !is_doubtful)
                return HandlerResponse::Unhandled;
            reply_with(is_doubtful ? error_reply(400, "Content-Length must be one whole number")
                       : request.method == "POST"
                           ? error_reply(415, "a POST has application/json, as it is")
                           : answered(request),
                       reply);
            return HandlerResponse::Handled;
        });
        Post(".*", [this](const httplib::Request& request, httplib::Response& reply) {
            reply_with(answered(request), reply);
        });
    }

    int open(const std::string& address, int port) override {
        const int bound =
            port == 0 ? bind_to_any_port(address) : (bind_to_port(address, port) ? port : -1);
        if (bound < 0)
            throw ConfigError(
                {errno == EADDRNOTAVAIL ? "--listen" : "--port"},
                fmt::format("{}:{} cannot be listened on: {}", address, port,
                            errno == EADDRNOTAVAIL ? "it is no address of this machine"
                                                   : std::generic_category().message(errno)));
        // The library lets five wait to be accepted: a sixth would try again a second later.
        ::listen(svr_sock_, SOMAXCONN);
        return bound;
    }
    void serve() override {
        listen_after_bind();
        if (!is_closing_)
            throw DeviceError("the page's port", "accept a connection",
                              std::generic_category().message(errno));
    }
    void close() noexcept override {
        is_closing_ = true;
        stop();
    }

private:
    WebReply answered(const httplib::Request& request) {
        try {
            if (has_doubled_header(request))
                return error_reply(400, "a header came twice");
            return answer_(request_of(request));
        } catch (const std::exception& error) {
            return error_reply(500, error.what());
        }
    }

    void reply_with(const WebReply& answered, httplib::Response& reply) {
        reply.status = answered.status;
        for (const auto& [name, value] : answered.headers)
            reply.set_header(name, value);
        if (answered.stream)
            stream(answered, reply);
        else
            reply.set_content(answered.body, answered.type);
    }

    void stream(const WebReply& answered, httplib::Response& reply) {
        if (++streams_ > limits_.streams) {
            --streams_;
            return reply_with(error_reply(503, "too many pages are open"), reply);
        }
        reply.set_content_provider(
            answered.type,
            [this, more = answered.stream](std::size_t, httplib::DataSink& sink) {
                if (is_closing_ || !sink.is_writable())
                    return false;
                return more([&sink](std::string_view piece) {
                    return sink.write(piece.data(), piece.size());
                });
            },
            [this](bool) { --streams_; });
    }

    bool process_and_close_socket(socket_t socket) override {
        bool done = false;
        if (++connections_ <= limits_.connections) {
            BoundedStream stream(socket, limits_);
            done = processed(*this, stream);
            drain(socket);
        }
        --connections_;
        ::close(socket);
        return done;
    }

    // The library from 0.18 on wants the addresses, too.
    template <class Base>
    static bool processed(Base& server, BoundedStream& stream) {
        bool closed = false;
        if constexpr (requires { server.process_request(stream, true, closed, ignore_range); }) {
            return server.process_request(stream, true, closed, ignore_range);
        } else {
            std::string remote, local;
            int remote_port = 0, local_port = 0;
            stream.get_remote_ip_and_port(remote, remote_port);
            stream.get_local_ip_and_port(local, local_port);
            return server.process_request(stream, remote, remote_port, local, local_port, true,
                                          closed, ignore_range);
        }
    }

    // Closing with unread bytes resets the connection and loses the answer: they are thrown away.
    static void drain(int socket) {
        shutdown(socket, SHUT_WR);
        std::array<char, 4096> waste{};
        pollfd entry{socket, POLLIN, 0};
        for (int i = 0; i < 64 && poll(&entry, 1, 50) == 1; ++i)
            if (recv(socket, waste.data(), waste.size(), 0) <= 0)
                return;
    }

    const ServerLimits limits_;
    std::function<WebReply(const WebRequest&)> answer_;
    std::atomic<int> connections_ = 0, streams_ = 0;
    std::atomic<bool> is_closing_ = false;
};

}  // namespace

std::unique_ptr<HttpServer> make_http_server(const ServerLimits& limits,
                                             std::function<WebReply(const WebRequest&)> answer) {
    return std::make_unique<HttplibServer>(limits, std::move(answer));
}

}  // namespace etalon
