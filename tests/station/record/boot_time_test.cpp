#include "station/record/qualify_result.h"

#include <gtest/gtest.h>

namespace etalon {
namespace {

TEST(BootTime, RisesAndKnowsItsBoot) {
    const BootTime before = boot_time(), after = boot_time();
    EXPECT_FALSE(before.boot.empty());
    EXPECT_GT(before.seconds, 0.0);
    EXPECT_GE(seconds_between(before, after).value(), 0.0);
    EXPECT_LT(seconds_between(before, after).value(), 60.0);
}

TEST(BootTime, IsComparedWithinOneBootAlone) {
    EXPECT_EQ(seconds_between({"a", 70.0}, {"a", 3675.5}), 3605.5);
    EXPECT_FALSE(seconds_between({"a", 70.0}, {"b", 3675.5}));
    EXPECT_FALSE(seconds_between({"", 70.0}, {"", 3675.5}));
}

}  // namespace
}  // namespace etalon
