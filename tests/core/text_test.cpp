#include "core/text.h"

#include <gtest/gtest.h>

#include "core/errors.h"

namespace etalon {
namespace {

TEST(Text, ParsesWholeFiniteNumbersOnly) {
    EXPECT_EQ(parse_number(" -7.5e2 "), -750.0);
    EXPECT_EQ(parse_number("+3"), 3.0);
    EXPECT_FALSE(parse_number("+-3"));
    for (const char* wrong : {"", "nan", "inf", "1.5x", "1,5", "0x10", "1e999", "--1"})
        EXPECT_FALSE(parse_number(wrong)) << wrong;
}

TEST(Text, ListOfNumbersMustHaveTheAskedLength) {
    EXPECT_EQ(parse_numbers("7,-5,0.25", 3, "--pose"), (std::vector<double>{7, -5, 0.25}));
    EXPECT_THROW(parse_numbers("7,-5", 3, "--pose"), ConfigError);
    EXPECT_THROW(parse_numbers("7,,5", 3, "--pose"), ConfigError);
}

TEST(Text, ExactNumbersReadBackAsTheSameDouble) {
    for (const double value : {0.1, 1.0 / 3.0, 538.55, -1e-300, 12345678901234567.0})
        EXPECT_EQ(parse_number(exact(value)), value);
}

TEST(Text, NearestWordFindsTheMisspelling) {
    EXPECT_EQ(nearest_word("focus_distanc_mm", {"f_number", "focus_distance_mm"}),
              "focus_distance_mm");
    EXPECT_EQ(nearest_word("zzzzzz", {"f_number", "psf"}), "");
}

TEST(Text, IsWrappedBelowItsHead) {
    EXPECT_EQ(wrapped_text("ab: ", "cd efg hi", 10), "ab: cd efg\n    hi\n");
    EXPECT_EQ(wrapped_text("", "longer-than-that x", 10), "longer-than-that\nx\n");
    EXPECT_EQ(wrapped_words("ab: ", {"cd", "efg", "hi"}, ", ", 2, 10), "ab: cd,\n  efg, hi\n");
}

TEST(Text, EscapesWhatHtmlWouldRead) {
    EXPECT_EQ(escape_html("<a & \"b\">"), "&lt;a &amp; &quot;b&quot;&gt;");
}

}  // namespace
}  // namespace etalon
