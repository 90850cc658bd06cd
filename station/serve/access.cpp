#include "station/serve/access.h"

#include <fmt/format.h>
#include <openssl/crypto.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "report/json_text.h"

namespace etalon {
namespace {

std::string cookie_name(const WebRequest& request) {
    return fmt::format("etalon_{}", request.local_port);  // cookies know no ports
}

std::string cookie_of(const WebRequest& request) {
    const std::string begin = cookie_name(request) + "=";
    for (const std::string& part : split(request.cookie, ';'))
        if (const std::string_view pair = trimmed(part); pair.starts_with(begin))
            return std::string(pair.substr(begin.size()));
    return {};
}

std::string bearer_of(const WebRequest& request) {
    constexpr std::string_view begin = "Bearer ";
    return request.authorization.starts_with(begin) ? request.authorization.substr(begin.size())
                                                    : "";
}

// "127.0.0.1:7530", "[::1]:7530", and each of the names with the port.
bool is_this_server(const AccessRules& rules, const WebRequest& request, std::string_view asked) {
    const std::string host = lower(asked);
    std::vector<std::string> names = rules.host_names;
    names.push_back(request.local_address.find(':') == std::string::npos
                        ? request.local_address
                        : "[" + request.local_address + "]");
    return std::ranges::any_of(names, [&](const std::string& each) {
        const std::string name = lower(each);
        const bool usual_port = request.local_port == 80 && host == name;
        return usual_port || host == fmt::format("{}:{}", name, request.local_port);
    });
}

bool is_own_origin(const AccessRules& rules, const WebRequest& request) {
    constexpr std::string_view scheme = "http://";
    const std::string_view origin = request.origin;
    return origin.starts_with(scheme) &&
           is_this_server(rules, request, origin.substr(scheme.size()));
}

// "/home/anna/cameras/a.yml:3: key: text" -> "a.yml:3: key: text"; a URI (v4l2:/dev/video0) stays.
std::string without_folders(std::string_view text) {
    constexpr std::string_view ends = " \t\n\"'()[],;=";
    std::string told;
    for (std::size_t at = 0; at < text.size();) {
        if (text[at] != '/' || (at > 0 && ends.find(text[at - 1]) == std::string_view::npos)) {
            told += text[at++];
            continue;
        }
        const std::string_view path = text.substr(at, text.find_first_of(ends, at) - at);
        const std::size_t last = path.find_last_not_of("/:");
        const bool is_path = last != std::string_view::npos;  // no stroke alone: "mm / s"
        told += is_path ? path.substr(path.rfind('/', last) + 1) : path;
        at += path.size();
    }
    return told;
}

std::optional<WebReply> refused_action(const AccessRules& rules, const WebRequest& request) {
    if (!request.origin.empty() && !is_own_origin(rules, request))
        return error_reply(403, "this page belongs to another server");
    if (!request.fetch_site.empty() && request.fetch_site != "same-origin")
        return error_reply(403, "the request comes from another site");
    if (!is_same_secret(request.action_token, rules.action_token))
        return error_reply(403, "the page is older than this server: load it again");
    return std::nullopt;
}

}  // namespace

std::string lower(std::string_view text) {
    std::string small(text);
    std::ranges::transform(small, small.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return small;
}

std::string random_token() {
    std::array<unsigned char, 32> bytes{};
    if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
        throw std::system_error(errno, std::generic_category(), "no random numbers");
    std::string text;
    for (const unsigned char byte : bytes)
        text += fmt::format("{:02x}", byte);
    return text;
}

bool is_same_secret(std::string_view given, std::string_view expected) {
    return !expected.empty() && given.size() == expected.size() &&
           CRYPTO_memcmp(given.data(), expected.data(), expected.size()) == 0;
}

std::optional<WebReply> refusal(const AccessRules& rules, const WebRequest& request) {
    if (!is_this_server(rules, request, request.host))
        return error_reply(403, "the address in the browser is not one of this server's");
    if (!rules.token.empty() && !is_same_secret(bearer_of(request), rules.token) &&
        !is_same_secret(cookie_of(request), rules.token))
        return error_reply(401, "open the link that `etalon serve` printed: it has the token");
    if (request.method == "POST")
        return refused_action(rules, request);
    if (request.method != "GET")
        return error_reply(405, "GET or POST");
    if (request.path.starts_with("/api/") && !request.fetch_site.empty() &&
        request.fetch_site != "same-origin" && request.fetch_site != "none")
        return error_reply(403, "the request comes from another site");
    return std::nullopt;
}

std::optional<WebReply> token_link(const AccessRules& rules, const WebRequest& request) {
    const auto given = request.fields.find("token");
    if (request.method != "GET" || given == request.fields.end() ||
        !is_this_server(rules, request, request.host) ||
        !is_same_secret(given->second, rules.token))
        return std::nullopt;
    return WebReply{303,
                    "text/plain",
                    "",
                    {{"Location", "/"},
                     {"Set-Cookie", fmt::format("{}={}; HttpOnly; SameSite=Strict; Path=/",
                                                cookie_name(request), rules.token)}}};
}

WebReply error_reply(int status, const std::string& text) {
    return {status, "application/json", text_of({{"error", without_folders(text)}}, -1)};
}

}  // namespace etalon
