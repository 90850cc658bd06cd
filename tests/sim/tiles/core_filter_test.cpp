#include "sim/tiles/core_filter.h"

#include <random>

#include "sim/tiles/tail_pyramid.h"
#include "sim/tiles/undistortion_map.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

using std::numbers::pi;

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

struct FilterCase {
    int k, side;
    double refined;
    int reach_x, reach_y;
};

class AddFiltered : public testing::TestWithParam<FilterCase> {};

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
                         testing::Values(FilterCase{1, 4, 0.1, 7, 5}, FilterCase{2, 8, 0.05, 11, 4},
                                         FilterCase{3, 12, 0.05, 4, 8},
                                         FilterCase{4, 16, 0.02, 3, 3},
                                         FilterCase{5, 20, 0.02, 2, 3}, FilterCase{1, 2, 0.1, 6, 9},
                                         FilterCase{1, 1, 0.0, 5, 7},
                                         FilterCase{3, 12, 0.1, 0, 0}));

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

// ---- tail pyramid

constexpr double everywhere = std::numeric_limits<double>::infinity();

// A strip of pixels behind a lens with the wanted diffraction; in focus at 150 mm.
CameraModel strip_camera(double lambda_n_px) {
    CameraModel camera = camera_with(440, 24, {400.0, 400.0, 219.5, 11.5}, {},
                                     Sensor{.pixel_pitch_um = 6.0}, Lens{1.4, 150.0, 600.0, {}});
    camera.lens->wavelength_nm *= lambda_n_px / PointSpreadFunction::of(camera).scale_px();
    return camera;
}

// Black over white, far beyond the image on every side; black is where
// (x - cx - edge_px) cos + (y - cy) sin < 0, in pixels.
PlacedMarker half_plane(double z_mm, double edge_px, double angle) {
    constexpr double focal_px = 400.0;
    const double far_mm = 6000.0 * z_mm / focal_px;
    return {{cv::Mat::zeros(1, 1, CV_32FC1), {-far_mm, -far_mm}, {far_mm, 2.0 * far_mm}},
            {rotation_from_vector({0.0, 0.0, angle}), {edge_px * z_mm / focal_px, 0.0, z_mm}}};
}

// Core and tail of one marker, as the renderer adds them: radiance minus 1. The finest ring is so
// many grids coarser than it may be.
cv::Mat filtered(const CameraModel& camera, const PlacedMarker& marker, const Sampling& sampling,
                 double reach_px, const cv::Rect& region, int coarser = 0) {
    const ImageFilter filter(camera);
    const Projector projector(camera);
    const TailPyramid tail(filter, projector, {0, 0, camera.width, camera.height});
    const int reach = filter.reach_px();
    const UndistortionMap map(projector, reach + 16);
    const MarkerView view(marker, 1.0, aperture_of(camera));
    const cv::Rect squares = cells_of(grown(region, reach, reach), 8);
    const cv::Rect tiles(2 * squares.x, 2 * squares.y, 2 * squares.width, 2 * squares.height);
    const TileSamples samples(view, map, tiles, sampling);
    cv::Mat difference(region.size(), CV_32FC1);
    const int room = static_cast<int>(std::min(reach_px, 1e5)) + 1;
    const auto outline = marker_outline(view, projector, 31);
    const cv::Rect seen_at = tail.sources(samples, view, outline, grown(region, room, room));
    FarTail none(filter, region);
    const FilterKernel& core = filter.core(sampling.k, sampling.kind);
    tail.add(samples, view, seen_at, reach_px, filter.first_ring() + coarser, region, 0.0f, none,
             difference, [&](const cv::Rect& band) {
                 add_filtered(samples.field(), core, region, band, difference);
             });
    return difference;
}

cv::Rect whole(const CameraModel& camera) {
    return {0, 0, camera.width, camera.height};
}

// Brightness of a pixel at a distance from a straight edge with its normal at `angle`, from the
// spatial frequencies: 1/2 + integral of sin(2 pi nu t) / (pi nu) times the transfer functions of
// the circular pupil, the blur disk and the pixel's square.
double edge_response(double distance_px, double lambda_n_px, double blur_px, double angle) {
    const auto sinc = [](double x) { return x == 0.0 ? 1.0 : std::sin(pi * x) / (pi * x); };
    const double cutoff = 1.0 / lambda_n_px;
    constexpr int steps = 60000;
    double sum = 0.0;
    for (int i = 0; i < steps; ++i) {
        const double q = (i + 0.5) / steps, nu = q * cutoff, x = 2.0 * pi * blur_px * nu;
        const double pupil = 2.0 / pi * (std::acos(q) - q * std::sqrt(1.0 - q * q));
        const double disk = 2.0 * ::j1(x) / x;
        const double pixel = sinc(nu * std::cos(angle)) * sinc(nu * std::sin(angle));
        sum += std::sin(2.0 * pi * nu * distance_px) / (pi * nu) * pupil * disk * pixel;
    }
    return 0.5 + sum * cutoff / steps;
}

