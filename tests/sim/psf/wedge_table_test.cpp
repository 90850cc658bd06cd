#include "sim/psf/wedge_table.h"

#include "tests/test.h"

namespace etalon {
namespace {

using std::numbers::pi;

constexpr double sigma = 0.4;

WedgeTable gaussian_table() {
    constexpr double reach = 6.0 * sigma;
    return {radial_transfer(
                PointSpreadFunction::gaussian(sigma), [](double) { return 1.0; }, reach,
                WedgeTable::end_px(reach)),
            reach};
}

// Between the values of a table: where to read, and how far behind.
struct Place {
    int index;
    double way;

    explicit Place(double place) : index(static_cast<int>(place)), way(place - index) {}

    double between(double near, double far) const { return near + way * (far - near); }
};

Place row_of(double blur_px) {
    return Place(WedgeTable::rows_per_px *
                 (std::hypot(blur_px, WedgeTable::even_px) - WedgeTable::even_px));
}

double edge_value(const WedgeTable& table, double distance, double blur_px, int direction) {
    const WedgeRows rows = table.rows(blur_px, blur_px);
    const Place row = row_of(blur_px),
                at(static_cast<double>(rows.per_unit) * distance / (1.0 + distance));
    const auto along = [&](int index) {
        const float* values =
            rows.edges + (index * (WedgeTable::directions + 1) + direction) * rows.distances;
        return at.between(values[at.index], values[at.index + 1]);
    };
    return row.between(along(row.index), along(row.index + 1));
}

// The mean over a pixel and the line spread of a disk, by Gauss and Chebyshev.
double edge_truth(double distance, double blur_px, double angle) {
    constexpr int n = 48;
    double sum = 0.0;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const double x = (i + 0.5) / n - 0.5, y = (j + 0.5) / n - 0.5;
            const double place = distance - x * std::cos(angle) - y * std::sin(angle);
            for (int q = 1; q <= 16; ++q) {
                const double turn = pi * q / 17.0, sine = std::sin(turn);
                const double beyond = place + blur_px * std::cos(turn);
                sum += 1.0 / 17.0 * sine * sine * std::erfc(beyond / sigma / std::numbers::sqrt2);
            }
        }
    return sum / (n * n);
}

TEST(WedgeTable, IsTheMeanOfAPixelBeyondAnEdge) {
    const WedgeTable table = gaussian_table();
    for (const double blur : {0.0, 0.07, 0.33, 0.9})
        for (const int direction : {0, 7, WedgeTable::directions})
            for (double distance = 0.0; distance < 2.4; distance += 0.29)
                EXPECT_NEAR(
                    255.0 * edge_value(table, distance, blur, direction),
                    255.0 * edge_truth(distance, blur, pi / 4 * direction / WedgeTable::directions),
                    0.025)
                    << blur << " px, direction " << direction << ", " << distance << " px";
}

// Owen, "Tables for computing bivariate normal probabilities", 1956.
TEST(WedgeTable, IsOwensFunctionOfASharpGaussian) {
    const WedgeTable table = gaussian_table();
    const WedgeRows rows = table.rows(0.0, 0.0);
    for (const int at : {0, 31, 90, 150})
        for (const int angle : {5, 32, 63, WedgeTable::angles}) {
            const double distance = at / (static_cast<double>(rows.per_unit) - at);
            constexpr int steps = 4000;
            double truth = 0.0;
            for (int n = 0; n < steps; ++n) {
                const double turn = (n + 0.5) / steps * angle * pi / 2 / WedgeTable::angles;
                truth += std::exp(-0.5 * std::pow(distance / sigma / std::cos(turn), 2));
            }
            truth *= angle * pi / 2 / WedgeTable::angles / steps / (2.0 * pi);
            EXPECT_NEAR(255.0 * rows.wedges[at * WedgeTable::wedge_values + angle], 255.0 * truth,
                        0.003)
                << distance << " px, angle " << angle;
        }
}

// The density with a paraboloid in place of the disk, where the spread is much narrower than that.
TEST(WedgeTable, KnowsTheDensity) {
    const WedgeTable table = gaussian_table();
    const WedgeRows sharp = table.rows(0.0, 0.0);
    const int at = 64;
    const double distance = at / (static_cast<double>(sharp.per_unit) - at);
    EXPECT_NEAR(sharp.wedges[at * WedgeTable::wedge_values + WedgeTable::angles + 1],
                std::exp(-0.5 * std::pow(distance / sigma, 2)) / (2.0 * pi * sigma * sigma), 1e-4);
    // A paraboloid's variance is R^2 / 6 along an axis; in the middle that is all that counts.
    const double blur = 0.15;
    const Place row = row_of(blur);
    const WedgeRows rows = table.rows(blur, blur);
    const auto middle = [&](int index) {
        return rows
            .wedges[index * rows.distances * WedgeTable::wedge_values + WedgeTable::angles + 1];
    };
    EXPECT_NEAR(row.between(middle(row.index), middle(row.index + 1)),
                1.0 / (2.0 * pi * (sigma * sigma + blur * blur / 6.0)), 0.002);
}

TEST(WedgeTable, SaysWhereAPixelSeesNoEdge) {
    const WedgeTable table = gaussian_table();
    const double reach = table.reach_px(0.2);
    EXPECT_LT(edge_value(table, reach, 0.2, WedgeTable::directions), 2.0 * WedgeTable::negligible);
    EXPECT_GT(edge_value(table, 0.8 * reach, 0.2, WedgeTable::directions), WedgeTable::negligible);
}

TEST(WedgeTable, IsNotForSpreadsThatAreTooNarrowOrTooWide) {
    EXPECT_TRUE(WedgeTable::suits(PointSpreadFunction::airy(0.3), 3.3));
    EXPECT_FALSE(WedgeTable::suits(PointSpreadFunction::airy(0.1), 3.3));
    EXPECT_FALSE(WedgeTable::suits(PointSpreadFunction::airy(0.9), 6.1));
    EXPECT_FALSE(WedgeTable::suits(
        PointSpreadFunction::measured({{0.0, 1.0}, {0.5, 0.6}, {1.0, 0.2}, {2.0, 0.0}}), 2.0));
}

}  // namespace
}  // namespace etalon
