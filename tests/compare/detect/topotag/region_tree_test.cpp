// Truth: the same regions by flooding from the outside inwards, pixel by pixel.
#include "compare/detect/topotag/topotag_detector.h"

#include <deque>
#include <tuple>

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

// What is told of a region and of the one around it, in any order of the regions.
using Told = std::tuple<bool, double, double, double, double>;  // dark, area, sums, parent's area

std::vector<Told> told_of(const std::vector<Region>& regions) {
    std::vector<Told> told;
    for (const Region& region : regions)
        told.emplace_back(
            region.is_dark, region.area, region.sum.x(), region.sum.y(),
            region.parent < 0 ? -1.0 : regions[static_cast<std::size_t>(region.parent)].area);
    std::sort(told.begin(), told.end());
    return told;
}

cv::Mat picture(const std::vector<std::string>& rows) {
    cv::Mat dark(static_cast<int>(rows.size()), static_cast<int>(rows[0].size()), CV_8UC1);
    for (int y = 0; y < dark.rows; ++y)
        for (int x = 0; x < dark.cols; ++x)
            dark.at<uchar>(y, x) =
                rows[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)] == '#' ? 255 : 0;
    return dark;
}

// The image with a white border stands for the outside; its pixels do not count.
std::vector<Told> by_flooding(const cv::Mat& dark) {
    cv::Mat all, label(dark.rows + 2, dark.cols + 2, CV_32SC1, cv::Scalar::all(-1));
    cv::copyMakeBorder(dark, all, 1, 1, 1, 1, cv::BORDER_CONSTANT, cv::Scalar::all(0));
    std::vector<Region> regions;
    std::deque<std::pair<cv::Point, int>> seeds = {{{0, 0}, -1}};
    while (!seeds.empty()) {
        const auto [seed, parent] = seeds.front();
        seeds.pop_front();
        if (label.at<int>(seed) >= 0)
            continue;
        const int index = static_cast<int>(regions.size());
        Region region;
        region.parent = parent;
        region.is_dark = all.at<uchar>(seed) != 0;
        std::deque<cv::Point> open = {seed};
        label.at<int>(seed) = index;
        while (!open.empty()) {
            const cv::Point at = open.front();
            open.pop_front();
            if (at.x > 0 && at.y > 0 && at.x <= dark.cols && at.y <= dark.rows) {
                region.area += 1.0;
                region.sum += Eigen::Vector2d(at.x - 1, at.y - 1);
            }
            for (int dy = -1; dy <= 1; ++dy)
                for (int dx = -1; dx <= 1; ++dx) {
                    const cv::Point next(at.x + dx, at.y + dy);
                    if (next.x < 0 || next.y < 0 || next.x >= all.cols || next.y >= all.rows ||
                        label.at<int>(next) >= 0)
                        continue;
                    const bool beside = dx == 0 || dy == 0;
                    if (all.at<uchar>(next) != all.at<uchar>(seed)) {
                        if (beside)
                            seeds.push_back({next, index});
                    } else if (beside || !region.is_dark) {
                        label.at<int>(next) = index;
                        open.push_back(next);
                    }
                }
        }
        regions.push_back(region);
    }
    return told_of(regions);
}

TEST(RegionTree, TellsWhatEnclosesWhat) {
    const std::vector<Region> tree = region_tree(picture({".........",  //
                                                          ".#######.",  //
                                                          ".#.....#.",  //
                                                          ".#.###.#.",  //
                                                          ".#.#.#.#.",  //
                                                          ".#.###.#.",  //
                                                          ".#.....#.",  //
                                                          ".#######.",  //
                                                          "........."}));
    ASSERT_EQ(tree.size(), 5u);
    const std::vector<double> areas = {32, 24, 16, 8, 1};
    for (int i = 0; i < 5; ++i) {
        const Region& region = tree[static_cast<std::size_t>(i)];
        EXPECT_EQ(region.parent, i - 1);
        EXPECT_EQ(region.is_dark, i % 2 == 1);
        EXPECT_EQ(region.area, areas[static_cast<std::size_t>(i)]);
        EXPECT_EQ(region.sum, Eigen::Vector2d(4, 4) * region.area);
        EXPECT_EQ(region.children.size(), i < 4 ? 1u : 0u);
    }
}

TEST(RegionTree, WhiteIsJoinedOverCornersAndBlackIsNot) {
    const std::vector<Region> tree = region_tree(picture({"#.", ".#"}));
    EXPECT_EQ(tree.size(), 3u) << "white all around, two black pixels";
    EXPECT_EQ(tree[0].children.size(), 2u);
}

// An arm that is met before the region it belongs to, and black at the image's edges.
TEST(RegionTree, OfRandomPicturesIsThatOfFlooding) {
    for (std::uint64_t n = 0; n < 60; ++n) {
        RandomStream random(77, 1, n);
        const int columns = 1 + static_cast<int>(random.uniform() * 40),
                  rows = 1 + static_cast<int>(random.uniform() * 25);
        const double share = 0.3 + 0.4 * random.uniform();
        cv::Mat dark(rows, columns, CV_8UC1);
        for (int y = 0; y < rows; ++y)
            for (int x = 0; x < columns; ++x)
                dark.at<uchar>(y, x) = random.uniform() < share ? 255 : 0;
        EXPECT_EQ(told_of(region_tree(dark)), by_flooding(dark)) << n;
    }
}

}  // namespace
}  // namespace etalon
