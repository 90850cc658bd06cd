#include "sim/tiles/edge_group.h"

#include "sim/psf/diffraction.h"
#include "tests/calib/cameras.h"
#include "tests/sim/every_target.h"
#include "tests/sim/image_checks.h"

namespace etalon {
namespace {

using std::numbers::pi;

// Cells of 120 px, blurred by 5 to 8 px, under some distortion.
CameraModel camera_of_large_cells() {
    return test::camera_with_lens(320, 240, {2000.0, 2000.0, 160.2, 118.7},
                                  {.k1 = -0.2, .p1 = 0.002}, 5.0, {1.4, 900.0, 1200.0, {}});
}

Scene large_cells() {
    const cv::Mat cells = (cv::Mat_<float>(2, 2) << 0.05f, 0.9f, 0.8f, 0.1f);
    return {{{{cells, {-30.0, -30.0}, {30.0, 30.0}},
              {rotation_from_vector({0.35, 0.3, 0.3}), {3.0, 2.0, 500.0}}}},
            0.6};
}

long tiles_by_table(const RenderPlan& plan) {
    long tiles = 0;
    for (const TileUse& use : plan.used)
        if (use.method == RenderMethod::edge_table)
            tiles += use.tiles;
    return tiles;
}

TEST(EdgeGroup, IsAsGoodAsManySamples) {
    const Renderer renderer(camera_of_large_cells());
    const RenderedImage image = renderer.render(large_cells());
    const RenderedImage samples =
        renderer.render(large_cells(), {.method = RenderMethod::exact_lens, .samples_per_side = 6});
    EXPECT_GT(tiles_by_table(image.plan), 500);
    EXPECT_EQ(tiles_by_table(samples.plan), 0);
    EXPECT_LT(255.0 * cv::norm(image.radiance, samples.radiance, cv::NORM_INF), 0.06);
}

TEST(EdgeGroup, GivesTheSameBytesOnAnyNumberOfThreadsAndInAnyRegion) {
    test::expect_the_same_everywhere(camera_of_large_cells(), large_cells(), {13, 7, 200, 190});
}

// The mean, over the pixel's square and half the ellipse that is the line spread of a disk, of the
// normal distribution's integral.
double blurred_edge(double distance, double blur_px, double angle, double sigma) {
    constexpr int n = 64;
    double sum = 0.0;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const double x = (i + 0.5) / n - 0.5, y = (j + 0.5) / n - 0.5;
            const double place = x * std::cos(angle) + y * std::sin(angle) - distance;
            for (int q = 0; q < n; ++q) {
                const double turn = pi * (q + 0.5) / n;  // by the rule of Chebyshev and Gauss
                const double weight = 2.0 / n * std::sin(turn) * std::sin(turn);
                sum += weight * 0.5 *
                       std::erfc(-(place + blur_px * std::cos(turn)) / sigma / std::sqrt(2.0));
            }
        }
    return sum / (n * n);
}

TEST(EdgeTable, IsTheProfileOfAnEdge) {
    constexpr double sigma = 0.4, energy = 0.9;
    const PointSpreadFunction spread = PointSpreadFunction::gaussian(sigma);
    const EdgeTable table([&](double r) { return spread.density(r); }, 6.0 * sigma, energy);
    EdgeProfile profile;
    for (const double blur : {2.6, 4.9, 11.3})
        for (const double angle : {0.0, 0.35, pi / 4}) {
            table.profile(blur, std::pow(std::sin(2.0 * angle), 2), profile);
            for (double distance = 0.0; distance < blur + 3.0; distance += 0.37) {
                const double place = EdgeTable::per_px * distance + profile.shift;
                const auto n = static_cast<std::size_t>(place);
                const double way = place - static_cast<double>(n);
                const double value =
                    n + 1 < profile.values.size()
                        ? (1.0 - way) * profile.values[n] + way * profile.values[n + 1]
                        : 0.0;
                EXPECT_NEAR(255.0 * value,
                            255.0 * energy * blurred_edge(distance, blur, angle, sigma), 0.02)
                    << blur << " px, " << angle << " rad, " << distance << " px";
            }
        }
}

// What every instruction set makes of one group.
TEST(EdgeGroup, IsTheSameWithAllInstructions) {
    const PointSpreadFunction spread = PointSpreadFunction::gaussian(0.4);
    const EdgeTable table([&](double r) { return spread.density(r); }, 2.4, 0.9);
    EdgeGroup group{0, 0, {}, 4.3f, 0.5f, 0.1f, 0.8f};
    group.distance = {0.7f, 13.0f, 0.05f, 0.0f, -8.0f, 0.03f, 0.0f, 0.0f, 0.04f};
    EdgeProfile profile;
    table.profile(group.blur, group.diagonal, profile);
    std::vector<float> first;
    on_every_target([&] {
        std::vector<float> values(64 + 256);
        edge_averages(group, values.data());
        add_edge(group, profile, 0.9f, 0, 16, values.data() + 64, 16);
        if (first.empty())
            first = values;
        for (std::size_t n = 0; n < values.size(); ++n)
            EXPECT_NEAR(255.0 * values[n], 255.0 * first[n], 1e-3);
    });
    EXPECT_FALSE(first.empty());
}

}  // namespace
}  // namespace etalon
