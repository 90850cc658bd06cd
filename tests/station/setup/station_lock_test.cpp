#include "station/setup/station_lock.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include "tests/error_text.h"

namespace etalon {
namespace {

// A port of its own for each process, so that tests beside each other do not meet.
StageLink stage(int port_offset = 0) {
    StageLink link;
    link.address = TcpAddress{"192.0.2.1", 1 + (getpid() + port_offset) % 60000};
    return link;
}

TEST(StationLock, TellsASecondOneWhoHasTheFirst) {
    const StationLock first(stage(), "a qualification by Anna");
    EXPECT_THAT(config_error_of([] { StationLock second(stage(), "a motion by Bert"); }),
                testing::HasSubstr("is in use by a qualification by Anna"));
}

TEST(StationLock, IsForOneStageAndEndsWithItsHolder) {
    {
        const StationLock first(stage(), "a qualification by somebody with a long name");
        const StationLock other(stage(1), "a motion");
    }
    const StationLock again(stage(), "short");
    EXPECT_THAT(config_error_of([] { StationLock second(stage(), "x"); }),
                testing::EndsWith("is in use by short"));
}

// However its address is spelled.
TEST(StationLock, IsOneForAStageWithTwoNames) {
    const auto at = [](const std::string& host) {
        StageLink link;
        link.address = TcpAddress{host, 1 + getpid() % 60000};
        return link;
    };
    const StationLock first(at("127.0.0.1"), "a motion");
    for (const char* host : {"localhost", "127.1"})
        EXPECT_THAT(config_error_of([&] { StationLock second(at(host), "x"); }),
                    testing::HasSubstr("is in use by a motion"))
            << host;
}

TEST(StationLock, HolderIsNamed) {
    EXPECT_THAT(stage_holder("homing", "Carl"), testing::StartsWith("homing by Carl since "));
    EXPECT_THAT(stage_holder("homing", "Carl"),
                testing::EndsWith("process " + std::to_string(getpid())));
}

}  // namespace
}  // namespace etalon
