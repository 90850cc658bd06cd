#include "report/number_text.h"

#include "tests/test.h"

namespace etalon {
namespace {

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
