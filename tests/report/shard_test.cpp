#include "report/result_rows.h"

#include <gtest/gtest.h>

#include "core/program/errors.h"

namespace etalon {
namespace {

TEST(Shard, IsEveryNthUnit) {
    const Shard shard = parse_shard("2/5");
    std::size_t count = 0;
    for (std::size_t unit = 0; unit < 13; ++unit)
        count += shard.holds(unit);
    EXPECT_EQ(count, 3u);  // 1, 6, 11
    EXPECT_EQ(shard.units(13), 3u);
    EXPECT_EQ(parse_shard("4/5").units(13), 2u);
    EXPECT_TRUE(parse_shard("").is_all());
    for (const char* text : {"0/5", "6/5", "2", "2/", "a/b", "1/2/3", "1/1000001"})
        EXPECT_THROW(parse_shard(text), ConfigError) << text;
}

}  // namespace
}  // namespace etalon
