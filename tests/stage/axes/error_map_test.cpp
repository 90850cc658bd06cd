#include "stage/axes/error_map.h"

#include "core/geometry/units.h"
#include "tests/test.h"

namespace etalon {
namespace {

ErrorMap map_of(const std::filesystem::path& file, bool rotary) {
    const StrictFile yaml(file, "test/1");
    ErrorMap map = read_error_map(yaml.root().at("map"), rotary);
    yaml.finish();
    return map;
}

std::string table_error(const std::string& table) {
    return config_error_of([&] {
        const auto file =
            StrictFile::from_text("etalon: test/1\nmap: " + table + "\n", "m.yml", "test/1");
        read_error_map(file.root().at("map"), false);
    });
}

// By hand: 1/4 of the way from (10, 2) to (30, -6) the error is 0; the uncertainty 3 to 7 gives 4.
TEST(ErrorMap, InterpolatesErrorAndUncertaintyLinearly) {
    const ErrorMap map({{-5, 1, 3}, {10, 2, 3}, {30, -6, 7}}, {"test"});
    EXPECT_DOUBLE_EQ(map.at(15)->error, 0.0);
    EXPECT_DOUBLE_EQ(map.at(15)->uncertainty, 4.0);
    EXPECT_DOUBLE_EQ(map.at(1)->error, 1.4);
    EXPECT_DOUBLE_EQ(map.at(-5)->error, 1.0);
    EXPECT_DOUBLE_EQ(map.at(10)->error, 2.0);
    EXPECT_DOUBLE_EQ(map.at(30)->error, -6.0);
}

TEST(ErrorMap, SaysNothingOutside) {
    const ErrorMap map({{-5, 1, 3}, {30, -6, 7}}, {"test"});
    EXPECT_FALSE(map.at(-5.036));
    EXPECT_FALSE(map.at(30.036));
    EXPECT_FALSE(map.at(std::nan("")));
    // At rest at its end an axis reads a little beyond it.
    EXPECT_DOUBLE_EQ(map.at(-5.034)->error, 1.0);
    EXPECT_DOUBLE_EQ(map.at(30.034)->error, -6.0);
}

TEST(ErrorMap, IsReadFromATableBesideTheFile) {
    const TemporaryFolder folder;
    write_text(folder / "s.yml", "etalon: test/1\nmap: {file: x.csv}\n");
    write_text(folder / "x.csv", "position_mm,error_um,uncertainty_um\r\n-7,5,0.5\r\n3,-2,0.7\n\n");
    const ErrorMap x = map_of(folder / "s.yml", false);
    ASSERT_EQ(x.points().size(), 2u);
    EXPECT_EQ(x.points()[1].position, 3.0);
    EXPECT_DOUBLE_EQ(x.points()[1].error, -2e-3);
    EXPECT_DOUBLE_EQ(x.points()[1].uncertainty, 0.7e-3);
    write_text(folder / "x.csv", "position_deg,error_deg,uncertainty_deg\n-7,0.5,0.05\n3,-2,0.7\n");
    const ErrorMap rz = map_of(folder / "s.yml", true);
    EXPECT_DOUBLE_EQ(rz.points()[0].position, -7 * rad_per_deg);
    EXPECT_DOUBLE_EQ(rz.points()[0].error, 0.5 * rad_per_deg);
}

TEST(ErrorMap, NamesThePlaceOfEveryFault) {
    EXPECT_EQ(table_error("[[1, 2, 3]]"), "m.yml:2: map: an error map needs at least two points");
    EXPECT_EQ(table_error("[[1, 2, 3], [1, 2, 3]]"),
              "m.yml:2: map: the positions of an error map must rise, but point 2 does not");
    EXPECT_EQ(table_error("[[1, 2, 3], [2, 2, -3]]"),
              "m.yml:2: map[1]: the standard uncertainty -3 is negative");
    const TemporaryFolder folder;
    write_text(folder / "s.yml", "etalon: test/1\nmap: {file: x.csv}\n");
    const auto error = [&](const std::string& table) {
        write_text(folder / "x.csv", table);
        return config_error_of([&] { map_of(folder / "s.yml", false); })
            .substr((folder / "x.csv").string().size());
    };
    EXPECT_EQ(error("position_deg,error_deg,uncertainty_deg\n1,2,3\n2,3,4\n"),
              ":1: the first line must be 'position_mm,error_um,uncertainty_um'");
    const std::string header = "position_mm,error_um,uncertainty_um\n";
    EXPECT_EQ(error(header + "1,2,3\n2,3\n"), ":3: has 2 cells, not the header's 3");
    EXPECT_EQ(error(header + "1,2,3\n2,x,4\n"), ":3: 'x' is not a finite number");
    EXPECT_EQ(error(header + "1,2,3\n2,3,-4\n"), ":3: the standard uncertainty -4 is negative");
}

}  // namespace
}  // namespace etalon
