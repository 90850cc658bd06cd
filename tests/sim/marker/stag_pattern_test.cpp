// Truth: the published geometry and words, written out here, and counting by hand.
#include "sim/marker/stag_pattern.h"

#include <bit>
#include <opencv2/imgproc.hpp>

#include "sim/marker/topotag_pattern.h"
#include "tests/sim/marker/marker_checks.h"

namespace etalon {
namespace {

// Word 0 of HD23 as the authors' generator has it in HD23.txt, a character a code point.
constexpr std::string_view hd23_0 = "001000111110110000101111001011011010001001011001";

TEST(StagCodes, AreThePublishedWords) {
    const StagCode code = stag_codes("HD23")[0];
    for (std::size_t i = 0; i < hd23_0.size(); ++i)
        EXPECT_EQ(code >> i & 1, hd23_0[i] == '1' ? 1u : 0u) << "code point " << i;
    EXPECT_EQ(stag_codes("HD23").size(), 6u);
    EXPECT_EQ(stag_codes("HD21").size(), 12u);
    EXPECT_EQ(stag_codes("HD19").size(), 38u);
    EXPECT_EQ(stag_codes("HD17").size(), 157u);
}

// A slip in one digit of a table would bring two words nearer than the family's name says.
TEST(StagCodes, OfOneFamilyKeepTheirPublishedDistanceWhileUpright) {
    for (const auto& [family, distance] :
         {std::pair("HD17", 17), {"HD19", 19}, {"HD21", 21}, {"HD23", 23}}) {
        const std::vector<StagCode> codes = stag_codes(family);
        for (std::size_t i = 0; i < codes.size(); ++i)
            for (std::size_t j = 0; j < i; ++j)
                EXPECT_GE(hamming_distance(codes[i], codes[j]), distance) << family << i << j;
    }
}

// What docs/stag.md says of the families when the camera may be turned.
TEST(StagCodes, KeepLessDistanceOverAllTurnsExceptOurOwn) {
    for (const auto& [family, distance] :
         {std::pair("HD17", 10), {"HD19", 10}, {"HD21", 14}, {"HD23", 14}, {"R16", 16}}) {
        const std::vector<StagCode> codes = stag_codes(family);
        int smallest = stag_bits;
        for (int id = 0; id < static_cast<int>(codes.size()); ++id)
            smallest = std::min(smallest, stag_separation(codes, id));
        EXPECT_EQ(smallest, distance) << family;
    }
}

TEST(StagCodes, OfOurOwnFamilyNeverChange) {
    const std::vector<StagCode> codes = stag_codes("R16");
    ASSERT_EQ(codes.size(), 128u);
    EXPECT_EQ(codes[0], 0xb58554d34ac0u);
    EXPECT_EQ(codes[127], 0xf7f6a7115129u);
}

TEST(StagCodes, TurnTheirPointsByAQuarterCounterClockwise) {
    const auto& points = stag_code_points();
    for (std::size_t i = 0; i < 48; ++i) {
        const Eigen::Vector2d turned(points[i].y(), -points[i].x());  // y points down
        EXPECT_LT((points[(i + 12) % 48] - turned).norm(), 1e-12) << i;
        EXPECT_EQ(turned_stag_code(StagCode{1} << i, 1), StagCode{1} << (i + 12) % 48);
    }
    EXPECT_EQ(turned_stag_code(5, 4), 5u);
    EXPECT_EQ(turned_stag_code(5, -1), turned_stag_code(5, 3));
}

// By hand: words 0 and 1 differ in 5 bits upright; word 1 turned by a quarter is one bit from
// word 0.
TEST(StagCodes, AreSeparatedByTheirNearestTurn) {
    const StagCode a = 0b110101, b = turned_stag_code(a ^ 1, 3);
    EXPECT_EQ(stag_separation({a, b}, 0), 1);
    EXPECT_EQ(stag_separation({a}, 0), 8);  // from itself turned: 4 bits here and 4 there
}

TEST(StagCodes, OfAFileAreReadByLines) {
    const TemporaryFolder folder;
    const std::string path = folder.path() / "codes.txt";
    std::ofstream(path) << "# two words\n" << hd23_0 << "\r\n\n" << std::string(48, '1') << "\n";
    const std::vector<StagCode> codes = stag_codes(path);
    ASSERT_EQ(codes.size(), 2u);
    EXPECT_EQ(codes[0], stag_codes("HD23")[0]);
    EXPECT_EQ(codes[1], (StagCode{1} << 48) - 1);
}

TEST(StagCodes, OfADamagedFileAreRefusedWithTheLine) {
    const TemporaryFolder folder;
    const std::string path = folder.path() / "codes.txt";
    const auto complaint = [&](const std::string& text) {
        std::ofstream(path) << text;
        return config_error_of([&] { stag_codes(path); });
    };
    EXPECT_THAT(complaint("\n" + std::string(47, '1')), HasSubstr(path + ":2: "));
    EXPECT_THAT(complaint(std::string(47, '1') + "2"), HasSubstr("48 characters 0 or 1"));
    EXPECT_THAT(complaint("# nothing\n"), HasSubstr("no codeword"));
    EXPECT_THAT(config_error_of([&] { stag_codes("missing.txt"); }), HasSubstr("missing"));
}

// Side 70 mm: border 8.75 mm, circle of 28 mm, code points at 0.7 of their published radius.
TEST(StagMarker, HasThePublishedGeometry) {
    const Marker marker = parse_marker("stag:HD23:0@70mm", "test");
    EXPECT_EQ(marker.id, 0);
    EXPECT_DOUBLE_EQ(marker.size_mm, 70.0);
    ASSERT_EQ(marker.points_mm.size(), 4u);
    EXPECT_EQ(marker.points_mm[0], Eigen::Vector3d(-35, -35, 0));
    EXPECT_EQ(marker.points_mm[1], Eigen::Vector3d(35, -35, 0));
    EXPECT_EQ(marker.points_mm[2], Eigen::Vector3d(35, 35, 0));
    EXPECT_NEAR(marker.grid.corner_mm.x(), -43.75, 1e-12);
    EXPECT_NEAR(marker.grid.cell_mm.x() * marker.grid.columns(), 87.5, 1e-9);
    EXPECT_EQ(radiance_at(marker, -35.2, -35.2), 1.0f);
    EXPECT_EQ(radiance_at(marker, -34.8, -34.8), 0.0f);
    EXPECT_EQ(radiance_at(marker, 0.1, -28.4), 0.0f);   // just outside the circle
    EXPECT_EQ(radiance_at(marker, -19.6, 19.6), 1.0f);  // just inside it, on the diagonal: 27.7 mm
    EXPECT_EQ(radiance_at(marker, -20.1, 20.1), 0.0f);  // 28.4 mm
}

// The first and the last point of the first quadrant and one of the second, by hand: radius 0.0884
// at 45 degrees and 0.4374 at 90 - 8.35 degrees, times 0.7 * 70 mm.
TEST(StagMarker, HasItsDiscsWhereThePublicationHasThem) {
    const Marker marker = parse_marker("stag:HD23:0@70mm", "test");
    EXPECT_LT((70.0 * stag_code_points()[0] - Eigen::Vector2d(3.0616, -3.0616)).norm(), 1e-3);
    EXPECT_LT((70.0 * stag_code_points()[11] - Eigen::Vector2d(3.1124, -21.2065)).norm(), 1e-3);
    EXPECT_LT((70.0 * stag_code_points()[12] - Eigen::Vector2d(-3.0616, -3.0616)).norm(), 1e-3);
    for (std::size_t i = 0; i < 48; ++i) {
        const Eigen::Vector2d centre = 70.0 * stag_code_points()[i];
        const float expected = hd23_0[i] == '1' ? 0.0f : 1.0f;
        for (const auto& [dx, dy] : {std::pair(0.0, 0.0), {2.8, 0.0}, {0.0, -2.8}, {-1.9, 1.9}})
            EXPECT_EQ(radiance_at(marker, centre.x() + dx, centre.y() + dy), expected) << i;
    }
}

// A white code shows the disk alone. A staircase of 128 cells to the radius is right in its area to
// a part of (cells on the circumference) / (cells inside) * 0.05.
TEST(StagMarker, HasADiskOfTheRightArea) {
    const cv::Mat cells = stag_cells(0);
    const double white = cv::sum(cells)[0] - (400.0 * 400.0 - 320.0 * 320.0);
    EXPECT_NEAR(white / (3.14159265 * 128.0 * 128.0), 1.0, 4e-4);
}

TEST(StagMarker, LooksTurnedWithATurnedCode) {
    const StagCode code = stag_codes("HD21")[7];
    cv::Mat turned;
    cv::rotate(stag_cells(code), turned, cv::ROTATE_90_COUNTERCLOCKWISE);
    // Cells whose centres lie on a disc's rim may go either way: a few of 160 000.
    EXPECT_LT(cv::countNonZero(turned != stag_cells(turned_stag_code(code, 1))), 80);
}

TEST(StagMarker, IsRefusedWithTheReason) {
    expect_refused("stag:HD21@50mm", "stag:FAMILY:ID@SIZEmm");
    expect_refused("stag:HD20:0@50mm", "unknown STag family 'HD20'");
    expect_refused("stag:HD21:12@50mm", "those are 0 to 11");
    expect_refused("stag:HD21:-1@50mm", "those are 0 to 11");
    expect_refused("stag:HD21:3@0mm", "not a length");
    EXPECT_THAT(config_error_of([] { parse_marker("stag:none.txt:3@50mm", "--marker"); }),
                HasSubstr("none.txt"));
}

TEST(StagMarker, OfATableFileMustNotLookLikeAnother) {
    const TemporaryFolder folder;
    const std::string path = folder.path() / "codes.txt";
    std::ofstream(path) << hd23_0 << "\n" << std::string(48, '1') << "\n";
    EXPECT_EQ(parse_marker("stag:" + path + ":0@50mm", "test").id, 0);
    expect_refused("stag:" + path + ":1@50mm", "looks like another one or like itself");
}

// ---- topotag pattern

// Truth: a tag drawn by hand, its topology by OpenCV's contours, areas and centroids by geometry.

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
