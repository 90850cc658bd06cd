// Truth: a tag drawn by hand, its topology by OpenCV's contours, areas and centroids by geometry.
#include "sim/marker/topotag_pattern.h"

#include <bit>
#include <opencv2/imgproc.hpp>

#include "tests/sim/marker/marker_checks.h"

namespace etalon {
namespace {

using test::expect_refused;

Marker tag(const std::string& spec) {
    return parse_marker(spec, "--marker");
}

// 70 = 1000110b: of the seven vertices behind the baseline the first, the fifth and the sixth have
// dots.
TEST(TopotagPattern, IsWhatIsDrawnByHand) {
    const std::vector<std::string> drawn = {"...................",   //
                                            ".#################.",   //
                                            ".#################.",   //
                                            ".##.............##.",   //
                                            ".##.#####...###.##.",   //
                                            ".##.#.#.#...#.#.##.",   //
                                            ".##.#####...###.##.",   //
                                            ".##.............##.",   //
                                            ".##.###.###.###.##.",   //
                                            ".##.###.###.###.##.",   //
                                            ".##.###.###.###.##.",   //
                                            ".##.............##.",   //
                                            ".##.###.###.###.##.",   //
                                            ".##.#.#.#.#.###.##.",   //
                                            ".##.###.###.###.##.",   //
                                            ".##.............##.",   //
                                            ".#################.",   //
                                            ".#################.",   //
                                            "..................."};  //
    const TopotagPattern pattern = topotag_pattern("3x3", 70);
    EXPECT_EQ(pattern.pixels_per_cell, 1);
    ASSERT_EQ(pattern.pixels.rows, 19);
    ASSERT_EQ(pattern.pixels.cols, 19);
    for (int y = 0; y < 19; ++y)
        for (int x = 0; x < 19; ++x)
            EXPECT_EQ(pattern.pixels.at<float>(y, x),
                      drawn[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)] == '.' ? 1.0f
                                                                                             : 0.0f)
                << x << ", " << y;
}

// 21 cells of 5 mm; vertices 4 cells apart, the second one 2 cells from the first.
TEST(TopotagPattern, HasItsVerticesInTheMarkersFrame) {
    const Marker marker = tag("topotag:5x5:4321@105mm");
    EXPECT_EQ(marker.id, 4321);
    EXPECT_EQ(marker.size_mm, 105.0);
    ASSERT_EQ(marker.points_mm.size(), 25u);
    const auto expect_at = [&](std::size_t i, double x, double y) {
        EXPECT_LT((marker.points_mm[i] - Eigen::Vector3d(x, y, 0)).norm(), 1e-12) << i;
    };
    expect_at(0, -40, -40);
    expect_at(1, -30, -40);
    expect_at(2, 0, -40);
    expect_at(5, -40, -20);
    expect_at(6, -20, -20);
    expect_at(24, 40, 40);
    // White square, frame of 10 mm, margin of 5 mm.
    EXPECT_NEAR(marker.grid.corner_mm.x(), -67.5, 1e-12);
    EXPECT_NEAR(marker.grid.columns() * marker.grid.cell_mm.x(), 135.0, 1e-12);
}

// How many regions each region holds, from OpenCV's tree of contours of what is black.
std::vector<int> children_by_contour(const TopotagPattern& pattern, std::vector<cv::Vec4i>& tree) {
    const int scale = pattern.pixels_per_cell == 1 ? 4 : 1;
    cv::Mat pixels;
    cv::resize(pattern.pixels, pixels, {}, scale, scale, cv::INTER_NEAREST);
    const cv::Mat black = pixels < 0.5f;
    std::vector<std::vector<cv::Point>> contours;
    cv::findContours(black, contours, tree, cv::RETR_TREE, cv::CHAIN_APPROX_NONE);
    std::vector<int> children(contours.size(), 0);
    for (const cv::Vec4i& contour : tree)
        if (contour[3] >= 0)
            ++children[static_cast<std::size_t>(contour[3])];
    return children;
}

TEST(TopotagPattern, HasTheTopologyOfThePublication) {
    for (const std::string& family : topotag_families())
        for (const int id : {0, 69, 126}) {
            std::vector<cv::Vec4i> tree;
            const std::vector<int> children =
                children_by_contour(topotag_pattern(family, id), tree);
            const int order = topotag_order(family), nodes = order * order - 1;
            EXPECT_EQ(children[0], 1) << "the frame around one white square";
            EXPECT_EQ(children[1], nodes) << family;
            int baselines = 0, dots = 0;
            for (std::size_t i = 0; i < tree.size(); ++i)
                if (tree[i][3] == 1) {
                    baselines += children[i] == 2 ? 1 : 0;
                    dots += children[i] == 1 ? 1 : 0;
                    EXPECT_LE(children[i], 2);
                }
            EXPECT_EQ(baselines, 1) << family;
            EXPECT_EQ(dots, std::popcount(static_cast<unsigned>(id))) << family << " " << id;
        }
}

// Nodes behind the baseline: centroids at the vertices, areas of disks of 3 cells with dots of 1.
// The diameters are right to 3e-4, so the areas to 6e-4.
TEST(TopotagPattern, RoundNodesHaveTheirAreasAndCentroids) {
    const Marker marker = tag("topotag:4x4-circle:5461@170mm");  // every second bit
    const cv::Mat black = marker.grid.cells < 0.5f;
    cv::Mat labels, stats, centres;
    const int regions = cv::connectedComponentsWithStats(black, labels, stats, centres);
    const double pixel = marker.grid.cell_mm.x(), cell = 10.0;
    int matched = 0;
    for (int i = 1; i < regions; ++i) {
        const Eigen::Vector2d centre =
            marker.grid.corner_mm +
            pixel * Eigen::Vector2d(centres.at<double>(i, 0) + 0.5, centres.at<double>(i, 1) + 0.5);
        const double area = stats.at<int>(i, cv::CC_STAT_AREA) * pixel * pixel;
        for (std::size_t v = 2; v < 16; ++v)
            if ((marker.points_mm[v].head<2>() - centre).norm() < 1e-6) {
                const bool has_dot = v % 2 == 1;  // the last bit is 1
                const double disk = std::numbers::pi / 4.0 * cell * cell * (has_dot ? 8.0 : 9.0);
                EXPECT_NEAR(area, disk, 6e-4 * disk) << v;
                ++matched;
            }
    }
    EXPECT_EQ(matched, 14);
}

TEST(TopotagPattern, CountsItsIds) {
    EXPECT_EQ(topotag_count("3x3"), 128);
    EXPECT_EQ(topotag_count("4x4-circle"), 16384);
    EXPECT_EQ(topotag_count("5x5"), 8388608);
    EXPECT_EQ(topotag_count("6x6"), 2147483647);
    EXPECT_EQ(tag("topotag:6x6:2147483646@50mm").id, 2147483646);
    EXPECT_THROW(tag("topotag:4x4:-1@50mm"), ConfigError);
    EXPECT_THROW(topotag_order("7x7"), ConfigError);
}

TEST(TopotagPattern, RefusesNamesThatAreNone) {
    expect_refused("topotag:4x4:16384@50mm", "those are 0 to 16383");
    expect_refused("topotag:4x4-circles:3@50mm", "did you mean '4x4-circle'?");
    expect_refused("topotag:4x4@50mm", "topotag:FAMILY:ID@SIZEmm");
    expect_refused("topotag:4x4:3@0mm", "not a length");
    expect_refused("topotags:4x4:3@50mm", "did you mean 'topotag'?");
}

}  // namespace
}  // namespace etalon
