#include "station/serve/access.h"

#include "tests/test.h"

namespace etalon {
namespace {

constexpr const char *secret = "4f6b", *action = "9a1c";

AccessRules rules_with(const std::string& token) {
    return {token, action, {"localhost"}};
}

WebRequest asked(const std::string& method, const std::string& path) {
    return {.method = method,
            .path = path,
            .host = "127.0.0.1:7530",
            .local_address = "127.0.0.1",
            .local_port = 7530};
}

WebRequest post_of_own_page() {
    WebRequest request = asked("POST", "/api/run/start");
    request.origin = "http://127.0.0.1:7530";
    request.fetch_site = "same-origin";
    request.action_token = action;
    return request;
}

// 200: it may pass.
int status_of(const AccessRules& rules, const WebRequest& request) {
    const auto refused = refusal(rules, request);
    return refused ? refused->status : 200;
}

TEST(Access, PassesItsOwnPageByEveryNameOfTheServer) {
    WebRequest request = asked("GET", "/");
    for (const char* host : {"127.0.0.1:7530", "localhost:7530", "LocalHost:7530"}) {
        request.host = host;
        EXPECT_EQ(status_of(rules_with(""), request), 200) << host;
    }
    EXPECT_EQ(status_of(rules_with(""), post_of_own_page()), 200);
}

TEST(Access, RefusesAForeignNameThatLeadsHere) {
    WebRequest request = asked("GET", "/");
    for (const char* host : {"", "evil.example:7530", "127.0.0.1", "127.0.0.1:7531", "localhost",
                             "127.0.0.1:7530.evil.example", "LOCALHOST.evil:7530"}) {
        request.host = host;
        EXPECT_EQ(status_of(rules_with(""), request), 403) << host;
    }
}

TEST(Access, TakesAnAddressOfTheSixthVersionInBrackets) {
    WebRequest request = asked("GET", "/");
    request.local_address = "::1";
    request.host = "[::1]:7530";
    EXPECT_EQ(status_of(rules_with(""), request), 200);
}

TEST(Access, RefusesAPostWithoutTheTokenOfThePage) {
    WebRequest request = post_of_own_page();
    for (const char* token : {"", "9a1d", "9a1", "9a1cc"}) {
        request.action_token = token;
        EXPECT_EQ(status_of(rules_with(""), request), 403) << token;
    }
}

TEST(Access, RefusesAPostOfAnotherSiteEvenWithTheToken) {
    for (const char* origin : {"http://evil.example", "null", "https://127.0.0.1:7530",
                               "http://127.0.0.1:7531", "http://127.0.0.1:7530.evil.example"}) {
        WebRequest request = post_of_own_page();
        request.origin = origin;
        EXPECT_EQ(status_of(rules_with(""), request), 403) << origin;
    }
    for (const char* site : {"cross-site", "same-site"}) {
        WebRequest request = post_of_own_page();
        request.fetch_site = site;
        EXPECT_EQ(status_of(rules_with(""), request), 403) << site;
    }
}

TEST(Access, RefusesAPictureThatAnotherSiteShows) {
    WebRequest request = asked("GET", "/api/live.mjpg");
    request.fetch_site = "cross-site";
    EXPECT_EQ(status_of(rules_with(""), request), 403);
}

TEST(Access, HasNoOtherMethods) {
    for (const char* method : {"HEAD", "PUT", "DELETE", "OPTIONS", "TRACE"})
        EXPECT_EQ(status_of(rules_with(""), asked(method, "/")), 405) << method;
}

TEST(Access, WantsTheTokenInAnAuthorizationOrACookieWhereOneIsSet) {
    WebRequest request = asked("GET", "/");
    EXPECT_EQ(status_of(rules_with(secret), request), 401);
    request.authorization = "Bearer 4f6b";
    EXPECT_EQ(status_of(rules_with(secret), request), 200);
    for (const char* wrong : {"Bearer 4f6c", "Bearer", "Bearer ", "4f6b", "Basic 4f6b"}) {
        request.authorization = wrong;
        EXPECT_EQ(status_of(rules_with(secret), request), 401) << wrong;
    }
    request.authorization.clear();
    request.cookie = "a=b; etalon_7530=4f6b";
    EXPECT_EQ(status_of(rules_with(secret), request), 200);
    for (const char* wrong : {"etalon_7530=4f6", "etalon_7531=4f6b", "etalon_7530="}) {
        request.cookie = wrong;
        EXPECT_EQ(status_of(rules_with(secret), request), 401) << wrong;
    }
}

TEST(Access, TheLinkWithTheTokenBecomesACookieThatScriptsDoNotSee) {
    WebRequest request = asked("GET", "/");
    request.fields["token"] = secret;
    const auto reply = token_link(rules_with(secret), request);
    ASSERT_TRUE(reply);
    EXPECT_EQ(reply->status, 303);
    EXPECT_EQ(reply->headers[0].second, "/");
    EXPECT_THAT(
        reply->headers[1].second,
        AllOf(HasSubstr("etalon_7530=4f6b"), HasSubstr("HttpOnly"), HasSubstr("SameSite=Strict")));
    request.fields["token"] = "4f6c";
    EXPECT_FALSE(token_link(rules_with(secret), request));
    EXPECT_FALSE(token_link(rules_with(""), request)) << "where no token is set";
    request.fields["token"] = "";
    EXPECT_FALSE(token_link(rules_with(""), request));
}

TEST(Access, TokensAreLongAndNeverTheSame) {
    const std::string token = random_token();
    EXPECT_EQ(token.size(), 64u);
    EXPECT_NE(token, random_token());
    EXPECT_TRUE(is_same_secret(token, token));
    EXPECT_FALSE(is_same_secret("", "")) << "no secret is none";
}

}  // namespace
}  // namespace etalon
