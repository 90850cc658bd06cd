// Who may ask the page's server for what. docs/serve.md says what this protects against.
//
//   * Host must name this server: a foreign name that leads here (DNS rebinding) is refused.
//   * Where a token is set, every request brings it: as `Authorization: Bearer TOKEN`, as the
//     cookie that the link ?token=TOKEN sets, or as that link itself.
//   * What changes anything is a POST with the header X-Etalon-Action, whose value only a page of
//     this server can read, and an Origin, where there is one, that is this server.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace etalon {

// ---- what is asked and answered, free of any library: http_server.h translates

// Hostile until checked, bounded by ServerLimits. An absent header is empty.
struct WebRequest {
    std::string method;                         // "GET", "POST"
    std::string path;                           // decoded, "/api/state"
    std::map<std::string, std::string> fields;  // of the query, decoded
    std::string body;
    std::string host, origin, fetch_site, authorization, cookie;
    std::string action_token;   // of X-Etalon-Action, what a POST must bring
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

// An error as every route answers it: {"error": text}. Of an absolute path in the text only the
// last part is told: where the server's files lie is not for everybody who sees the page.
WebReply error_reply(int status, const std::string& text);

// ---- access

struct AccessRules {
    std::string token;                    // of all requests; empty: none is asked for
    std::string action_token;             // of requests that change something
    std::vector<std::string> host_names;  // besides the address itself: "localhost"
};

// In ASCII's small letters.
std::string lower(std::string_view text);

// 256 bits from the kernel, as 64 hexadecimal digits.
std::string random_token();

// Takes the same time wherever two texts of the same length differ.
bool is_same_secret(std::string_view given, std::string_view expected);

// The answer to a request that may not pass: 400, 401, 403, 405; nothing for one that may.
std::optional<WebReply> refusal(const AccessRules& rules, const WebRequest& request);

// Of a request with a right ?token=...: the way to the page without it, with the cookie set.
std::optional<WebReply> token_link(const AccessRules& rules, const WebRequest& request);

}  // namespace etalon
