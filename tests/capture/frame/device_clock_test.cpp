#include "capture/frame/camera.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(DeviceClock, MapsAStampWithTheUncertaintyOfItsReading) {
    DeviceClock clock;
    EXPECT_FALSE(clock.known());
    clock.read(5'000'000'000, {Instant(70s), Instant(70s + 4ms)});
    const TimeWindow same = clock.station_time(5'000'000'000);
    EXPECT_EQ(same.middle(), Instant(70s + 2ms));
    EXPECT_EQ(same.half_width(), 2ms);
    const TimeWindow later = clock.station_time(5'000'000'000 + 10'000'000'000);
    EXPECT_EQ(later.middle(), Instant(80s + 2ms));
    EXPECT_EQ(later.half_width(), 4ms);  // + 200 ppm of 10 s
    const TimeWindow before = clock.station_time(4'000'000'000);
    EXPECT_EQ(before.earliest, Instant(69s - 200us));
    EXPECT_EQ(before.latest, Instant(69s + 4ms + 200us));
    clock.forget();
    EXPECT_FALSE(clock.known());
}

TEST(DeviceClock, GoesOnAcrossAWrapOfItsCounter) {
    DeviceClock clock;
    clock.read(~0ull - 999'999, {Instant(7s), Instant(7s)});
    EXPECT_EQ(clock.station_time(4'000'000).middle(), Instant(7s + 5ms));
}

TEST(TimeWindow, IsEmptyWhereTwoContradictEachOther) {
    const TimeWindow a{Instant(1s), Instant(5s)}, b{Instant(3s), Instant(9s)};
    EXPECT_EQ(intersection(a, b).earliest, Instant(3s));
    EXPECT_EQ(intersection(a, b).latest, Instant(5s));
    EXPECT_FALSE(intersection(a, b).empty());
    EXPECT_TRUE(intersection(a, {Instant(6s), Instant(7s)}).empty());
}

}  // namespace
}  // namespace etalon
