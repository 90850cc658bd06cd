#include "core/file/text.h"

#include "tests/test.h"

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

// Table 3-7 of the Unicode standard: the first and the last character of each length, and what lies
// beside them.
TEST(Text, Utf8IsWhatTheStandardSays) {
    const auto error = [](std::string_view text) {
        return config_error_of([&] { require_utf8(text, {"t", 3}); });
    };
    for (const char* good : {"\x01\x7f", "\xc2\x80\xdf\xbf", "\xe0\xa0\x80\xed\x9f\xbf\xef\xbf\xbf",
                             "\xf0\x90\x80\x80\xf4\x8f\xbf\xbf"})
        EXPECT_EQ(error(good), "no error");
    for (const char* bad :
         {"\x80", "\xc1\xbf", "\xe0\x9f\xbf", "\xed\xa0\x80", "\xf0\x8f\xbf\xbf",
          "\xf4\x90\x80\x80", "\xf5\x80\x80\x80", "\xff", "\xc2", "\xe2\x82", "\xf0\x9f\x98x"})
        EXPECT_NE(error(bad), "no error") << bad;
    EXPECT_EQ(error("ab\n\n\xe9t\xe9"), "t:5: is not UTF-8: a byte 0xe9");
    EXPECT_EQ(error(std::string_view("a\n\0", 3)), "t:4: is not UTF-8: a byte 0x00");
}

TEST(Text, FilesLoseTheirByteOrderMarkAndMustBeUtf8) {
    const TemporaryFolder folder;
    write_text(folder / "t", "\xef\xbb\xbfx\n\xef\xbb\xbf");
    EXPECT_EQ(read_text(folder / "t"), "x\n\xef\xbb\xbf");
    write_text(folder / "t", "\xff\xfex\0");
    EXPECT_THROW(read_text(folder / "t"), ConfigError);
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
