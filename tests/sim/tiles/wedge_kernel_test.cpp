// Pixels by the table of edges and corners against sums over the pixel, the lens and the spread.
#include <Eigen/Core>

#include "sim/psf/diffraction.h"
#include "sim/psf/wedge_table.h"
#include "sim/tiles/edge_group.h"
#include "sim/tiles/tile_kernel.h"
#include "tests/sim/edge_scenes.h"
#include "tests/sim/every_target.h"

namespace etalon {
namespace {

using std::numbers::pi;

constexpr double gaussian_sigma = 0.3;

const WedgeTable& narrow_table() {
    constexpr double reach = 6.0 * gaussian_sigma;
    static const WedgeTable table{radial_transfer(
                                      PointSpreadFunction::gaussian(gaussian_sigma),
                                      [](double) { return 1.0; }, reach, WedgeTable::end_px(reach)),
                                  reach};
    return table;
}

// The corner of a white quadrant, seen in a tile with a lens.
struct Corner {
    std::string name;
    Eigen::Vector2d at;  // from the tile's middle, px
    double turn, angle;  // of the first line's normal, and from that to the second's
    double blur = 0.0;   // at the tile's middle
    Eigen::Vector2d slope = {0.0, 0.0};
    double stretch = 0.0;    // of the blur in x, and squeezed as much in y
    double curvature = 0.0;  // of the tile's points: d^2 x / d s^2 in px

    double turns = 1.0;  // the lens' turn in units of the slope; 1 where the focus is the sensor's