struct Edge {
    double lambda_n_px, blur_px, angle;
    int k;
    SampleKind kind;
};

class EdgeResponse : public testing::TestWithParam<Edge> {};

TEST_P(EdgeResponse, IsThatOfTheTransferFunctions) {
    const auto [lambda_n, blur, angle, k, kind] = GetParam();
    const CameraModel camera = strip_camera(lambda_n);
    const double edge = -0.3;
    const cv::Mat difference =
        filtered(camera, half_plane(depth_of_blur(camera, blur), edge, angle),
                 {.k = k, .kind = kind}, everywhere, whole(camera));
    const int y = 13;
    double worst = 0.0;
    for (int x = 0; x < camera.width; x += std::abs(x - 219) < 20 ? 1 : 7) {
        const double distance = (x - 219.5 - edge) * std::cos(angle) + (y - 11.5) * std::sin(angle);
        const double expected = edge_response(distance, lambda_n, blur, angle);
        const double error = std::abs(1.0 + difference.at<float>(y, x) - expected) / gray;
        EXPECT_LT(error, 0.02) << "pixel " << x;
        worst = std::max(worst, error);
    }
    RecordProperty("worst_gray", std::to_string(worst));
}

// The webcam's and the Canon's diffraction; so many samples that only the filter is tested.
INSTANTIATE_TEST_SUITE_P(Blurs, EdgeResponse,
                         testing::Values(Edge{0.22, 0.1, 0.0, 16, SampleKind::box},
                                         Edge{0.22, 0.5, 0.0, 16, SampleKind::point},
                                         Edge{0.22, 2.0, 0.4, 8, SampleKind::point},
                                         Edge{0.22, 8.0, 0.0, 4, SampleKind::point},
                                         Edge{0.513, 0.1, 0.4, 16, SampleKind::box},
                                         Edge{0.513, 0.5, 0.0, 16, SampleKind::point},
                                         Edge{0.513, 2.0, 0.0, 8, SampleKind::point},
                                         Edge{0.513, 8.0, 0.4, 4, SampleKind::point},
                                         Edge{0.03, 0.5, 0.0, 16, SampleKind::point},
                                         Edge{1.4, 0.5, 0.0, 12, SampleKind::point},
                                         Edge{3.0, 2.0, 0.0, 5, SampleKind::point}));

// Largest difference, in gray, that rings begun so many grids coarser make beside an edge.
double change_by_coarser_rings(const CameraModel& camera, double blur_px, int coarser) {
    double largest = 0.0;
    for (const double angle : {0.0, 0.37})
        for (const double edge : {0.0, 1.3}) {
            const PlacedMarker plane = half_plane(depth_of_blur(camera, blur_px), edge, angle);
            const Sampling sampling{.k = 8, .kind = SampleKind::point};
            const auto image = [&](int grids) {
                return filtered(camera, plane, sampling, 40.0, whole(camera), grids);
            };
            largest = std::max(largest, cv::norm(image(0), image(coarser), cv::NORM_INF) / gray);
        }
    return largest;
}

TEST(TailPyramid, CoarserRingsOfBlurredImagesAreWithinTheirBound) {
    for (const double lambda_n : {0.22, 1.7})
        for (const double blur : {2.1, 6.7}) {
            const CameraModel camera = strip_camera(lambda_n);
            const ImageFilter filter(camera);
            EXPECT_EQ(filter.gray_of_coarser_ring(filter.first_ring(), blur), 0.0);
            for (const int coarser : {1, 2}) {
                const double change = change_by_coarser_rings(camera, blur, coarser);
                EXPECT_LT(change, filter.gray_of_coarser_ring(filter.first_ring() + coarser, blur));
                EXPECT_GT(change, 1e-5);
            }
        }
}

