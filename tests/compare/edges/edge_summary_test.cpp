#include "compare/edges/edge_summary.h"

#include <gtest/gtest.h>

#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

EdgeShift edge(double x, double y, double angle, double shift, double deviation) {
    EdgeShift result;
    result.middle_px = {x, y};
    result.normal = {std::cos(angle), std::sin(angle)};
    result.shift_px = shift;
    result.shift_deviation_px = deviation;
    result.blur_deviation_px2 = 0.01;
    result.pixels = 100;
    result.radius_px = std::hypot(x - 319.5, y - 239.5);
    result.depth_mm = 400.0 + x;
    return result;
}

// With equal deviations the definition is solved by hand: mean square less variance.
TEST(EdgeSummary, TakesTheNoiseOutOfTheShifts) {
    const std::vector<EdgeShift> edges = {edge(0, 0, 0, 0.5, 0.3), edge(0, 0, 0, -0.7, 0.3),
                                          edge(0, 0, 0, 0.4, 0.3)};
    const EdgeSummary summary = edge_summary(edges);
    EXPECT_NEAR(summary.shift.with_noise_px, std::sqrt(0.9 / 3.0), 1e-12);
    EXPECT_NEAR(summary.shift.noise_px, 0.3, 1e-12);
    EXPECT_NEAR(summary.shift.rms_px, std::sqrt(0.9 / 3.0 - 0.09), 1e-9);
    EXPECT_NEAR(summary.median_shift_px, 1.4826 * 0.5, 1e-12);
    EXPECT_NEAR(summary.mean_shift_px, 0.2 / 3.0, 1e-12);
    EXPECT_EQ(edge_summary({{edge(0, 0, 0, 0.2, 0.3)}}).shift.rms_px, 0.0);
    EXPECT_EQ(edge_summary({}).edges, 0);
}

// Deviations from 0.01 to 0.3 px about a spread of 0.07 px: found within its stated deviation.
// 400 runs: the mean pull within 3.5 / sqrt(400) and 0.1 for a root's bias, mean square of 1 within
// 3.5 sqrt(2 / 400), and a tenth.
TEST(EdgeSummary, FindsASpreadUnderUnequalNoise) {
    double sum = 0.0, squares = 0.0;
    for (std::uint32_t run = 0; run < 400; ++run) {
        RandomStream random(11, run);
        std::vector<EdgeShift> edges;
        for (int i = 0; i < 75; ++i) {
            const double deviation = 0.01 * std::pow(30.0, random.uniform());
            edges.push_back(
                edge(0, 0, 0, std::hypot(0.07, deviation) * random.normal(), deviation));
        }
        const ShiftSpread spread = edge_summary(edges).shift;
        const double pull = (spread.rms_px - 0.07) / spread.rms_deviation_px;
        sum += pull / 400.0;
        squares += pull * pull / 400.0;
    }
    EXPECT_LT(std::abs(sum), 0.28);
    EXPECT_GT(squares, 0.65);
    EXPECT_LT(squares, 1.35);
}

TEST(EdgeSummary, LeavesEdgesBeyondTheirRangeOut) {
    std::vector<EdgeShift> edges = {edge(0, 0, 0, 0.1, 0.01), edge(0, 0, 0, 0.6, 0.01)};
    edges[1].is_beyond_range = true;
    const EdgeSummary summary = edge_summary(edges);
    EXPECT_EQ(summary.edges, 1);
    EXPECT_EQ(summary.beyond_range, 1);
    EXPECT_NEAR(summary.mean_shift_px, 0.1, 1e-12);
}

