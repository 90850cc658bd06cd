#include "core/time/clock.h"

#include "core/time/progress.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

using std::chrono::seconds;

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

// ---- progress

// What a run of 20 steps of 2 s each shows.
std::string shown(const TemporaryFolder& folder, bool is_terminal) {
    const auto path = folder / "progress.txt";
    std::FILE* file = std::fopen(path.c_str(), "w");
    VirtualClock clock;
    {
        Progress progress(file, is_terminal, clock);
        progress.begin("measuring", 20, seconds(100));
        for (int i = 0; i < 20; ++i) {
            clock.advance(seconds(2));
            progress.step();
        }
        progress.step();  // more than were announced: shown no more
        progress.begin("guessing", 10);
        for (int i = 0; i < 3; ++i) {
            clock.advance(seconds(7));
            progress.step();
        }
    }
    std::fclose(file);
    return read_text(path);
}

// The time left is as expected at first, 18/20 of 100 s, and then as measured, 16 times 2 s.
TEST(Progress, IsAPlainLineForEachTenthWhereThereIsNoTerminal) {
    const TemporaryFolder folder;
    const std::vector<std::string> lines = split(shown(folder, false), '\n');
    ASSERT_EQ(lines.size(),
              16u);  // the beginnings, their tenths, and what follows the last newline
    EXPECT_EQ(lines[0], "measuring: 0 of 20, 1:40 min left");
    EXPECT_EQ(lines[1], "measuring: 2 of 20, 1:30 min left");
    EXPECT_EQ(lines[2], "measuring: 4 of 20, 32 s left");
    EXPECT_EQ(lines[5], "measuring: 10 of 20, 20 s left");
    EXPECT_EQ(lines[10], "measuring: 20 of 20, 0 s left");
    // Where nobody knows what it takes: nothing, until three steps have shown it.
    EXPECT_EQ(lines[11], "guessing: 0 of 10");
    EXPECT_EQ(lines[13], "guessing: 2 of 10");
    EXPECT_EQ(lines[14], "guessing: 3 of 10, 49 s left");
}

TEST(Progress, IsOneLineOfAtMost79ColumnsOnATerminal) {
    const TemporaryFolder folder;
    const std::string text = shown(folder, true);
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 2) << "one for each phase";
    for (const std::string& drawn : split(text, '\r'))
        EXPECT_LE(trimmed(drawn).size(), 79u) << drawn;
    EXPECT_LE(Progress::line("analysing and more", 123456, 234567, seconds(360000), true).size(),
              79u);
}

TEST(Progress, WritesDurationsForPeople) {
    EXPECT_EQ(duration_text(seconds(42)), "42 s");
    EXPECT_EQ(duration_text(seconds(187)), "3:07 min");
    EXPECT_EQ(duration_text(seconds(3725)), "1:02 h");
}

}  // namespace
}  // namespace etalon