    Eigen::Vector2d normal(int line) const {
        const double direction = turn + line * angle;
        return {std::cos(direction), std::sin(direction)};
    }
    // How the blur lies across a line, in units of the blur.
    Eigen::Vector2d across(int line) const {
        return normal(line).cwiseProduct(Eigen::Vector2d(1.0 + stretch, 1.0 / (1.0 + stretch)));
    }
};

TileGeometry tile_of(const Corner& corner) {
    TileGeometry tile{};
    tile.dx[1] = tile.dy[4] = 4.0f;
    tile.dx[2] = static_cast<float>(8.0 * corner.curvature);
    tile.blur = static_cast<float>(corner.blur);
    tile.blur_slope_x = static_cast<float>(corner.slope.x());
    tile.blur_slope_y = static_cast<float>(corner.slope.y());
    tile.lens_turn_x = static_cast<float>(corner.turns * corner.slope.x());
    tile.lens_turn_y = static_cast<float>(corner.turns * corner.slope.y());
    const auto line = [&](int which) {
        const Eigen::Vector2f n = corner.normal(which).cast<float>();
        const Eigen::Vector2f m = corner.across(which).cast<float>();
        return TileLine{-n.dot(corner.at.cast<float>()), n.x(), n.y(), m.x(), m.y()};
    };
    tile.columns = {line(0)};
    tile.rows = {line(1)};
    tile.cells = {0.0, 0.0, 0.0, 1.0};
    return tile;
}

// Of the normal distribution the part where x > -a and, with this correlation, y > -b; by Gauss'
// two nodes in each of many steps.
double both_beyond(double a, double b, double correlation) {
    constexpr int steps = 40;
    constexpr double end = 6.0;
    const double begin = std::max(-a, -end);
    double sum = 0.0;
    for (int i = 0; i < 2 * steps; ++i) {
        const double place = i / 2 + 0.5 + (i % 2 == 0 ? -0.5 : 0.5) / std::sqrt(3.0);
        const double z = begin + place / steps * (end - begin);
        const double rest = (b + correlation * z) / std::sqrt(1.0 - correlation * correlation);
        sum += std::exp(-0.5 * z * z) * 0.5 * std::erfc(-rest / std::numbers::sqrt2);
    }
    return begin < end ? sum * (end - begin) / (2 * steps) / std::sqrt(2.0 * pi) : 0.0;
}

// Through one point of the lens the quadrant is a wedge on the sensor.
double through_lens(const Corner& corner, const Eigen::Vector2d& x, const Eigen::Vector2d& l) {
    double value[2];
    Eigen::Vector2d gradient[2];
    const double scale = 1.0 - corner.turns * corner.slope.dot(l);
    for (const int line : {0, 1}) {
        const double lens = corner.across(line).dot(l);
        value[line] = corner.normal(line).dot(x - corner.at) * scale +
                      (corner.blur + corner.slope.dot(x)) * lens;
        gradient[line] = corner.normal(line) * scale + corner.slope * lens;
    }
    const double a = gradient[0].norm(), b = gradient[1].norm();
    return both_beyond(value[0] / (a * gaussian_sigma), value[1] / (b * gaussian_sigma),
                       gradient[0].dot(gradient[1]) / (a * b));
}

double mean_over_lens(const Corner& corner, const Eigen::Vector2d& x) {
    constexpr int rings = 8, spokes = 16;
    if (corner.blur == 0.0 && corner.slope.isZero())
        return through_lens(corner, x, {0.0, 0.0});
    double sum = 0.0;
    for (int q = 0; q < rings * spokes; ++q) {
        const double radius = std::sqrt((q / spokes + 0.5) / rings);
        const double turn = 2.0 * pi * (q % spokes + 0.5 * (q / spokes % 2)) / spokes;
        sum += through_lens(corner, x, {radius * std::cos(turn), radius * std::sin(turn)});
    }
    return sum / (rings * spokes);
}

double truth_at(const Corner& corner, int column, int row) {
    constexpr int side = 8;  // Gauss' two nodes in each quarter
    double sum = 0.0;
    const auto node = [](int n) {
        return (n / 2 + 0.5 + (n % 2 == 0 ? -0.5 : 0.5) / std::sqrt(3.0)) / (side / 2);
    };
    for (int n = 0; n < side * side; ++n) {
        const double s = (node(n % side) + column) / 4.0 - 0.5;
        const double t = (node(n / side) + row) / 4.0 - 0.5;
        sum += mean_over_lens(corner, {4.0 * s + 8.0 * corner.curvature * s * s, 4.0 * t});
    }
    return sum / (side * side);
}

const Corner corners[] = {
    {"sharp", {0.4, 0.3}, 0.0, pi / 2},
    {"turned", {-0.3, 0.7}, 0.3, pi / 2},
    {"acute", {0.2, -0.6}, 0.7, 2.4},
    {"obtuse, blurred", {0.1, 0.2}, -2.1, 0.9, 0.7},
    {"through focus", {-0.4, 0.1}, 1.2, 1.5, 0.08, {0.05, -0.04}},
    {"steep", {0.3, 0.3}, 0.25, pi / 2, 0.5, {0.06, 0.02}},
    {"tilted focus", {0.1, -0.2}, 0.4, 1.4, 0.6, {0.04, -0.03}, 0.0, 0.0, 0.8},
    {"stretched", {-0.2, 0.4}, 0.6, 1.7, 0.6, {0.0, 0.0}, 0.05},
    {"stretched and steep", {0.2, -0.1}, -0.8, 1.4, 0.4, {0.04, 0.02}, 0.05},
    {"bent", {-1.1, 0.4}, 0.2, 1.7, 0.0, {0.0, 0.0}, 0.0, 0.002},
};

TEST(WedgePixels, AreSumsOverPixelLensAndSpread) {
    const TilePositions positions(4);
    for (const Corner& corner : corners) {
        const WedgeRows rows = narrow_table().rows(0.0, 1.0);
        constexpr int pixels[] = {0, 5, 6, 9, 10, 11, 15};
        double truth[16] = {};
        for (const int n : pixels)
            truth[n] = truth_at(corner, n % 4, n / 4);
        EXPECT_GT(*std::ranges::max_element(truth), 0.2);
        on_every_target([&] {
            float values[16];
            wedge_pixels(tile_of(corner), positions, rows, values);
            for (const int n : pixels)
                EXPECT_NEAR(255.0 * values[n], 255.0 * truth[n], 0.05)
                    << corner.name << ", pixel " << n;
        });
    }
}

TEST(WedgePixels, AreFiniteHoweverFarTheLinesAre) {
    Corner corner{"far", {0.0, 0.0}, 0.4, 1.3, 0.3, {0.02, 0.01}};
    for (const double far : {1e4, 1e8}) {
        corner.at = far * (corner.normal(0) + corner.normal(1));
        float values[16];
        for (const double sign : {-1.0, 1.0}) {
            TileGeometry tile = tile_of(corner);
            tile.columns[0].offset *= static_cast<float>(sign);
            tile.rows[0].offset *= static_cast<float>(sign);
            tile.dx[2] = 0.003f;
            wedge_pixels(tile, TilePositions(4), narrow_table().rows(0.0, 1.0), values);
            for (const float value : values)
                EXPECT_EQ(value, sign < 0.0 ? 1.0f : 0.0f) << far;
        }
    }
}

// Its distortion folds 218 px from the middle.
CameraModel folding() {
    return camera_with(640, 480, {400.0, 400.0, 319.5, 239.5}, {.k1 = -0.5},
                       Sensor{.pixel_pitch_um = 8.3}, Lens{2.8, 150.0, 650.0, {}});
}

// 2 x 2 cells of 5 mm, somewhat before the plane of focus.
PlacedMarker four_cells(const cv::Mat& cells, double x_mm) {
    return {{cells, Eigen::Vector2d::Zero(), {5.0, 5.0}},
            {Eigen::Quaterniond::Identity(), {x_mm, -4.0, 150.5}}};
}

// Far from the marker the image may hold the border of the valid region, whose tiles have samples
// of their own when none is left out.
TEST(WedgePixels, AreTheBackgroundAtTheBorderOfTheValidRegion) {
    const Scene scene{{four_cells((cv::Mat_<float>(2, 2) << 0.1f, 0.9f, 0.8f, 0.2f), -5.0)}, 0.4};
    const Renderer renderer(folding());
    const RenderedImage image = renderer.render(scene);
    const RenderedImage all = renderer.render(scene, {.keep = {NeglectedEffect::uniform_tiles}});
    EXPECT_EQ(image.plan.method, RenderMethod::wedge_table);
    EXPECT_EQ(all.plan.method, RenderMethod::wedge_table);
    EXPECT_LT(cv::countNonZero(image.valid), 640 * 480);
    EXPECT_LT(255.0 * cv::norm(image.radiance, all.radiance, cv::NORM_INF), 4e-3);
}

TEST(WedgePixels, AreNotTakenBesideTheBorderOfTheValidRegion) {
    const cv::Mat cells = (cv::Mat_<float>(2, 2) << 0.5f, 0.6f, 0.6f, 0.5f);
    for (const double x_mm : {88.0, 93.0, 98.0}) {
        const RenderedImage image = Renderer(folding()).render({{four_cells(cells, x_mm)}, 0.5});
        EXPECT_NE(image.plan.method, RenderMethod::wedge_table) << x_mm;
    }
}

// A marker through the plane of focus, with distortion.
CameraModel near_focus() {
    return camera_with(320, 240, {540.0, 540.0, 60.2, 50.7}, {.k1 = -0.28, .p1 = 0.002},
                       Sensor{.pixel_pitch_um = 8.3}, Lens{2.8, 150.0, 650.0, {}});
}

Scene tilted_cells() {
    const cv::Mat cells = (cv::Mat_<float>(3, 4) << 0.05f, 0.9f, 0.1f, 0.8f, 0.8f, 0.1f, 0.7f, 0.2f,
                           0.3f, 0.0f, 1.0f, 0.1f);
    return {{{{cells, {-7.0, -4.5}, {3.5, 3.0}},
              {rotation_from_vector({0.5, 0.4, 0.3}), {25.0, 17.5, 151.0}}}},
            0.6};
}

TEST(WedgePixels, AreAsGoodAsManySamples) {
    const Renderer renderer(near_focus());
    const RenderedImage image = renderer.render(tilted_cells());
    const RenderedImage samples = renderer.render(tilted_cells(), {.samples_per_side = 32});
    EXPECT_EQ(image.plan.method, RenderMethod::wedge_table);
    EXPECT_EQ(samples.plan.method, RenderMethod::exact_area);
    EXPECT_EQ(image.plan.min_blur_radius_px, 0.0);
    EXPECT_GT(image.plan.max_blur_radius_px, 0.08);
    EXPECT_LT(255.0 * cv::norm(image.radiance, samples.radiance, cv::NORM_INF), 0.06);
}

TEST(WedgePixels, AreTheSameOnAnyNumberOfThreadsAndInAnyRegion) {
    expect_the_same_everywhere(near_focus(), tilted_cells(), {131, 92, 50, 41});
}

// ---- edge group

// Cells of 120 px, blurred by 5 to 8 px, under some distortion.
CameraModel camera_of_large_cells() {
    return camera_with(320, 240, {2000.0, 2000.0, 160.2, 118.7}, {.k1 = -0.2, .p1 = 0.002},
                       Sensor{.pixel_pitch_um = 5.0}, Lens{1.4, 900.0, 1200.0, {}});
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
    expect_the_same_everywhere(camera_of_large_cells(), large_cells(), {13, 7, 200, 190});
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
