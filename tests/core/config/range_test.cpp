#include "core/config/strict_reader.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <limits>

#include "core/file/text.h"
#include "tests/paths.h"

namespace etalon {
namespace {

TEST(Range, KnowsItsBoundsAndSaysThem) {
    EXPECT_TRUE(units::um.positive().contains(1e-3));
    EXPECT_FALSE(units::um.positive().contains(0.9e-3));
    EXPECT_FALSE(units::um.positive().contains(1.1e6));
    EXPECT_TRUE(units::deg.either_sign().contains(-1e5));
    EXPECT_FALSE(units::deg.either_sign().contains(-1.1e5));
    EXPECT_TRUE(units::s.non_negative().contains(0.0));
    EXPECT_FALSE(units::s.non_negative().contains(-1e-9));
    EXPECT_FALSE(any_number.contains(std::numeric_limits<double>::quiet_NaN()));
    EXPECT_EQ(units::um.positive().words(), "between 0.001 and 1000000 um");
    EXPECT_EQ(units::one.non_negative().words(), "between 0 and 1000000000000");
    EXPECT_EQ(positive.words(), "greater than 0");
}

// Of no unit could a quotient of two numbers, or the square of one, overflow a double.
TEST(Range, IsPhysicalForEveryUnit) {
    for (const Unit& unit : units::all) {
        EXPECT_GT(unit.least, 0.0) << unit.name;
        EXPECT_LT(unit.least, unit.most) << unit.name;
        EXPECT_LE(unit.most / unit.least, 1e24) << unit.name;
        EXPECT_EQ(&unit_named(unit.name), &unit);
    }
}

TEST(Range, StandsInTheDocuments) {
    const std::string document =
        read_text(std::filesystem::path(ETALON_SOURCE_DIR) / "docs/files.md");
    for (const Unit& unit : units::all)
        EXPECT_THAT(document, testing::HasSubstr(fmt::format("| {} | {} | {} |", unit.name,
                                                             unit.least, unit.most)));
}

}  // namespace
}  // namespace etalon
