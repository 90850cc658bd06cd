#include "core/config/strict_reader.h"

#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {
namespace {

StrictFile open(const std::string& body) {
    return StrictFile::from_text("etalon: test/1\n" + body, "test.yml", "test/1");
}

TEST(StrictReader, ReadsNumbersTextsListsAndNesting) {
    const StrictFile file = open("a: {b: -7.5, c: word}\nlist: [5, 7, 11]\n");
    EXPECT_EQ(file.root().at("a").at("b").number(any_number), -7.5);
    EXPECT_EQ(file.root().at("a").at("c").text(), "word");
    EXPECT_EQ(file.root().at("list").numbers(3, any_number), (std::vector<double>{5, 7, 11}));
    file.finish();
}

TEST(StrictReader, ReadsJsonToo) {
    const auto file =
        StrictFile::from_text(R"({"etalon": "test/1", "a": {"b": 7}})", "t.json", "test/1");
    EXPECT_EQ(file.root().at("a").at("b").number(any_number), 7.0);
    file.finish();
}

TEST(StrictReader, NamesFileLineAndKeyOfEveryFault) {
    const auto at = [](const std::string& body, auto read) {
        return config_error_of([&] {
            const StrictFile file = open(body);
            read(file.root());
            file.finish();
        });
    };
    const auto number = [](const Value& root) { root.at("a").at("fx").number(positive); };
    EXPECT_EQ(at("a:\n  fy: 1\n", number), "test.yml:3: a.fx: missing");
    EXPECT_EQ(at("a:\n  fx: .nan\n", number),
              "test.yml:3: a.fx: must be a finite number, not '.nan'");
    EXPECT_EQ(at("a:\n  fx: 0\n", number), "test.yml:3: a.fx: must be greater than 0, not 0");
    EXPECT_EQ(at("a:\n  fx: \"5\"\n", number), "test.yml:3: a.fx: must be a number");
    EXPECT_EQ(at("a:\n  fx: 5\n  fz: 6\n", number),
              "test.yml:4: a.fz: unknown key; did you mean 'fx'?");
    EXPECT_EQ(at("a:\n  fx: 5\n  fx: 6\n", number),
              "test.yml:4: a.fx: doubled key, first given in line 3");
}

TEST(StrictReader, AnUnreadSectionIsAnUnknownKey) {
    const StrictFile file = open("a: 1\nextra: {b: 2}\n");
    file.root().at("a").number(any_number);
    EXPECT_EQ(config_error_of([&] { file.finish(); }), "test.yml:3: extra: unknown key");
}

TEST(StrictReader, KeysInsideListsAreCheckedOneByOne) {
    const StrictFile file = open("axes:\n  - {name: x}\n  - {name: y, nome: z}\n");
    for (const Value& axis : file.root().at("axes").items())
        axis.at("name").text();
    EXPECT_EQ(config_error_of([&] { file.finish(); }),
              "test.yml:4: axes[1].nome: unknown key; did you mean 'name'?");
}

TEST(StrictReader, RefusesAnotherKindAndBrokenYaml) {
    EXPECT_EQ(
        config_error_of([] { StrictFile::from_text("etalon: camera/1\n", "c.yml", "test/1"); }),
        "c.yml:1: etalon: must be 'test/1', not 'camera/1'");
    EXPECT_NE(config_error_of([] { StrictFile::from_text("etalon: [", "c.yml", "test/1"); }),
              "no error");
    EXPECT_NE(config_error_of([] { StrictFile::from_text("", "c.yml", "test/1"); }), "no error");
    EXPECT_NE(config_error_of([] { StrictFile::from_text("- a\n", "c.yml", "test/1"); }),
              "no error");
}

TEST(StrictReader, RefusesAliasesOfThemselvesAndTextBehindTheDocument) {
    EXPECT_EQ(config_error_of([] { open("id: &a [*a]\n"); }),
              "test.yml:2: an alias of the value that it is part of");
    EXPECT_NE(config_error_of([] { open("a: 1\n--- {a: 2}\n"); }), "no error");
}

// A reader of all keys of a mapping looks each of them up; every value carries its path.
TEST(StrictReader, LimitsKeysByNumberAndLength) {
    std::string keys = "a:\n";
    for (int i = 0; i < 1000; ++i)
        keys += "  k" + std::to_string(i) + ": 7\n";
    open(keys);
    EXPECT_EQ(config_error_of([&] { open(keys + "  last: 7\n"); }),
              "test.yml:3: a: has more than 1000 keys");
    open(std::string(200, 'k') + ": 7\n");
    EXPECT_EQ(config_error_of([] { open(std::string(201, 'k') + ": 7\n"); }),
              "test.yml:2: a key must be a word");
}

TEST(StrictReader, RefusesWholeNumbersThatAreNotAndWordsThatAreNotAllowed) {
    const StrictFile file = open("n: 2.5\nw: left\n");
    EXPECT_EQ(config_error_of([&] { file.root().at("n").integer(0, 9); }),
              "test.yml:2: n: must be a whole number, not 2.5");
    EXPECT_EQ(config_error_of([&] {
                  file.root().at("w").one_of({"up", "down"});
              }),
              "test.yml:3: w: must be one of up, down; not 'left'");
}

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
        EXPECT_THAT(document,
                    HasSubstr(fmt::format("| {} | {} | {} |", unit.name, unit.least, unit.most)));
}

}  // namespace
}  // namespace etalon
