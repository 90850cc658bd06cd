#include "core/time/progress.h"

#include "tests/station/stations.h"

namespace etalon {
namespace {

using std::chrono::seconds;

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
    }
    std::fclose(file);
    return read_text(path);
}

// The time left is as expected at first, 18/20 of 100 s, and then as measured, 16 times 2 s.
TEST(Progress, IsAPlainLineForEachTenthWhereThereIsNoTerminal) {
    const TemporaryFolder folder;
    const std::vector<std::string> lines = split(shown(folder, false), '\n');
    ASSERT_EQ(lines.size(), 12u);  // the beginning, ten tenths, and what follows the last newline
    EXPECT_EQ(lines[0], "measuring: 0 of 20, 1:40 min left");
    EXPECT_EQ(lines[1], "measuring: 2 of 20, 1:30 min left");
    EXPECT_EQ(lines[2], "measuring: 4 of 20, 32 s left");
    EXPECT_EQ(lines[5], "measuring: 10 of 20, 20 s left");
    EXPECT_EQ(lines[10], "measuring: 20 of 20, 0 s left");
}

TEST(Progress, IsOneLineOfAtMost79ColumnsOnATerminal) {
    const TemporaryFolder folder;
    const std::string text = shown(folder, true);
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1);
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
