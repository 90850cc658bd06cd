// `etalon demo`: the twin goes whenever and however the run goes. What the run itself gives is
// shown by ./demo.sh in continuous integration.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <sys/socket.h>

#include "core/file/text.h"
#include "tests/loopback/program.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

// A connection to the stage of the demo's twin.
class StageConnection {
public:
    StageConnection() : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(1502);
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        is_open_ =
            connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    }
    ~StageConnection() { close(socket_); }
    StageConnection(const StageConnection&) = delete;
    StageConnection& operator=(const StageConnection&) = delete;

    bool is_open() const { return is_open_; }
    // Blocks until the other end closes, as the kernel does for a process that has ended.
    bool is_closed_by_the_stage() const {
        char byte = 0;
        return recv(socket_, &byte, 1, 0) <= 0;
    }

private:
    int socket_;
    bool is_open_ = false;
};

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
    EXPECT_FALSE(StageConnection().is_open());
}

TEST_F(Demo, EndsTheTwinAfterASignalAndKeepsTheRecord) {
    for (const int signal : {SIGINT, SIGTERM}) {
        std::filesystem::remove_all(record());
        Program demo("etalon", {"demo", "--out", record()});
        EXPECT_THAT(demo.line(), StartsWith("twin ready"));
        const std::string begun = demo.line();
        EXPECT_TRUE(StageConnection().is_open()) << begun;
        demo.send(signal);
        demo.rest();
        EXPECT_EQ(demo.exit_code(), 130);
        EXPECT_TRUE(std::filesystem::exists(record() + "/events.jsonl"));
        EXPECT_FALSE(StageConnection().is_open());
    }
}

TEST_F(Demo, TakesTheTwinAlongWhenItIsKilled) {
    Program demo("etalon", {"demo", "--out", record()});
    EXPECT_THAT(demo.line(), StartsWith("twin ready"));
    const StageConnection stage;
    ASSERT_TRUE(stage.is_open());
    demo.send(SIGKILL);
    EXPECT_TRUE(stage.is_closed_by_the_stage());
}

TEST_F(Demo, PassesArgumentsToTheTwinAndEndsWithItsExitCode) {
    Program demo("etalon", {"demo", "--out", record(), "--", "--sed", "3"});
    EXPECT_THAT(demo.rest(), HasSubstr("--sed"));
    EXPECT_EQ(demo.exit_code(), 3);
    EXPECT_FALSE(std::filesystem::exists(record()));
}

}  // namespace
}  // namespace etalon
