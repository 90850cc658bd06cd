#include "sim/tiles/tile_evaluator.h"

#include "bench/benchmark_scenes.h"
#include "sim/render/sampling_bound.h"
#include "sim/tiles/tile_samples.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

// The integral of x^n from a to b, by b - a.
double mean_power(int n, double a, double b) {
    return (std::pow(b, n + 1) - std::pow(a, n + 1)) / ((n + 1) * (b - a));
}

// Of degree five in each direction, at (s, t) or averaged over squares of this width around it.
double quintic(double s, double t, double width) {
    const auto power = [&](int n, double x) {
        return width > 0.0 ? mean_power(n, x - width / 2, x + width / 2) : std::pow(x, n);
    };
    return 0.3 + 2.0 * power(5, s) * power(2, t) - 1.7 * power(3, s) * power(4, t) +
           0.9 * power(1, s) - 1.1 * power(5, t);
}

void expect_quintics_kept(SampleKind kind, int coarse_k, int k) {
    const TilePositions coarse(4 * coarse_k, TileInterpolation::margin), fine(4 * k);
    const auto side = static_cast<std::size_t>(TileInterpolation::side(coarse_k));
    ASSERT_EQ(coarse.n, TileInterpolation::side(coarse_k));
    // What lies behind the samples must not be used.
    std::vector<float> from(side * side), scratch((side + 1) * static_cast<std::size_t>(4 * k),
                                                  std::numeric_limits<float>::quiet_NaN());
    std::vector<float> values(static_cast<std::size_t>(16 * k * k));
    for (std::size_t i = 0; i < from.size(); ++i) {
        const auto place = [&](std::size_t n) {
            return (static_cast<double>(n) - TileInterpolation::margin + 0.5) / (4 * coarse_k) -
                   0.5;
        };
        from[i] = static_cast<float>(quintic(place(i % side), place(i / side), 0.0));
    }
    TileInterpolation(coarse_k, k, kind).interpolate(from.data(), scratch, values.data());
    const double width = kind == SampleKind::box ? 0.25 / k : 0.0;
    for (int i = 0; i < 16 * k * k; ++i)
        EXPECT_NEAR(values[static_cast<std::size_t>(i)],
                    quintic((i % (4 * k) + 0.5) / (4 * k) - 0.5,
                            (i / (4 * k) + 0.5) / (4 * k) - 0.5, width),
                    2e-6)
            << coarse_k << " " << k << " " << i;
}

TEST(TileInterpolation, KeepsQuinticPolynomials) {
    for (const auto& [coarse_k, k] : {std::pair{2, 5}, {3, 37}, {8, 12}, {16, 17}}) {
        expect_quintics_kept(SampleKind::point, coarse_k, k);
        expect_quintics_kept(SampleKind::box, coarse_k, k);
    }
    expect_quintics_kept(SampleKind::disk, 18, 9);
}

TEST(TileInterpolation, ThinsOutWithoutTheFrequenciesThatTheCoarserGridCannotTell) {
    constexpr int k = 6;
    const auto side = static_cast<std::size_t>(TileInterpolation::side(2 * k));
    std::vector<float> from(side * side), scratch, values(16 * k * k);
    // A wave of 2 k px^-1 (1 - 2 phase) is one of phase cycles a sample to the coarser grid.
    for (const double phase : {0.0, 0.05, 0.1}) {
        for (std::size_t i = 0; i < from.size(); ++i)
            from[i] = static_cast<float>(std::cos(2.0 * std::numbers::pi * (0.5 - 0.5 * phase) *
                                                  static_cast<double>(i % side)));
        TileInterpolation(2 * k, k, SampleKind::disk)
            .interpolate(from.data(), scratch, values.data());
        for (const float value : values)
            EXPECT_LT(std::abs(value), 1e-6 + 18.0 * std::pow(phase, 3.0)) << phase;
    }
}

