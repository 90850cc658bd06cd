#include "sim/tiles/core_filter.h"

#include <random>

#include "tests/test.h"

namespace etalon {
namespace {

cv::Mat random_image(int rows, int columns, unsigned seed) {
    std::mt19937 random(seed);
    cv::Mat image(rows, columns, CV_32FC1);
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < columns; ++x)
            image.at<float>(y, x) = static_cast<float>(random()) * 0x1p-32f;
    return image;
}

// Equal to its mirror image from left to right, of no symmetry from top to bottom.
cv::Mat random_weights(int rows, int columns, unsigned seed) {
    cv::Mat weights, mirrored;
    random_image(rows, columns, seed).convertTo(weights, CV_64FC1, 1.0, -0.3);
    cv::flip(weights, mirrored, 1);
    return 0.5 * (weights + mirrored);
}

// Tiles of random samples among constant ones, in a corner of the plane left of and above (0, 0).
class Field {
public:
    Field(int tile_side, double part_refined, unsigned seed)
        : side(tile_side),
          tiles(-3, -5, 23, 19),
          samples(tiles.height * side, tiles.width * side, CV_32FC1),
          map(tiles) {
        std::mt19937 random(seed);
        for_each_cell(tiles, [&](int i, int j) {
            cv::Mat part = samples({(i - tiles.x) * side, (j - tiles.y) * side, side, side});
            const bool refined = static_cast<double>(random()) < part_refined * 0x1p32;
            // Large areas share one value.
            const float value = i > 8 && j > 2 ? 0.0f : j > 5 ? -0.75f : 0.5f;
            part.setTo(value);
            map.set(i, j, value);
            if (refined) {
                store.push_back(random_image(side, side, static_cast<unsigned>(random())));
                store.back().copyTo(part);
                map.set(i, j, value, TileDetail::samples, store.back().ptr<float>());
            }
        });
        map.finish();
    }

    void add_to(const cv::Rect& region, const FilterKernel& kernel, cv::Mat& out) const {
        for_each_band(region, [&](const cv::Rect& band) {
            add_filtered({map, side}, kernel, region, band, out);
        });
    }
    double sample(int x, int y) const {
        const cv::Point at(x - tiles.x * side, y - tiles.y * side);
        return cv::Rect({0, 0}, samples.size()).contains(at) ? samples.at<float>(at) : 0.0;
    }

    int side;
    cv::Rect tiles;
    cv::Mat samples;
    TileMap map;
    std::vector<cv::Mat> store;
};

double plain_sum(const Field& field, int k, const cv::Mat& weights, int x, int y) {
    const int left = k * x - (weights.cols - k) / 2, top = k * y - (weights.rows - k) / 2;
    double sum = 0.0;
    for (int j = 0; j < weights.rows; ++j)
        for (int i = 0; i < weights.cols; ++i)
            sum += weights.at<double>(j, i) * field.sample(left + i, top + j);
    return sum;
}

// Of what the filter adds to `before`.
void expect_plain_sums(const Field& field, const FilterKernel& kernel, const cv::Mat& weights,
                       const cv::Rect& region, double before) {
    cv::Mat out(region.size(), CV_32FC1, cv::Scalar(before));
    field.add_to(region, kernel, out);
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x)
            ASSERT_NEAR(out.at<float>(y, x),
                        before + plain_sum(field, kernel.k, weights, region.x + x, region.y + y),
                        2e-5)
                << x << ", " << y;
}

struct Case {
    int k, side;
    double refined;
    int reach_x, reach_y;
};

class AddFiltered : public testing::TestWithParam<Case> {};

TEST_P(AddFiltered, IsTheSumOverTheKernel) {
    const auto [k, side, refined, reach_x, reach_y] = GetParam();
    const Field field(side, refined, 11);
    const cv::Mat weights = random_weights(k + 2 * reach_y, k + 2 * reach_x, 5);
    const FilterKernel kernel(k, weights);
    EXPECT_EQ(kernel.reach_x, reach_x);
    EXPECT_EQ(kernel.reach_y, reach_y);
    const int n = side / k;
    const cv::Rect region(-4 * n - 3, -6 * n + 1, 26 * n + 5, 23 * n + 3);
    expect_plain_sums(field, kernel, weights, region, 0.25);
}

