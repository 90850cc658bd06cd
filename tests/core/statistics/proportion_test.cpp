#include "core/statistics/distributions.h"

#include <gtest/gtest.h>

#include "core/program/errors.h"

namespace etalon {
namespace {

// The four examples of Newcombe (Statistics in Medicine 17, 1998, table I, method 3: the score
// interval without continuity correction), printed with four decimals.
TEST(WilsonShare, AgreesWithTheIntervalsThatNewcombePrints) {
    const struct {
        std::size_t count, trials;
        double low, high;
    } published[] = {{81, 263, 0.2553, 0.3662},
                     {15, 148, 0.0624, 0.1605},
                     {0, 20, 0.0, 0.1611},
                     {1, 29, 0.0061, 0.1718}};
    for (const auto& each : published) {
        const Proportion share = wilson_share(each.count, each.trials);
        EXPECT_NEAR(share.low, each.low, 5e-5) << each.count;
        EXPECT_NEAR(share.high, each.high, 5e-5) << each.count;
        EXPECT_DOUBLE_EQ(share.value,
                         static_cast<double>(each.count) / static_cast<double>(each.trials));
    }
}

TEST(WilsonShare, StaysWithinItsBoundsAndRefusesImpossibleCounts) {
    EXPECT_EQ(wilson_share(7, 7).high, 1.0);
    EXPECT_LT(wilson_share(7, 7).low, 1.0);
    EXPECT_THROW(wilson_share(0, 0), NumericalError);
    EXPECT_THROW(wilson_share(8, 7), NumericalError);
}

}  // namespace
}  // namespace etalon