TEST(EdgeSummary, PartsKeepTheirSigns) {
    std::vector<EdgeShift> edges = {edge(0, 0, 0, 0.1, 0.01), edge(0, 0, 0, 0.2, 0.01)};
    edges[0].shares = {700.0, -300.0, 400.0, 1000.0};
    edges[1].shares = {100.0, 100.0, -500.0, 300.0};
    const EdgeParts parts = edge_summary(edges).parts;  // of 200 pixels
    EXPECT_NEAR(parts.shift_gray, 2.0, 1e-12);
    EXPECT_NEAR(parts.blur_gray, -1.0, 1e-12);
    EXPECT_NEAR(parts.photometric_gray, -std::sqrt(0.5), 1e-12);
    EXPECT_NEAR(parts.rest_gray, std::sqrt(6.5), 1e-12);
    EXPECT_NEAR(parts.residual_gray, 3.0, 1e-12);
}

// Edges of two slanted directions that one vector moves, 7 of one and 5 of the other.
TEST(ShiftField, FindsTheVectorsThatEdgesShowPartsOf) {
    const Eigen::Vector2d left(0.13, -0.31), right(-0.2, 0.05);
    std::vector<EdgeShift> edges;
    for (int i = 0; i < 12; ++i)
        for (const double x : {100.0, 500.0}) {
            EdgeShift one = edge(x + 3 * i, 40.0 + 2 * i, i < 7 ? 0.3 : 2.1, 0, 0.01 + 0.002 * i);
            one.shift_px = one.normal.dot(x < 300 ? left : right);
            edges.push_back(one);
        }
    for (int i = 0; i < 9; ++i)  // all of one direction: no vector
        edges.push_back(edge(300.0 + i, 400.0, 0.3, 0.1, 0.01));
    const std::vector<ShiftVector> field = shift_field(edges, {640, 480}, 160.0);
    ASSERT_EQ(field.size(), 2u);
    EXPECT_LT((field[0].shift_px - left).norm(), 1e-12);
    EXPECT_LT((field[1].shift_px - right).norm(), 1e-12);
    EXPECT_EQ(field[0].edges, 12);
    EXPECT_NEAR(field[0].position_px.x(), 116.5, 1e-9);
    // Information of the two directions, by hand in one of them.
    double information = 0.0;
    for (int i = 0; i < 12; ++i)
        information += std::pow(std::cos(i < 7 ? 0.3 : 2.1) / (0.01 + 0.002 * i), 2);
    EXPECT_NEAR(field[0].covariance_px2.inverse()(0, 0), information, 1e-6 * information);
    EXPECT_THROW(shift_field(edges, {640, 480}, 0.0), NumericalError);
}

TEST(EdgeBins, CoverRadiusAndDepth) {
    std::vector<EdgeShift> edges;
    for (int i = 0; i < 7; ++i)
        edges.push_back(edge(319.5 + 50.0 * i, 239.5, 0, 0.1 * i, 0.01));
    const auto by_radius = edges_by_radius(edges, {640, 480}, 4);  // to 399.2 px
    ASSERT_EQ(by_radius.size(), 4u);
    EXPECT_NEAR(by_radius[3].high, std::hypot(319.5, 239.5), 1e-9);
    EXPECT_EQ(by_radius[0].summary.edges, 2);
    EXPECT_EQ(by_radius[1].summary.edges, 2);
    EXPECT_EQ(by_radius[3].summary.edges, 1);
    EXPECT_EQ(by_radius[3].summary.pixels, 100);
    const auto by_depth = edges_by_depth(edges, 3);
    ASSERT_EQ(by_depth.size(), 3u);
    EXPECT_NEAR(by_depth[0].low, 719.5, 1e-9);
    EXPECT_NEAR(by_depth[2].high, 1019.5, 1e-9);
    EXPECT_EQ(by_depth[0].summary.edges + by_depth[1].summary.edges + by_depth[2].summary.edges, 7);
    EXPECT_EQ(by_depth[2].summary.edges, 3);  // the farthest included
    EXPECT_TRUE(edges_by_depth({}, 3).empty());
    EXPECT_THROW(edges_by_depth(edges, 0), NumericalError);
}

}  // namespace
}  // namespace etalon
