#include "core/time/clock.h"

#include "tests/test.h"

namespace etalon {
namespace {

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

// From a table of Julian days: 2026-03-07 is 2461107, 1970-01-01 is 2440588 (both at noon).
TEST(CalendarDate, CountsDays) {
    EXPECT_EQ(days_of_date("1970-01-01"), 0);
    EXPECT_EQ(days_of_date("2026-03-07"), 2461107 - 2440588);
    EXPECT_EQ(*days_of_date("2024-03-01") - *days_of_date("2024-02-28"), 2);  // a leap year
    EXPECT_EQ(*days_of_date("2100-03-01") - *days_of_date("2100-02-28"), 1);  // none
}

TEST(CalendarDate, RefusesWhatIsNoDay) {
    for (const char* text : {"", "2026-02-30", "2026-13-01", "2026-00-10", "26-03-07", "2026-3-7",
                             "2026/03/07", "2026-03-07T10", "+026-03-07", "2026-03- 7"})
        EXPECT_FALSE(days_of_date(text)) << text;
}

TEST(CalendarDate, GivesTheDayThatItCounted) {
    for (const char* text : {"1969-12-31", "2026-03-07", "2024-02-29", "0001-01-01"})
        EXPECT_EQ(date_of_days(*days_of_date(text)), text);
}

}  // namespace
}  // namespace etalon
