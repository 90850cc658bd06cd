// What the page's server is asked and answers, free of any library: http_server.h makes
// the one of what came over the network and sends the other; tests make and read both.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace etalon {

// Hostile until checked; bounded by ServerLimits. A header that is absent is empty, one that came
// twice is refused before.
struct WebRequest {
    std::string method;                         // "GET", "POST"
    std::string path;                           // decoded, "/api/state"
    std::map<std::string, std::string> fields;  // of the query, decoded
    std::string body;
    std::string host, origin, fetch_site, authorization, cookie;
    std::string action_token;   // of X-Etalon-Action, what a POST must bring (access.h)
    std::string local_address;  // where it came in, "127.0.0.1"
    int local_port = 0;
};

// Takes a piece of a stream; false when its reader is gone or too slow.
using WebSink = std::function<bool(std::string_view)>;

struct WebReply {
    int status = 200;
    std::string type = "application/json", body = {};
    std::vector<std::pair<std::string, std::string>> headers = {};
    // In place of a body: called on the connection's own thread until it returns false.
    std::function<bool(const WebSink&)> stream = {};
};

}  // namespace etalon