// Samples k per output in tiles of 4 x 4 outputs, and the coarser grids of the tail.
INSTANTIATE_TEST_SUITE_P(Grids, AddFiltered,
                         testing::Values(Case{1, 4, 0.1, 7, 5}, Case{2, 8, 0.05, 11, 4},
                                         Case{3, 12, 0.05, 4, 8}, Case{4, 16, 0.02, 3, 3},
                                         Case{5, 20, 0.02, 2, 3}, Case{1, 2, 0.1, 6, 9},
                                         Case{1, 1, 0.0, 5, 7}, Case{3, 12, 0.1, 0, 0}));

// Of a round kernel the corners hold nothing; samples differ by 1.75 at most.
TEST(AddFiltered, LeavesOutCornersUpToTheirShare) {
    constexpr int reach = 8;
    cv::Mat weights(2 * reach + 1, 2 * reach + 1, CV_64FC1);
    for (int y = -reach; y <= reach; ++y)
        for (int x = -reach; x <= reach; ++x)
            weights.at<double>(y + reach, x + reach) = 0.05 * std::exp(-(x * x + y * y) / 8.0);
    const FilterKernel kernel(1, weights);
    EXPECT_GT(kernel.view().first_pairs[0], 0);
    expect_plain_sums(Field(4, 0.3, 17), kernel, weights, {-20, -30, 112, 96}, 0.0);
}

TEST(AddFiltered, LeavesAloneWhatIsZero) {
    const Field field(4, 0.0, 1);
    const FilterKernel kernel(1, random_weights(5, 5, 2));
    const cv::Rect region(0, 0, 200, 300);
    cv::Mat out(region.size(), CV_32FC1, cv::Scalar(std::nan("")));
    field.add_to(region, kernel, out);
    EXPECT_TRUE(std::isnan(out.at<float>(250, 150)));
    EXPECT_TRUE(std::isnan(out.at<float>(40, 70)));  // among tiles that are zero
}

TEST(TileMap, NeverCallsConstantWhatIsNot) {
    const Field field(4, 0.02, 9);
    int constant_parts = 0;
    for (int y = -8; y < 18; ++y)
        for (int x = -6; x < 24; ++x)
            for (const int width : {1, 3, 6}) {
                const cv::Rect part(x, y, width, 2);
                if (!field.map.is_constant(part))
                    continue;
                ++constant_parts;
                const double value = field.sample(4 * x, 4 * y);
                for (int j = 4 * y; j < 4 * y + 8; ++j)
                    for (int i = 4 * x; i < 4 * (x + width); ++i)
                        ASSERT_EQ(field.sample(i, j), value) << part;
            }
    EXPECT_GT(constant_parts, 1000);
}

TEST(CellsOf, HoldEveryPixel) {
    EXPECT_EQ(cells_of({-9, -8, 10, 8}, 8), cv::Rect(-2, -1, 3, 1));
    EXPECT_EQ(cells_of({7, 8, 1, 9}, 8), cv::Rect(0, 1, 1, 2));
    EXPECT_TRUE(cells_of({3, 3, 0, 5}, 8).empty());
}

// A single sum in single precision loses what each of so many equal products adds.
TEST(AddFiltered, KeepsTheEnergyOfAKernelOfHundredThousandsOfWeights) {
    constexpr int k = 12, reach = 300;
    Field field(4 * k, 1.0, 3);
    for (cv::Mat& values : field.store)
        values.setTo(0.7f);
    const int side = k + 2 * reach;
    const FilterKernel kernel(k, cv::Mat(side, side, CV_64FC1, cv::Scalar(1.0 / (side * side))));
    const cv::Rect region(18, 8, 16, 4);  // it sees nothing but the field
    cv::Mat out = cv::Mat::zeros(region.size(), CV_32FC1);
    field.add_to(region, kernel, out);
    for (int x = 0; x < out.cols; ++x)
        EXPECT_NEAR(out.at<float>(2, x), 0.7, 0.3e-4) << x;
}

}  // namespace
}  // namespace etalon
