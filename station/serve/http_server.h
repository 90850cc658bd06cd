// HTTP/1.1 by cpp-httplib, with bounds for all that a stranger can do. One request a connection.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>

#include "station/serve/access.h"

namespace etalon {

struct ServerLimits {
    std::size_t request_bytes = 64u << 10;  // line, headers and body
    std::chrono::seconds request_time{5};   // for all of them
    std::chrono::seconds write_time{10};    // for each piece of an answer to be taken
    int connections = 224;                  // at a time; one more is closed at once
    int streams = 160;                      // of them; one more is answered 503
};

class HttpServer {
public:
    virtual ~HttpServer() = default;

    // Port 0: any. Returns the port. Throws ConfigError when it cannot be had.
    virtual int open(const std::string& address, int port) = 0;

    // Answers until close() and the end of all connections. Throws DeviceError without network.
    virtual void serve() = 0;
    virtual void close() noexcept = 0;
};

// `answer` is called from many threads. What it throws becomes an answer 500.
std::unique_ptr<HttpServer> make_http_server(const ServerLimits& limits,
                                             std::function<WebReply(const WebRequest&)> answer);

}  // namespace etalon