TEST(TilePositions, ContinueBeyondTheTile) {
    const TilePositions inner(8), all(8, 4);
    ASSERT_EQ(all.n, 16);
    // The inner blocks are those of the second and third row and column of four.
    for (int block = 0; block < 4; ++block)
        for (int i = 0; i < 16; ++i) {
            const int with_margin = 16 * (4 * (1 + block / 2) + 1 + block % 2) + i;
            EXPECT_EQ(all.s[with_margin], inner.s[16 * block + i]);
            EXPECT_EQ(all.t[with_margin], inner.t[16 * block + i]);
        }
    EXPECT_FLOAT_EQ(all.s[0], -0.5f - 3.5f / 8.0f);
    EXPECT_FLOAT_EQ(all.t[255], 0.5f + 3.5f / 8.0f);
}

// ---- Tiles of stripes, oblique in the image and tilted in depth, wider than the blur: a pixel
// sees one edge at most

struct StripedView {
    explicit StripedView(double blur_px, const Distortion& distortion = {})
        : camera(distorted_camera(distortion)),
          map(Projector(camera), 8),
          view(marker(blur_px), 0.0, aperture_of(camera)) {}

    static CameraModel distorted_camera(const Distortion& distortion) {
        CameraModel camera = small_camera({});
        camera.distortion = distortion;
        return camera;
    }

    PlacedMarker marker(double blur_px) const {
        const double z = depth_of_blur(camera, blur_px);
        PlacedMarker plane = test::half_plane(0.0, z).markers[0];
        plane.grid.cells = cv::Mat_<float>::zeros(1, 60);
        for (int i = 0; i < 60; i += 2)
            plane.grid.cells.at<float>(0, i) = 1.0f;
        plane.grid.cell_mm.x() = (2.0 * blur_px + 2.3) * z / 400.0;
        plane.grid.corner_mm.x() = -30.0 * plane.grid.cell_mm.x();
        plane.camera_from_marker.rotation = Eigen::AngleAxisd(0.35, Eigen::Vector3d::UnitZ()) *
                                            Eigen::AngleAxisd(0.002, Eigen::Vector3d::UnitY());
        return plane;
    }

    TileSamples samples(const Sampling& sampling) const {
        return {view, map, cv::Rect(4, 3, 16, 12), sampling};
    }

    CameraModel camera;
    UndistortionMap map;
    MarkerView view;
};

// Of a refined tile; null: it has none.
const float* samples_of(const TileSamples& samples, int i, int j) {
    return *samples.map().details_from({i, j}) == TileDetail::samples
               ? *samples.map().finer_from({i, j}) + TileSamples::samples_offset
               : nullptr;
}

// The averages of a tile's pixels.
cv::Mat_<float> pixel_means(const TileSamples& samples, int i, int j) {
    cv::Mat_<float> means(4, 4, samples.map().at({i, j}));
    if (!samples.map().tiles().contains({i, j}) || !samples.map().refined(i, j))
        return means;
    const int k = samples.k();
    cv::Mat values(4 * k, 4 * k, CV_32FC1);
    std::copy_n(samples_of(samples, i, j), values.total(), values.ptr<float>());
    for (int p = 0; p < 16; ++p)
        means(p / 4, p % 4) =
            static_cast<float>(cv::mean(values(cv::Rect(p % 4 * k, p / 4 * k, k, k)))[0]);
    return means;
}

// Largest difference of the pixels' means.
double largest_difference(const TileSamples& a, const TileSamples& b) {
    double largest = 0.0;
    for_each_cell(a.tiles(), [&](int i, int j) {
        largest =
            std::max(largest, test::largest_difference(pixel_means(a, i, j), pixel_means(b, i, j)));
    });
    return largest;
}

// The mean of a pixel's averages is the integral of the coarse interpolant, whose error the bound
// knows.
TEST(TileEvaluator, CoarseTilesAreWithinTheirBound) {
    const SamplingBound bound(nullptr);
    for (const auto& [blur_px, coarse_k] :
         {std::pair{0.5, 6}, {0.5, 12}, {1.0, 4}, {1.0, 8}, {2.0, 3}, {4.0, 2}, {10.0, 2}}) {
        const StripedView stripes(blur_px);
        Sampling direct{.k = 20, .kind = SampleKind::box, .exact_lens_from_px = 0.0};
        Sampling coarse = direct;
        coarse.coarser = {{0.9 * blur_px, coarse_k}};
        const TileSamples truth = stripes.samples(direct), samples = stripes.samples(coarse);
        ASSERT_EQ(samples.used().size(), 1u);
        EXPECT_EQ(samples.used()[0].points_per_pixel_side, coarse_k);
        EXPECT_EQ(samples.used()[0].method, RenderMethod::exact_lens);
        EXPECT_EQ(truth.used()[0].points_per_pixel_side, 40);
        const double allowed =
            bound.of_points(coarse_k, 0.9 * blur_px, ~EdgeTangents{}) * gray + 0.005 * gray;
        const double difference = largest_difference(samples, truth);
        EXPECT_LT(difference, allowed) << blur_px << " px, k = " << coarse_k;
        // Not for want of an edge: the interpolant is not exact.
        EXPECT_GT(difference, 1e-7) << blur_px << " px, k = " << coarse_k;
    }
}