// Where the pattern falls with the third power of the distance r: lambda N / (pi^3 r^3) a pixel.
TEST(TailPyramid, FarFromAMarkerIsThePatternTimesItsArea) {
    CameraModel camera = strip_camera(0.51);
    camera.width = 900;
    camera.height = 700;
    camera.intrinsics = {400.0, 400.0, 260.0, 190.0};
    PlacedMarker square = half_plane(150.0, 0.0, 0.0);
    constexpr double side = 160.0;
    square.grid.cell_mm = Eigen::Vector2d::Constant(side * 150.0 / 400.0);
    square.grid.corner_mm = -0.5 * square.grid.cell_mm;
    const cv::Mat difference =
        filtered(camera, square, {.k = 4, .kind = SampleKind::point}, everywhere, whole(camera));
    // Some grays at the first, hundredths at the last.
    for (const cv::Point at :
         {cv::Point(350, 187), {261, 50}, {390, 211}, {440, 190}, {120, 360}}) {
        constexpr int parts = 64;
        double expected = 0.0;
        for (int n = 0; n < parts * parts; ++n) {
            const double x = 260.0 + side * ((n % parts + 0.5) / parts - 0.5);
            const double y = 190.0 + side * ((n / parts + 0.5) / parts - 0.5);
            const double r = std::hypot(at.x - x, at.y - y);
            expected -= side * side / (parts * parts) * 0.51 / (pi * pi * pi * r * r * r);
        }
        EXPECT_LT(expected, -0.009 * gray) << at;
        EXPECT_NEAR(difference.at<float>(at), expected, 0.004 * gray) << at;
    }
}

TEST(TailPyramid, SeesWhatLiesOutsideTheImage) {
    const CameraModel camera = strip_camera(0.513);
    const double blur = 1.0, edge = -270.0;  // 50 px beyond the left border
    const cv::Mat difference =
        filtered(camera, half_plane(depth_of_blur(camera, blur), edge, 0.0),
                 {.k = 4, .kind = SampleKind::point}, everywhere, whole(camera));
    for (const int x : {0, 3, 40, 300}) {
        const double expected = edge_response(x - 219.5 - edge, 0.513, blur, 0.0);
        EXPECT_LT(expected, 1.0 - 1e-6);
        EXPECT_NEAR(1.0 + difference.at<float>(7, x), expected, 0.005 * gray) << x;
    }
}

TEST(TailPyramid, FollowsOblongPixels) {
    // Pixels 1.6 times as high as wide: across a horizontal edge lengths count in heights.
    CameraModel camera = strip_camera(0.4);
    std::swap(camera.width, camera.height);
    camera.intrinsics = {400.0, 250.0, 11.5, 219.5};
    const double blur = 1.1, z = depth_of_blur(camera, blur);
    PlacedMarker marker = half_plane(z, 0.0, pi / 2);
    const cv::Mat difference =
        filtered(camera, marker, {.k = 16, .kind = SampleKind::point}, everywhere, whole(camera));
    for (int y = 20; y < camera.height; y += 5) {
        const double expected = edge_response(y - 219.5, 0.4 / 1.6, blur / 1.6, 0.0);
        EXPECT_NEAR(1.0 + difference.at<float>(y, 9), expected, 0.02 * gray) << y;
    }
}

// Largest tail that an area can have at a distance r or beyond, from the exact pattern.
double largest_tail(const PointSpreadFunction& psf, double r, double area_px) {
    double density = 0.0;
    for (int i = 0; i < 20000; ++i)
        density = std::max(density, psf.density(r * (1.0 + 1e-4 * i)));
    return std::min(1.0 - psf.energy_within(r), area_px * density) / gray;
}

TEST(TailReach, OmitsNoMoreThanItSays) {
    for (const double lambda_n : {0.05, 0.22, 0.513, 3.0})
        for (const double area_px : {1.0, 2900.0, 1e7})
            for (const double contrast : {0.1, 1.0})
                for (const double allowed : {0.003, 0.01, 0.3}) {
                    const CameraModel camera = strip_camera(lambda_n);
                    const auto psf = PointSpreadFunction::airy(lambda_n);
                    const double reach =
                        ImageFilter(camera).tail_reach_px(contrast, area_px, allowed);
                    // The core holds the pattern up to 1.5 px or 3 lambda N.
                    const double r = std::max({reach, 1.5, 3.0 * lambda_n});
                    EXPECT_LE(contrast * largest_tail(psf, r, area_px), 1.0001 * allowed);
                    if (reach > 0.0) {  // nor much less
                        EXPECT_GT(contrast * largest_tail(psf, 0.7 * reach, area_px), allowed);
                    }
                }
}

TEST(TailReach, OfASmallMarkerIsTensOfPixels) {
    const ImageFilter webcam(strip_camera(0.22));
    EXPECT_LT(webcam.tail_reach_px(1.0, 54.0 * 54.0, 0.01), 110.0);
    EXPECT_GT(webcam.tail_reach_px(1.0, 1e9, 0.01), 1000.0);
    EXPECT_EQ(webcam.tail_reach_px(0.0, 1e9, 0.01), 0.0);
}

}  // namespace
}  // namespace etalon
