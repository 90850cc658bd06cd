#include "report/result_rows.h"

#include "tests/test.h"

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

constexpr ShardedWork work{"study", "pose", "study merge", "study.json"};

RowsDescription rows_of(const std::string& shard, std::size_t units) {
    return {work, R"({"shard": )" + shard + "}", "pose,error\n", units};
}

TEST(RowRecord, AFullDiskIsADiskErrorAndKeepsTheWholeRows) {
    const TemporaryFolder folder;
    const std::string row = "0," + std::string(100, '7') + "\n";
    {
        RowRecord record(folder / "out", rows_of("[1, 1]", 2));
        record.add(row);
        const FileSizeLimit limit(150);
        EXPECT_THROW(record.add(row), DiskError);
    }
    const RowRecord again(folder / "out", rows_of("[1, 1]", 2));
    EXPECT_EQ(again.units_done(), 1u);
    EXPECT_EQ(read_text(folder / "out" / "results.csv"), "pose,error\n" + row);
}

TEST(RowRecord, MergingOntoAFullDiskIsADiskError) {
    const TemporaryFolder folder;
    RowRecord(folder / "a", rows_of("[1, 2]", 1)).add("0,0.25\n");
    RowRecord(folder / "b", rows_of("[2, 2]", 1)).add("1,0.75\n");
    const std::vector<std::filesystem::path> shards{folder / "a", folder / "b"};
    {
        const FileSizeLimit limit(20);  // the description and the header have room, two rows not
        EXPECT_THROW(merge_rows(shards, rows_of("[1, 1]", 2), folder / "whole"), DiskError);
    }
    merge_rows(shards, rows_of("[1, 1]", 2), folder / "whole");
    EXPECT_EQ(read_text(folder / "whole" / "results.csv"), "pose,error\n0,0.25\n1,0.75\n");
}

}  // namespace
}  // namespace etalon