TEST(TileEvaluator, EachTileTakesTheCoarsestGridThatItsOwnBlurAllows) {
    StripedView stripes(1.0);
    const Sampling sampling{
        .k = 16, .kind = SampleKind::point, .coarser = {{3.0, 2}, {0.9, 4}, {0.1, 8}}};
    const TileSamples samples = stripes.samples(sampling);
    ASSERT_EQ(samples.used().size(), 1u);
    EXPECT_EQ(samples.used()[0].points_per_pixel_side, 4);
    const Sampling too_sharp{.k = 16, .kind = SampleKind::point, .coarser = {{3.0, 2}}};
    EXPECT_EQ(stripes.samples(too_sharp).used()[0].points_per_pixel_side, 16);
}

TEST(TileEvaluator, TilesThatBendTooMuchForAPolynomialTakeCoarserGridsToo) {
    // Even cubics through points within a tile err by more than 1e-4 px.
    const CameraModel camera =
        camera_with(32, 24, {311.0, 311.0, 17.0, 11.0}, {.k1 = 0.16, .k2 = -0.08, .s4 = -320.0},
                    Sensor{.pixel_pitch_um = 4.2}, Lens{1.4, 40.0, 550.0, {}});
    const UndistortionMap map(Projector(camera), 16);
    const cv::Rect tiles(0, 0, 8, 6);
    int bent = 0;
    for_each_cell(tiles, [&](int i, int j) {
        bent += map.validity(i, j) == UndistortionMap::Validity::some;
    });
    ASSERT_GT(bent, 10);
    const cv::Mat cells = (cv::Mat_<float>(3, 2) << 0.0f, 1.0f, 1.0f, 0.2f, 0.7f, 0.0f);
    const PlacedMarker marker{
        {cells, {-30.0, -25.0}, {27.0, 19.0}},
        {Eigen::Quaterniond(Eigen::AngleAxisd(0.4, Eigen::Vector3d(0.36, 0.48, 0.8))),
         900.0 * map.exact({15.0, 11.0})->x.homogeneous()}};
    const MarkerView view(marker, 0.5, aperture_of(camera));
    constexpr int k = 12, coarse_k = 4;
    const Sampling own{.k = k, .kind = SampleKind::point};
    const Sampling coarser{.k = k, .kind = SampleKind::point, .coarser = {{3.0, coarse_k}}};
    const TileSamples truth(view, map, tiles, own), samples(view, map, tiles, coarser);
    ASSERT_EQ(samples.used().size(), 1u);
    EXPECT_EQ(samples.used().front().points_per_pixel_side, coarse_k);
    EXPECT_EQ(truth.used().front().points_per_pixel_side, k);
    // Of six points 1/4 px apart, at the rim of disks of 3 px and more: 1 gray at most. A point in
    // the wrong place by an eighth of a px would be off by 5 gray.
    double largest = 0.0, brightest = 0.0;
    for (int j = 0; j < tiles.height; ++j)
        for (int i = 0; i < tiles.width; ++i)
            for (int p = 0; p < 16 * k * k && samples_of(truth, i, j); ++p) {
                largest = std::max<double>(
                    largest, std::abs(samples_of(samples, i, j)[p] - samples_of(truth, i, j)[p]));
                brightest = std::max<double>(brightest, samples_of(truth, i, j)[p]);
            }
    EXPECT_LT(largest, 1.0 * gray);
    EXPECT_GT(largest, 0.0);
    EXPECT_GT(brightest, 0.3);
}

// ---- Disk samples with the lens

