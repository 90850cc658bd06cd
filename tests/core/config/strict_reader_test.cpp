#include "core/config/strict_reader.h"

#include <yaml-cpp/yaml.h>

#include <nlohmann/json.hpp>

#include "core/config/csv_file.h"
#include "core/config/file_schema.h"
#include "core/config/json_entry.h"
#include "core/config/yaml_text.h"
#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {
namespace {

using nlohmann::json;

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

TEST(StrictReader, KnowsDecimalCommasTabsAndAMissingFirstLine) {
    const auto number = [](const std::string& body) {
        return config_error_of([&] {
            const StrictFile file = open(body);
            file.root().at("a").at("fx").number(positive);
            file.finish();
        });
    };
    EXPECT_EQ(number("a:\n  fx: 275,5\n"),
              "test.yml:3: a.fx: must be a finite number, not '275,5'; a decimal point is a dot: "
              "275.5");
    EXPECT_EQ(number("a: {fx: 275,5}\n"), "test.yml:2: a.5: unknown key; a decimal point is a dot");
    EXPECT_EQ(config_error_of([] { open("a: [1,5, 2,5]\n").root().at("a").numbers(2, positive); }),
              "test.yml:2: a: must have 2 numbers, not 4; a decimal point is a dot");
    EXPECT_EQ(number("a:\n\tfx: 7\n"), "test.yml:3: is indented by a tab: YAML takes spaces");
    EXPECT_EQ(config_error_of([] { StrictFile::from_text("id: 5\n", "c.yml", "camera/1"); }),
              "c.yml:1: must begin with 'etalon: camera/1'");
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

TEST(StrictReader, RefusesNamesThatWouldForgeLines) {
    const auto refused = [](const std::string& text) {
        return config_error_of([&] { open("id: " + text).root().at("id").text(); });
    };
    EXPECT_EQ(
        refused("\"a\\nverdict PASS\""),
        "test.yml:2: id: must be a line of text: 'a\\nverdict PASS' holds a control character");
    // ESC, DEL, NEL, line separator, right-to-left override
    for (const char* control : {"\\e[2J", "\\x7f", "\\N", "\\L", "\\u202e"})
        EXPECT_THAT(refused("\"a" + std::string(control) + "\""),
                    AnyOf(HasSubstr("control character"), HasSubstr("is not UTF-8")));
    EXPECT_THAT(refused("|\n  a\n  verdict PASS\n"), HasSubstr("'a\\nverdict PASS'"));
    EXPECT_EQ(open("id: >\n  one\n  line\n").root().at("id").text(), "one line");
    EXPECT_EQ(open("id: \"µm ± 雪\"\n").root().at("id").text(), "µm ± 雪");
    EXPECT_EQ(config_error_of([] { open("\"a\\nb\": 1\n"); }), "test.yml:2: a key must be a word");
}

// Of records: what others wrote there is shown, on its line.
TEST(JsonEntry, GivesTextThatStaysOnItsLine) {
    const JsonEntry entry(R"({"serial": "7\ndue camera 8"})", {"run.json"});
    EXPECT_EQ(entry.at("serial").text(), R"(7\ndue camera 8)");
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

// ---- csv file

class CsvFileTest : public testing::Test {
protected:
    CsvFile read(const std::string& text, std::initializer_list<std::string_view> headers = {}) {
        std::ofstream(path_, std::ios::binary) << text;
        return read_csv(path_, headers);
    }

    // Behind the file's name.
    template <class Read>
    std::string error_of(Read read) {
        return config_error_of(read).substr(path_.string().size());
    }

    TemporaryFolder folder_;
    std::filesystem::path path_ = folder_ / "t.csv";
};

TEST_F(CsvFileTest, IsTheSameWithAByteOrderMarkCarriageReturnsAndEmptyLines) {
    const std::string plain = "b,a\n7,-5.5\n11,name\n";
    for (const std::string& text : {plain, "\xef\xbb\xbf" + plain,
                                    std::string("\xef\xbb\xbf"
                                                "b,a\r\n7,-5.5\r\n11,name\r\n"),
                                    std::string("b, a\n7,-5.5 \n11 ,name"),
                                    std::string("b,a\r\n7,-5.5\r\n\r\n11,name\r\n\r\n")}) {
        const CsvFile file = read(text, {"x", "b,a"});
        ASSERT_EQ(file.rows.size(), 2u);
        EXPECT_EQ(file.rows[0].numbers(), (std::vector<double>{7, -5.5}));
        EXPECT_EQ(file.rows[1].number(file.column("b")), 11.0);
        EXPECT_EQ(file.rows[1].cells[1], "name");
    }
    EXPECT_EQ(read("a\r\n\r\n\r\n3\r\n").rows[0].place.line, 4);
}

TEST_F(CsvFileTest, NamesTheLineOfWhatIsWrong) {
    EXPECT_EQ(error_of([&] {
                  read("", {"a,b", "c"});
              }),
              ":1: the first line must be 'a,b' or 'c', not ''");
    EXPECT_EQ(error_of([&] {
                  read(
                      "\xef\xbb\xbf"
                      "a;b\r\n1;2\n",
                      {"a,b"});
              }),
              ":1: the first line must be 'a,b', not 'a;b'");
    EXPECT_EQ(error_of([&] { read("a,b\n1,2\n\n1,2,3\n"); }),
              ":4: has 3 cells, not the header's 2; a decimal point is a dot");
    EXPECT_EQ(error_of([&] { read("photo\na\x1b[2J\n"); }), ":2: holds a control character");
    EXPECT_EQ(error_of([&] { read("a\n3\n").column("b"); }), ":1: the header lacks the column 'b'");
    EXPECT_EQ(error_of([&] { read("a\n3\nnan\n").rows[1].number(0); }),
              ":3: 'nan' is not a finite number");
    EXPECT_EQ(error_of([&] {
                  read("a\n-7\n").rows[0].number(0, {0.0, 5.0});
              }),
              ":2: -7 must be between 0 and 5");
}

TEST_F(CsvFileTest, RefusesWhatIsNoFileOrTooLarge) {
    EXPECT_EQ(error_of([&] { read_csv(path_); }), ": no such file");
    EXPECT_EQ(read("").header, std::vector<std::string>{""});
    std::filesystem::resize_file(path_, max_text_bytes + 1);
    EXPECT_EQ(error_of([&] { read_csv(path_); }), ": is larger than 64 MiB");
}

TEST(CsvReader, RefusesALineThatNeverEnds) {
    const TemporaryFolder folder;
    write_text(folder / "long.csv", "a,b\n1,2\n" + std::string(70'000, '7') + "\n");
    CsvReader reader(folder / "long.csv", {"a,b"});
    EXPECT_EQ(reader.next()->number(1), 2.0);
    EXPECT_THAT(config_error_of([&] { reader.next(); }),
                HasSubstr("long.csv:3: is longer than 64 KiB"));
}

// ---- yaml text

std::string error_of(const std::string& text) {
    return config_error_of([&] { parse_yaml(text, "t.yml"); });
}

std::string repeated(std::size_t count, const std::string& part) {
    std::string text;
    text.reserve(count * part.size());
    for (std::size_t i = 0; i < count; ++i)
        text += part;
    return text;
}

TEST(YamlText, FollowsAliasesOfCompleteValues) {
    const YAML::Node root = parse_yaml("a: &x [7, -5]\nb: [*x, *x, 3]\n", "t.yml");
    EXPECT_EQ(root["b"][1][1].as<int>(), -5);
    EXPECT_EQ(root["b"][2].as<int>(), 3);
}

TEST(YamlText, RefusesAliasesOfWhatTheyArePartOf) {
    EXPECT_EQ(error_of("id: 3\nloop: &a [*a]\n"),
              "t.yml:2: an alias of the value that it is part of");
    EXPECT_EQ(error_of("&a {id:\n  [7, {b: *a}]}\n"),
              "t.yml:2: an alias of the value that it is part of");
    EXPECT_THAT(error_of("a: &x [*y]\nb: &y [*x]\n"), StartsWith("t.yml:1: "));
}

// Ten levels of ten each would be ten thousand million values. The first five lists are 11, 111,
// ... 111111, together 123455; the sixth is ten times the fifth.
TEST(YamlText, CountsAliasesAsOftenAsTheyStand) {
    std::string text = "l0: &l0 [7, 7, 7, 7, 7, 7, 7, 7, 7, 7]\n";
    for (int i = 1; i < 10; ++i)
        text += "l" + std::to_string(i) + ": &l" + std::to_string(i) + " [" +
                repeated(9, "*l" + std::to_string(i - 1) + ", ") + "*l" + std::to_string(i - 1) +
                "]\n";
    EXPECT_EQ(error_of(text), "t.yml:6: has more than 200000 values by here");
}

TEST(YamlText, LimitsValuesAndTheirDepthExactly) {
    const auto list = [](std::size_t items) { return "[" + repeated(items, "1,") + "]"; };
    EXPECT_EQ(error_of(list(max_yaml_values - 1)), "no error");
    EXPECT_EQ(error_of(list(max_yaml_values)), "t.yml:1: has more than 200000 values by here");
    const auto nested = [](std::size_t levels) {
        return repeated(levels, "[") + "1" + repeated(levels, "]");
    };
    EXPECT_EQ(error_of(nested(max_yaml_depth)), "no error");
    EXPECT_EQ(error_of("#\n" + nested(max_yaml_depth + 1)),
              "t.yml:2: has more than 50 lists and mappings in each other");
}

// Aliases of aliases are as deep as what they stand for.
TEST(YamlText, LimitsTheDepthBehindAliases) {
    std::string text = "a0: &a0 [7]\n";
    for (int i = 1; i < 60; ++i)
        text += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [*a" +
                std::to_string(i - 1) + "]\n";
    EXPECT_EQ(error_of(text), "t.yml:50: has more than 50 lists and mappings in each other");
}

TEST(YamlText, RefusesLargeTextsBeforeParsing) {
    EXPECT_EQ(error_of("[" + repeated(max_yaml_bytes / 2, "1,") + "]"),
              "t.yml: is YAML or JSON of more than 2 MiB");
}

// As large as is allowed, of what a parser finds hardest. Half a second each; the bound is for
// sanitizers on a busy machine.
TEST(YamlText, RefusesWithinSecondsWhatIsJustSmallEnough) {
    for (const std::string part : {"1,", "[", "{a: 1},"}) {
        const auto start = std::chrono::steady_clock::now();
        EXPECT_THAT(error_of("[" + repeated((max_yaml_bytes - 8) / part.size(), part)),
                    HasSubstr("has more than"));
        const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
        EXPECT_LT(taken.count(), 20.0) << part;
    }
}

// ---- file schema

// A schema says what the reader asked: keys, types, ranges, words, names that files give.

// A reader with one of everything.
void read_toy(const std::string& text) {
    const StrictFile file = StrictFile::from_text("etalon: toy/1\n" + text, "toy.yaml", "toy/1");
    const Value root = file.root();
    root.at("id").text();
    if (root.find("on"))
        root.at("on").flag();
    for (const Value& axis : root.at("axes").items()) {
        if (axis.at("kind").one_of({"linear", "rotary"}) == "rotary")
            axis.at("deg").number({-180.0, 180.0, false, "deg"});
        axis.at("count").integer(1, 9);
        axis.at("sign").one_of({"1", "-1"});
    }
    const Value volume = root.at("volume").with_names();
    for (const std::string& name : volume.keys())
        volume.at(name).numbers(2, positive);
    file.finish();
}

json schema_of_toy() {
    ReadTrace trace;
    read_toy("id: a\naxes: [{kind: rotary, deg: 3, count: 1, sign: 1}]\nvolume: {x: [1, 2]}\n");
    read_toy(
        "id: b\non: true\naxes: [{kind: linear, count: 2, sign: -1}]\nvolume: {tilt: [1, 2]}\n");
    return json::parse(file_schemas(trace).at("toy/1"));
}

TEST(FileSchema, RequiresWhatTheReaderAlwaysWants) {
    const json schema = schema_of_toy();
    EXPECT_EQ(schema.at("required"), json({"etalon", "id", "axes", "volume"}));
    const json axis = schema.at("/properties/axes/items"_json_pointer);
    EXPECT_EQ(axis.at("required"), json({"kind", "count", "sign"}));  // deg only of rotary ones
    EXPECT_EQ(axis.at("additionalProperties"), false);
    EXPECT_TRUE(axis.at("properties").contains("deg"));
}

TEST(FileSchema, SaysTypesRangesAndWords) {
    const json schema = schema_of_toy();
    EXPECT_EQ(schema.at("/properties/etalon/const"_json_pointer), "toy/1");
    const json axis = schema.at("/properties/axes/items/properties"_json_pointer);
    EXPECT_EQ(axis.at("kind"), json({{"enum", {"linear", "rotary"}}}));
    EXPECT_EQ(axis.at("sign"), json({{"enum", {"1", "-1", 1, -1}}}));
    EXPECT_EQ(axis.at("count"), json({{"type", "integer"}, {"minimum", 1.0}, {"maximum", 9.0}}));
    EXPECT_EQ(axis.at("deg").at("maximum"), 180.0);
    EXPECT_EQ(axis.at("deg").at("description"), "in deg");
}

// What a profile leaves to the one it extends is not missing, and ~ takes a key of that one away.
TEST(FileSchema, OfFilesThatExtendOthersRequiresNothingButInLists) {
    ReadTrace trace;
    const StrictFile file =
        StrictFile::from_text("etalon: toy/1\nspeed: 3\npoll: [{count: 2}]\n", "toy.yaml", "toy/1");
    file.root().find("extends");
    file.root().at("speed").integer(1, 9);
    file.root().at("poll").items().front().at("count").integer(1, 9);
    file.finish();
    const json schema = json::parse(file_schemas(trace).at("toy/1"));
    EXPECT_FALSE(schema.contains("required"));
    EXPECT_EQ(schema.at("/properties/speed/anyOf/1/type"_json_pointer), "null");
    EXPECT_EQ(schema.at("/properties/poll/anyOf/0/items/required"_json_pointer), json({"count"}));
}

TEST(FileSchema, LeavesNamesThatFilesGiveToThem) {
    const json volume = schema_of_toy().at("/properties/volume"_json_pointer);
    EXPECT_EQ(volume.at("properties"), json::object());
    EXPECT_EQ(volume.at("/additionalProperties/items/exclusiveMinimum"_json_pointer), 0.0);
}

TEST(ReadTrace, NotesNothingWhenItIsGone) {
    { const ReadTrace trace; }
    read_toy("id: a\naxes: []\nvolume: {}\n");
    const ReadTrace later;
    EXPECT_TRUE(later.files.empty());
}

}  // namespace
}  // namespace etalon
