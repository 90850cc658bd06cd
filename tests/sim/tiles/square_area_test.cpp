#include "sim/tiles/cell_coverage.h"

#include <gtest/gtest.h>

namespace etalon {
namespace {

// Fraction of a fine grid's points: independent of any geometry.
double counted(const SquareCut& a, const SquareCut& b) {
    constexpr int n = 1000;
    int inside = 0;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const Eigen::Vector2d s((i + 0.5) / n - 0.5, (j + 0.5) / n - 0.5);
            inside += a.offset + a.gradient.dot(s) >= 0.0 && b.offset + b.gradient.dot(s) >= 0.0;
        }
    return inside / double(n * n);
}

TEST(SquareArea, OfACutIsATrapeziumOrACorner) {
    EXPECT_DOUBLE_EQ(square_cut({4.0, 0.0}, 1.0).area, 0.75);
    EXPECT_DOUBLE_EQ(square_cut({0.0, -5.0}, -2.0).area, 0.1);
    // 3 x + 5 y >= 2 leaves a triangle with the corner (1/2, 1/2): legs 2/3 and 2/5.
    EXPECT_NEAR(square_cut({3.0, 5.0}, -2.0).area, 0.5 * (2.0 / 3.0) * (2.0 / 5.0), 1e-15);
    EXPECT_NEAR(square_cut({3.0, -5.0}, 2.0).area, 1.0 - 0.5 * (2.0 / 3.0) * (2.0 / 5.0), 1e-15);
}

TEST(SquareArea, OfNoGradientIsAllOrNothing) {
    EXPECT_EQ(square_cut({0.0, 0.0}, 0.1).area, 1.0);
    EXPECT_EQ(square_cut({0.0, 0.0}, -0.1).area, 0.0);
}

// From the area of a triangle and of a trapezium by hand, then all the way from 0 to 1.
TEST(SquareArea, IsThatOfTheOffsetFoundForIt) {
    // Legs 2/3 and 2/5 as above.
    EXPECT_NEAR(offset_of_area({3.0, 5.0}, 2.0 / 15.0), -2.0, 1e-14);
    EXPECT_NEAR(offset_of_area({0.0, -5.0}, 0.1), -2.0, 1e-14);
    for (const Eigen::Vector2d& gradient :
         {Eigen::Vector2d(3.0, 5.0), {-7.0, 2.0}, {0.5, -6.0}, {0.0, 4.0}, {2.0, 2.0}})
        for (const double area : {0.0, 1e-9, 0.03, 0.25, 0.5, 0.71, 0.999, 1.0})
            EXPECT_NEAR(square_cut(gradient, offset_of_area(gradient, area)).area, area, 1e-14);
}

TEST(SquareArea, OfTwoCutsIsWhatCountingPointsGives) {
    const SquareCut cuts[] = {square_cut({3.0, 5.0}, -0.4), square_cut({-7.0, 2.0}, 1.1),
                              square_cut({0.5, -6.0}, 2.0), square_cut({1.0, 1e-3}, 0.2)};
    for (const SquareCut& a : cuts)
        for (const SquareCut& b : cuts)
            EXPECT_NEAR(square_wedge_area(a, b), counted(a, b), 2e-3);
}

TEST(SquareArea, OfAQuadrantIsExact) {
    EXPECT_NEAR(square_wedge_area(square_cut({1.0, 0.0}, -0.2), square_cut({0.0, -1.0}, 0.1)),
                0.3 * 0.6, 1e-15);
}

}  // namespace
}  // namespace etalon
