#include "report/result_table.h"

#include <nlohmann/json.hpp>

#include "report/html.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "report/result_rows.h"
#include "tests/test.h"

namespace etalon {
namespace {

struct Blur {
    double sigma_px = 0.0;
};

struct Photo {
    std::string name;
    std::optional<double> rms_gray;
    std::size_t pixels = 0;
    bool is_used = true;
    std::optional<Blur> blur;
};

ResultTable photos() {
    ColumnsOf<Photo> columns = {{"photo", &Photo::name, "photograph"},
                                {"rms_gray", &Photo::rms_gray, "residual", "gray", "{:.2f}"},
                                {"pixels", &Photo::pixels},
                                {"", [](const Photo& photo) { return photo.pixels / 2; }, "half"},
                                {"used", &Photo::is_used, "used"}};
    const ColumnsOf<Blur> blur = {{"sigma_px", &Blur::sigma_px, "blur", "px", "{:.1f}"}};
    add_columns(columns, blur, &Photo::blur, "blur_");
    return table_of(columns, std::vector<Photo>{{"a, b.png", 1.0 / 3.0, 12, true, Blur{0.5}},
                                                {"c.png", std::nullopt, 7, false, {}}});
}

TEST(ResultTable, CsvHasTheColumnsWithAKey) {
    EXPECT_EQ(csv_of(photos()),
              "photo,rms_gray,pixels,used,blur_sigma_px\n"
              "\"a, b.png\",0.3333333333333333,12,1,0.5\n"
              "c.png,,7,0,\n");
    EXPECT_EQ(csv_of(photos(), "{:.2f}").find("\"a, b.png\",0.33,12,1,0.50"), 41u);
}

TEST(ResultTable, JsonHasKeysInTheirOrder) {
    EXPECT_EQ(json_rows(photos()).dump(),
              R"([{"photo":"a, b.png","rms_gray":0.3333333333333333,"pixels":12,"used":true,)"
              R"("blur_sigma_px":0.5},)"
              R"({"photo":"c.png","rms_gray":null,"pixels":7,"used":false,"blur_sigma_px":null}])");
    const ColumnsOf<Photo> columns = {{"name", &Photo::name}, {"rms_gray", &Photo::rms_gray}};
    EXPECT_EQ(json_object(columns, Photo{"a"}, MissingFigure::left_out).dump(), R"({"name":"a"})");
}

TEST(ResultTable, TextIsAlignedByColumns) {
    EXPECT_EQ(text_table(photos()),
              "photograph  residual  half  used  blur\n"
              "                gray                px\n"
              "a, b.png        0.33     6  yes    0.5\n"
              "c.png              -     3  no       -\n");
}

TEST(ResultTable, TextLeavesOutWhatIsForPages) {
    EXPECT_EQ(text_table(photos(), {"half", "used", "blur"}),
              "photograph  residual\n"
              "                gray\n"
              "a, b.png        0.33\n"
              "c.png              -\n");
}

TEST(ResultTable, TextFitsATerminal) {
    const ResultTable table =
        table_of(ColumnsOf<std::string>{{"", [](const std::string& text) { return text; }, "name"},
                                        {"", [](const std::string&) { return 1; }, "count"}},
                 std::vector<std::string>{std::string(100, 'x')});
    EXPECT_EQ(text_table(table), "name" + std::string(71, ' ') + "count\n" + std::string(73, 'x') +
                                     std::string(6, ' ') + "1\n");
}

TEST(ResultTable, PagesShowUnitsBehindHeadingsAndDashes) {
    HtmlPage page("", "");
    page.add_table(photos());
    EXPECT_NE(page.finish().find("<th class=\"n\">residual / gray</th>"), std::string::npos);
    EXPECT_NE(page.finish().find(">–</td>"), std::string::npos);
    EXPECT_EQ(cell_text(std::numeric_limits<double>::infinity(), {}), "–");
}

TEST(ResultTable, PosesHaveSixColumns) {
    ColumnsOf<Rigid> columns;
    add_columns(
        columns, columns_of_pose(), [](const Rigid& pose) { return &pose; }, "refined_");
    const Rigid pose = rigid_from_vector((Vector6d() << 0.5, 0, 0, 1, 2, 3).finished());
    EXPECT_EQ(csv_of(table_of(columns, std::vector<Rigid>{pose})),
              "refined_rx,refined_ry,refined_rz,refined_tx,refined_ty,refined_tz\n0.5,0,0,1,2,3\n");
}

// ---- result rows

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

// ---- json text

std::filesystem::path written(const TemporaryFolder& folder, const std::string& text) {
    std::ofstream(folder / "file.json") << text;
    return folder / "file.json";
}

std::string lists(std::size_t depth) {
    return std::string(depth, '[') + std::string(depth, ']');
}

TEST(JsonText, IsReadBackWithItsKeysInTheirOrder) {
    const TemporaryFolder folder;
    const std::string text = R"({"b":1,"a":[2.5,null]})";
    EXPECT_EQ(text_of(read_json(written(folder, text)), -1), text);
    EXPECT_TRUE(read_json(written(folder, "{\"b\":")).is_discarded());
}

// 200 000 lists in each other took all of the stack when they were written again.
TEST(JsonText, IsRefusedWhereItIsDeeperThanTheStack) {
    const TemporaryFolder folder;
    EXPECT_TRUE(read_json(written(folder, lists(50))).is_array());
    EXPECT_THROW(read_json(written(folder, lists(52))), ConfigError);
    EXPECT_THROW(read_json(written(folder, lists(200'000))), ConfigError);
}

// ---- number text

TEST(NumberText, HasTheDigitsThatAreAskedFor) {
    EXPECT_EQ(fixed(2.7182, 2), "2.72");
    EXPECT_EQ(significant(271.82, 2), "2.7e+02");
    EXPECT_EQ(significant(0.027182, 3), "0.0272");
}

TEST(NumberText, ShowsADashWhereNothingIsKnown) {
    EXPECT_EQ(fixed(std::nullopt, 2), "–");
    EXPECT_EQ(fixed(std::nullopt, 2, "-"), "-");
    EXPECT_EQ(fixed(std::optional(0.5), 3), "0.500");
    EXPECT_EQ(significant(std::numeric_limits<double>::quiet_NaN(), 3), "–");
    EXPECT_EQ(significant(std::optional<double>(), 3, "unknown"), "unknown");
}

TEST(NumberText, CountsOneAndMany) {
    EXPECT_EQ(counted(1, "photograph"), "1 photograph");
    EXPECT_EQ(counted(7, "photograph"), "7 photographs");
    EXPECT_EQ(counted(2, "quantity", "quantities"), "2 quantities");
}

TEST(NumberText, SaysOfAValueLostInNoiseWhatItIsBelow) {
    EXPECT_EQ(value_or_below(0.0, 0.0371, 4), "below 0.037");
    EXPECT_EQ(value_or_below(0.013, 0.0371, 2), "0.013");
    EXPECT_EQ(value_or_below(0.0, 0.0, 2), "0");
}

TEST(NumberText, SaysProbabilitiesInPercent) {
    EXPECT_EQ(probability_text(0.02275), "2.3 %");
    EXPECT_EQ(probability_text(0.5), "50 %");
    EXPECT_EQ(probability_text(0.97725), "97.72 %");
    EXPECT_EQ(probability_text(3e-5), "< 0.01 %");
    EXPECT_EQ(probability_text(0.99995), "> 99.99 %");
}

}  // namespace
}  // namespace etalon
