#include "report/result_table.h"

#include <nlohmann/json.hpp>

#include "report/html.h"
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

}  // namespace
}  // namespace etalon
