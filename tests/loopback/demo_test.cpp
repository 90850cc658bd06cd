// `etalon demo`: the twin goes whenever and however the run goes. What the run itself gives is
// shown by ./demo.sh in continuous integration.

#include "tests/loopback/program.h"
#include "tests/loopback/tcp_connection.h"

namespace etalon {
namespace {

constexpr int stage_port = 1502;  // of the demo's twin

class Demo : public testing::Test {
protected:
    std::string record() const { return (folder_ / "record").string(); }
    TemporaryFolder folder_;
};

TEST_F(Demo, EndsTheTwinWhenTheRunCannotBegin) {
    std::filesystem::create_directory(record());
    write_text(record() + "/precious.txt", "mine");
    Program demo("etalon", {"demo", "--out", record()});
    EXPECT_THAT(demo.line(), StartsWith("twin ready: stage 127.0.0.1:1502, camera"));
    EXPECT_THAT(demo.rest(), HasSubstr(record()));
    EXPECT_EQ(demo.exit_code(), 3);
    EXPECT_FALSE(TcpConnection(stage_port).is_open());
}

TEST_F(Demo, EndsTheTwinAfterASignalAndKeepsTheRecord) {
    for (const int signal : {SIGINT, SIGTERM}) {
        std::filesystem::remove_all(record());
        Program demo("etalon", {"demo", "--out", record()});
        EXPECT_THAT(demo.line(), StartsWith("twin ready"));
        const std::string begun = demo.line();
        EXPECT_TRUE(TcpConnection(stage_port).is_open()) << begun;
        demo.send(signal);
        demo.rest();
        EXPECT_EQ(demo.exit_code(), 130);
        EXPECT_TRUE(std::filesystem::exists(record() + "/events.jsonl"));
        EXPECT_FALSE(TcpConnection(stage_port).is_open());
    }
}

TEST_F(Demo, TakesTheTwinAlongWhenItIsKilled) {
    Program demo("etalon", {"demo", "--out", record()});
    EXPECT_THAT(demo.line(), StartsWith("twin ready"));
    TcpConnection stage(stage_port);
    ASSERT_TRUE(stage.is_open());
    demo.send(SIGKILL);
    EXPECT_TRUE(stage.is_closed_within(std::chrono::minutes(1)));
}

TEST_F(Demo, PassesArgumentsToTheTwinAndEndsWithItsExitCode) {
    Program demo("etalon", {"demo", "--out", record(), "--", "--sed", "3"});
    EXPECT_THAT(demo.rest(), HasSubstr("--sed"));
    EXPECT_EQ(demo.exit_code(), 3);
    EXPECT_FALSE(std::filesystem::exists(record()));
}

}  // namespace
}  // namespace etalon