// The mean of exact lens averages over a disk on the sensor, by rings and spokes.
double mean_over_disk(const StripedView& stripes, const Eigen::Vector2d& pixel, double radius_px) {
    constexpr int rings = 24, spokes = 48;
    LensAverage lens_average(stripes.view);
    const Intrinsics& intrinsics = stripes.camera.intrinsics;
    double sum = 0.0;
    for (int ring = 0; ring < rings; ++ring)
        for (int spoke = 0; spoke < spokes; ++spoke) {
            const double r = radius_px * std::sqrt((ring + 0.5) / rings);
            const double angle = 2.0 * std::numbers::pi * (spoke + 0.5 * (ring % 2)) / spokes;
            const Eigen::Vector2d step(std::cos(angle),
                                       std::sin(angle) * intrinsics.fy / intrinsics.fx);
            const auto point = stripes.map.exact(pixel + r * step);
            const auto range = stripes.view.footprint({point->x, point->x});
            sum += range ? lens_average.at(point->x, *range) : 0.0;
        }
    return sum / (rings * spokes);
}

// In a camera whose distortion makes the blur disk an ellipse on the sensor.
TEST(TileEvaluator, DiskSamplesAreAveragesOverDiskAndLens) {
    for (const double blur_px : {0.05, 0.25, 0.6}) {
        StripedView stripes(blur_px, {.k1 = -2.5, .k2 = 9.0});
        const int k = 2;
        Sampling sampling{.k = k, .kind = SampleKind::disk};
        sampling.disk_radius_px = 0.3;
        sampling.disks = 4;
        const cv::Rect tiles(1, 1, 3, 3);  // near the corner
        const TileSamples samples(stripes.view, stripes.map, tiles, sampling, true);
        double largest = 0.0;
        for (int j = tiles.y; j < tiles.br().y; ++j)
            for (int i = tiles.x; i < tiles.br().x; ++i)
                for (int p = 0; p < 16 * k * k; p += 5) {
                    const Eigen::Vector2d place(p % (4 * k) + 0.5, p / (4 * k) + 0.5);
                    const double truth = mean_over_disk(
                        stripes, UndistortionMap::tile_corner_px(i, j) + place / k, 0.3);
                    largest = std::max(largest, std::abs(samples_of(samples, i, j)[p] - truth));
                }
        EXPECT_LT(largest, 1.0 * gray) << blur_px;
        EXPECT_GT(largest, 0.0);
    }
}

// ---- Frames in which the plane of sharp focus crosses the marker, or almost

void expect_near_focus_as_reference(double wavelength_nm, double z, RenderMethod method) {
    const BenchmarkScene webcam = benchmark_scene("webcam-500");  // focused at 150 mm
    CameraModel camera = webcam.camera;
    camera.lens->wavelength_nm = wavelength_nm;
    Scene scene = webcam.scene;
    scene.markers[0].camera_from_marker.translation = {3.0, -2.0, z};
    const RenderedImage image = Renderer(camera).render(scene);
    EXPECT_EQ(image.plan.method, method) << image.plan.describe();
    std::vector<cv::Point> pixels;
    for (int n = 0; n < 30; ++n)
        pixels.push_back({240 + 37 * n % 167, 150 + 53 * n % 173});
    // Where a rare sample would have counted, none may have been drawn.
    const double one_sample = 1.0 / (16.0 * 512.0);
    const auto reference =
        integrate_reference(camera, scene, pixels, {.samples_per_scramble = 512});
    for (std::size_t n = 0; n < pixels.size(); ++n)
        EXPECT_LT(std::abs(image.radiance.at<float>(pixels[n]) - reference[n].mean),
                  0.1 * gray + one_sample + 4.0 * reference[n].standard_error)
            << pixels[n] << " at " << z << " mm";
}

TEST(TileEvaluator, FramesNearFocusAreThoseOfTheReference) {
    for (const double z : {152.0, 155.0, 180.0})
        expect_near_focus_as_reference(650.0, z, RenderMethod::wedge_table);
    // By disks, where the point spread is too narrow for the table of edges and corners.
    for (const double z : {152.0, 155.0})
        expect_near_focus_as_reference(560.0, z, RenderMethod::exact_area);
}

}  // namespace
}  // namespace etalon
