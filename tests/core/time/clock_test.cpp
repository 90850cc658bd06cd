#include "core/time/clock.h"

#include <gtest/gtest.h>

#include <limits>

namespace etalon {
namespace {

using namespace std::chrono_literals;

TEST(VirtualClock, IsAtOnceAsLateAsWasWaitedFor) {
    VirtualClock clock;
    EXPECT_TRUE(clock.wait_for(7h, {}));
    EXPECT_EQ(clock.now(), Instant{} + 7h);
}

TEST(VirtualClock, StandsStillWhenTheWaitIsStopped) {
    VirtualClock clock;
    std::stop_source source;
    source.request_stop();
    EXPECT_FALSE(clock.wait_for(5s, source.get_token()));
    EXPECT_EQ(clock.now(), Instant{});
}

TEST(SteadyClock, ReturnsAtOnceFromAStoppedWait) {
    SteadyClock clock;
    std::stop_source source;
    source.request_stop();
    const Instant before = clock.now();
    EXPECT_FALSE(clock.wait_for(1h, source.get_token()));
    EXPECT_LT(clock.now() - before, 1min);
}

TEST(SteadyClock, ReachesTheInstantItWaitsFor) {
    SteadyClock clock;
    const Instant until = clock.now() + 3ms;
    EXPECT_TRUE(clock.wait_until(until, {}));
    EXPECT_GE(clock.now(), until);
}

TEST(Clock, DurationsNeverOverflow) {
    EXPECT_EQ(duration_of(-7.25), -std::chrono::milliseconds(7250));
    for (const double much : {1e300, std::numeric_limits<double>::infinity()}) {
        EXPECT_EQ(duration_of(much), std::chrono::seconds(1'000'000'000));
        EXPECT_EQ(duration_of(-much), -std::chrono::seconds(1'000'000'000));
    }
    EXPECT_EQ(duration_of(std::numeric_limits<double>::quiet_NaN()), Duration{});
}

}  // namespace
}  // namespace etalon
