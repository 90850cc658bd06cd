#include "core/config/yaml_text.h"

#include <yaml-cpp/yaml.h>

#include "tests/test.h"

namespace etalon {
namespace {

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

}  // namespace
}  // namespace etalon
