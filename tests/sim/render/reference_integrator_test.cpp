// A measured radial profile in place of diffraction and defocus.
#include "sim/render/reference_integrator.h"

#include "bench/benchmark_scenes.h"
#include "sim/psf/diffraction.h"
#include "sim/psf/point_spread_sampler.h"
#include "sim/render/sampling_bound.h"
#include "sim/scene/pose_sampling.h"
#include "sim/tiles/image_filter.h"
#include "tests/evidence/edge_spread.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

TEST(SobolPoints, FillEveryElementaryIntervalOnceUnderAnyScramble) {
    // 64 points of a (0, 6, 1) sequence in each coordinate: one in every 64th.
    const SobolPoints points(64);
    for (std::uint32_t number : {0u, 5u}) {
        const auto scramble = make_scramble(11, 3, 4, number);
        for (std::size_t d = 0; d < SobolPoints::dimensions; ++d) {
            std::vector<int> hits(64, 0);
            for (int i = 0; i < 64; ++i)
                ++hits[static_cast<std::size_t>(64.0 * points.point(i, scramble)[d])];
            EXPECT_EQ(hits, std::vector<int>(64, 1)) << "dimension " << d;
        }
    }
}

TEST(SobolPoints, ScramblesAreIndependent) {
    // Means of a smooth function over 16 points: over 400 scrambles, neighbours are uncorrelated.
    // The correlation of independent pairs has the standard deviation 1/20; allowed: four of them.
    const SobolPoints points(16);
    std::vector<double> means;
    for (std::uint32_t number = 0; number < 400; ++number) {
        const auto scramble = make_scramble(2, 7, 5, number);
        double sum = 0.0;
        for (int i = 0; i < 16; ++i) {
            const auto p = points.point(i, scramble);
            sum += p[0] * p[3] + p[1] * p[4] * p[5] - 0.375;
        }
        means.push_back(sum);
    }
    double square = 0.0, product = 0.0, total = 0.0;
    for (std::size_t i = 0; i < means.size(); ++i) {
        total += means[i];
        square += means[i] * means[i];
        product += means[i] * means[(i + 1) % means.size()];
    }
    EXPECT_LT(std::abs(product / square), 0.2);
    EXPECT_LT(std::abs(total) / 20.0, 4.0 * std::sqrt(square / 400.0));
}

TEST(ReferenceIntegrator, GivesAPinholesPixelItsArea) {
    CameraModel camera = camera_with(20, 16, {400.0, 300.0, 9.0, 7.0}, {});
    // From pixel x = 9 + 400 * 0.2 / 200 = 9.4 on.
    const CellGrid grid{cv::Mat::zeros(1, 1, CV_32FC1), {0.2, -40.0}, {100.0, 100.0}};
    const Scene scene{{{grid, {Eigen::Quaterniond::Identity(), {0.0, 0.0, 200.0}}}}, 0.9};
    const auto pixels = integrate_reference(camera, scene, {{9, 7}, {8, 7}, {10, 7}});
    EXPECT_NEAR(pixels[0].mean, 0.9 * 0.9, 1e-3);
    EXPECT_LT(pixels[0].standard_error, 5e-4);
    EXPECT_EQ(pixels[1].mean, 0.9);
    EXPECT_NEAR(pixels[2].mean, 0.0, 1e-12);
}

TEST(ReferenceIntegrator, GivesTheSameBytesForAnyNumberOfThreads) {
    const auto scene = benchmark_scene("webcam-1000");
    const cv::Rect region(470, 105, 9, 7);
    const ReferenceOptions options{.scrambles = 4, .samples_per_scramble = 64, .seed = 3};
    ReferenceImage one, two;
    {
        const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, 1);
        one = integrate_reference(scene.camera, scene.scene, region, options);
    }
    two = integrate_reference(scene.camera, scene.scene, region, options);
    EXPECT_EQ(cv::norm(one.mean, two.mean, cv::NORM_INF), 0.0);
    const auto listed = integrate_reference(scene.camera, scene.scene, {{473, 108}}, options);
    EXPECT_EQ(static_cast<float>(listed[0].mean), one.mean.at<float>(3, 3));
}

TEST(ReferenceIntegrator, EndsAtAStop) {
    const CameraModel camera = camera_with(20, 16, {400.0, 300.0, 9.0, 7.0}, {});
    std::stop_source stop;
    stop.request_stop();
    const ReferenceOptions options{.stop = stop.get_token()};
    EXPECT_THROW(integrate_reference(camera, {{}, 0.9}, {{9, 7}}, options), Interrupted);
    EXPECT_THROW(integrate_reference(camera, {{}, 0.9}, cv::Rect(0, 0, 20, 16), options),
                 Interrupted);
}

TEST(ReferenceIntegrator, RefusesOptionsWithoutAnError) {
    const auto scene = benchmark_scene("webcam-500");
    EXPECT_THROW(integrate_reference(scene.camera, scene.scene, {{1, 1}}, {.scrambles = 1}),
                 NumericalError);
    EXPECT_THROW(
        integrate_reference(scene.camera, scene.scene, {{1, 1}}, {.samples_per_scramble = 100}),
        NumericalError);
}

using std::numbers::pi;

CameraModel camera_seeing(const PointSpread& spread) {
    return camera_with(64, 48, {700.0, 500.0, 31.0, 23.0}, {}, Sensor{.pixel_pitch_um = 6.0},
                       Lens{2.8, 300.0, 550.0, spread});
}

const std::vector<std::pair<double, double>> measured_profile{
    {0.0, 4.0}, {0.5, 3.0}, {1.25, 0.7}, {3.0, 0.2}};

CameraModel measured_camera() {
    return camera_seeing({PointSpread::Kind::measured, 0.0, measured_profile});
}

TEST(PointSpreadSampler, InvertsTheEncircledEnergy) {
    const CameraModel airy = benchmark_scene("canon-500").camera;
    for (const CameraModel& camera : {airy, measured_camera()}) {
        const auto psf = PointSpreadFunction::of(camera);
        const PointSpreadSampler sampler(camera);
        for (const double energy : {0.0, 1e-6, 0.001, 0.02, 0.3, 0.77, 0.838, 0.95, 0.99, 0.9987})
            EXPECT_NEAR(psf.energy_within(sampler.radius_of(energy)), energy, 1e-5);
    }
    const auto energy_at = [](const CameraModel& camera, double energy) {
        return PointSpreadFunction::of(camera).energy_within(
            PointSpreadSampler(camera).radius_of(energy));
    };
    EXPECT_NEAR(energy_at(airy, 0.9999), 0.9999, 1e-6);  // past the table
    EXPECT_NEAR(energy_at(measured_camera(), 0.9999999), 0.9999999, 1e-5);
}

TEST(Measured, HoldsTheEnergyOfItsProfile) {
    const auto psf = PointSpreadFunction::measured(measured_profile);
    EXPECT_NEAR(psf.energy_within(3.0), 1.0, 1e-15);
    EXPECT_NEAR(psf.energy_within(7.0), 1.0, 1e-15);
    EXPECT_EQ(psf.density(3.1), 0.0);
    EXPECT_FALSE(psf.is_airy());
    EXPECT_NEAR(psf.density(0.25) / psf.density(0.0), 3.5 / 4.0, 1e-14);
    // Energy against the density by the midpoint rule.
    double sum = 0.0;
    constexpr int steps = 300000;
    for (int i = 0; i < steps; ++i) {
        const double r = 3.0 * (i + 0.5) / steps;
        sum += psf.density(r) * 2.0 * pi * r * 3.0 / steps;
        if (i % 30000 == 29999) {
            EXPECT_NEAR(psf.energy_within(3.0 * (i + 1) / steps), sum, 1e-9);
        }
    }
    EXPECT_NEAR(psf.energy_within(psf.radius_of_tail(0.1)), 0.9, 1e-12);
}

TEST(Measured, RefusesWhatIsNoProfile) {
    for (const auto& [row, value] :
         std::vector<std::pair<std::size_t, std::pair<double, double>>>{{0, {0.1, 4.0}},
                                                                        {2, {0.5, 0.7}},
                                                                        {3, {std::nan(""), 0.2}},
                                                                        {3, {3.0, -0.1}},
                                                                        {3, {3.0, std::nan("")}}}) {
        auto profile = measured_profile;
        profile[row] = value;
        EXPECT_THROW(PointSpreadFunction::measured(profile), NumericalError);
    }
    EXPECT_THROW(PointSpreadFunction::measured({{0, 1}, {1, 1}, {2, 0}}), NumericalError);
    EXPECT_THROW(PointSpreadFunction::measured({{0, 0}, {1, 0}, {2, 0}, {3, 0}}), NumericalError);
}

TEST(Measured, TakesThePlaceOfDefocus) {
    const CameraModel camera = camera_seeing({});
    EXPECT_GT(aperture_of(camera).radius_mm, 0.0);
    EXPECT_GT(blur_radius_px(camera, 200.0), 0.0);
    EXPECT_EQ(aperture_of(measured_camera()).radius_mm, 0.0);
    EXPECT_EQ(blur_radius_px(measured_camera(), 200.0), 0.0);
}

TEST(Measured, GivesAnEdgeTheProfileOfItsEnergyAtAnyDepth) {
    const CameraModel camera = measured_camera();
    const auto psf = PointSpreadFunction::measured(measured_profile);
    const auto profile = pixel_profile([&](double r) { return psf.energy_within(r); }, 6.0, 10);
    // The edge at pixel 31.4: 0.4 px are 0.4 * 200 / 700 mm.
    const Scene scene = half_plane(0.4 * 200.0 / 700.0, 200.0);
    const auto image = Renderer(camera).render(scene).radiance;
    for (int x = 26; x < 37; ++x) {
        const auto i = static_cast<std::size_t>(std::lround((31.4 - x + 6.0) * 10.0));
        EXPECT_NEAR(image.at<float>(20, x), profile[i], 0.1 / 255.0) << x;
    }
}

// ---- sampling bound

const EdgeTangents along_the_pixels(1);

// An edge at this place of a pixel of the small camera, at this angle to the columns.
Scene edge_at(double place_px, double z, double angle = 0.0) {
    Scene scene = half_plane(place_px * z / 400.0, z);
    scene.markers[0].camera_from_marker.rotation = rotation_from_vector({0.0, 0.0, angle});
    return scene;
}

// Largest difference between two ways to render edges at so many places of a pixel; gray.
double worst_edge(const Renderer& renderer, const RenderOptions& coarse, const RenderOptions& fine,
                  int places, double z, double angle = 0.0) {
    double worst = 0.0;
    for (int place = 0; place < places; ++place) {
        const Scene scene = edge_at(0.3 + place / static_cast<double>(places), z, angle);
        worst = std::max(worst, largest_difference(renderer.render(scene, coarse).radiance,
                                                   renderer.render(scene, fine).radiance));
    }
    return worst / gray;
}

// By k samples a side of the pixels that the edges cross.
RenderOptions by_samples(RenderMethod method, int k, double tolerance_gray = 0.1) {
    return {.method = method,
            .tolerance_gray = tolerance_gray,
            .samples_per_side = k,
            .region = {40, 32, 16, 4},
            .keep = {NeglectedEffect::lens, NeglectedEffect::diffraction}};
}

// Between k and many samples.
double worst_edge(RenderMethod method, int k, int many, double blur_px) {
    const CameraModel camera = small_camera({PointSpread::Kind::ideal, 0.0});
    return worst_edge(Renderer(camera), by_samples(method, k, 1e3), by_samples(method, many, 1e3),
                      40, depth_of_blur(camera, blur_px));
}

TEST(SamplingBound, HoldsForRenderedEdgesAndIsNotFarAbove) {
    const PointSpreadFunction spread =
        PointSpreadFunction::of(small_camera({PointSpread::Kind::ideal, 0.0}));
    const SamplingBound bound(&spread);
    for (const double blur : {0.35, 0.8, 4.4})
        for (const int k : {2, 3, 5}) {
            const double limit = bound.of_points(k, blur, along_the_pixels);
            const double error = worst_edge(RenderMethod::exact_lens, k, 15, blur);
            EXPECT_LT(error, 1.1 * limit + 0.01) << "k " << k << " blur " << blur;
            EXPECT_GT(error, 0.25 * limit - 0.02) << "k " << k << " blur " << blur;
        }
    // Near enough the filter's own: 1 up to 1.65 px, 0 from 3.3 px.
    const auto window = [](double r) {
        const double t = std::clamp((r - 1.65) / 1.65, 0.0, 1.0);
        return 1.0 - t * t * (3.0 - 2.0 * t);
    };
    const DeconvolvedPsf sharpened = DeconvolvedPsf::of(spread, window, 3.3).value();
    for (const int k : {5, 8}) {
        const double limit = bound.of_disks(k, sharpened, {}, along_the_pixels);
        const double error = worst_edge(RenderMethod::exact_area, k, 24, 0.0);
        EXPECT_LT(error, 1.1 * limit + 0.2) << k;
        EXPECT_GT(error, 0.4 * limit) << k;
    }
}

// In steps of a 16th of a tangent the bound of 15 samples was too small beside 1/16.
TEST(SamplingBound, HoldsForEdgesOfAnySlant) {
    const Renderer renderer(small_camera({PointSpread::Kind::gaussian, 0.05}));
    const double blur = 0.13, z = depth_of_blur(renderer.camera(), blur);
    for (const auto& [k, tangent] : {std::pair{15, 0.0525}, {15, 0.0565}, {5, 0.2169}}) {
        const RenderOptions coarse = by_samples(RenderMethod::exact_lens, k);
        const RenderOptions fine = by_samples(RenderMethod::exact_lens, 48);
        const double angle = std::atan(tangent);
        const double limit = renderer.render(edge_at(0.3, z, angle), coarse).plan.sampling_gray;
        const double error = worst_edge(renderer, coarse, fine, 10, z, angle);
        EXPECT_LT(error, 1.1 * limit) << k << " at " << tangent;
        EXPECT_GT(error, 0.25 * limit) << k << " at " << tangent;
    }
}

// One disk that stands for a sample's disk and the lens has ripples of its own: where its transfer
// at the samples' frequency is larger than the sharp image's disk's, k sees more of an edge.
TEST(SamplingBound, KnowsTheRipplesOfDisksThatStandForTheLens) {
    CameraModel camera = small_camera({PointSpread::Kind::gaussian, 0.409});
    const PointSpreadFunction spread = PointSpreadFunction::of(camera);
    const ImageFilter filter(camera);
    const DeconvolvedPsf& sharpened = *filter.sharpened();
    const SamplingBound bound(&spread);
    const double one_disk = sharpened.blur_of_one_disk_px(0.01);
    const Renderer renderer(camera);
    for (const double part : {0.3, 0.9}) {
        const double blur = part * one_disk, z = depth_of_blur(camera, blur);
        for (const int k : {4, 6}) {
            // So small a tolerance, as k is forced, that nothing but disks comes into question.
            const double error = worst_edge(renderer, by_samples(RenderMethod::automatic, k),
                                            by_samples(RenderMethod::exact_area, 24), 6, z);
            const double limit =
                bound.of_disks(k, sharpened, {blur, blur, one_disk}, along_the_pixels);
            EXPECT_LT(error, 1.1 * limit + 0.03) << "k " << k << " blur " << blur;
            EXPECT_GT(error, 0.25 * limit - 0.02) << "k " << k << " blur " << blur;
        }
    }
}

// Thinning out takes what the coarser grid would see wrongly, and leaves what the pixels show.
TEST(SamplingBound, ThinnedSamplesAreAlmostAsGoodAsAllOfThem) {
    const PointSpreadFunction spread =
        PointSpreadFunction::of(small_camera({PointSpread::Kind::ideal, 0.0}));
    const SamplingBound bound(&spread);
    const auto window = [](double r) { return r < 1.65 ? 1.0 : 0.0; };
    const DeconvolvedPsf sharpened = DeconvolvedPsf::of(spread, window, 1.65).value();
    const EdgeTangents all = ~EdgeTangents{};
    for (const double px : {0.0, 0.1}) {
        const DiskBlur blur{px, px, 0.0};
        for (const int k : {12, 14}) {
            const double thinned = bound.of_disks(k, sharpened, blur, all, true);
            EXPECT_LT(thinned, 0.5 * bound.of_disks(k, sharpened, blur, all)) << k << " " << px;
            EXPECT_GT(thinned, 0.0);
        }
    }
}

// ---- Disks for a disk and the lens together

double transfer(double q) {
    return q == 0.0 ? 1.0 : 2.0 * std::cyl_bessel_j(1.0, q) / q;
}

TEST(ConcentricDisks, AreTwoDisksConvolved) {
    // By Fourier, to the order of Gauss' rule; more of them are nearer.
    for (const auto& [a, b] : {std::pair{0.4, 1.1}, {1.7, 0.9}, {2.0, 2.0}, {0.0, 1.3}}) {
        double last = 1.0;
        for (int count = 1; count <= 4; ++count) {
            double mean = 0.0, weights = 0.0;
            for (const ConcentricDisk& disk : concentric_disks(count)) {
                mean +=
                    disk.weight * transfer(std::sqrt(a * a + b * b + 2.0 * disk.cosine * a * b));
                weights += disk.weight;
            }
            EXPECT_NEAR(weights, 1.0, 1e-14);
            const double error = std::abs(mean - transfer(a) * transfer(b));
            EXPECT_LE(error, 0.1 * last + 1e-15) << count << " for " << a << ", " << b;
            last = error;
        }
        EXPECT_LT(last, 1e-6);
    }
}

TEST(DeconvolvedPsf, OneDiskIsEnoughWhereItSaysSo) {
    const DeconvolvedPsf sharpened =
        DeconvolvedPsf::of(
            PointSpreadFunction::of(small_camera({PointSpread::Kind::ideal, 0.0})),
            [](double r) { return r < 2.0 ? 1.0 : 0.0; }, 2.0)
            .value();
    const double blur = sharpened.blur_of_one_disk_px(0.01);
    EXPECT_GT(blur, 0.2 * sharpened.disk_radius_px());
    EXPECT_LT(blur, sharpened.disk_radius_px());
    EXPECT_NEAR(sharpened.blur_of_one_disk_px(0.04), 2.0 * blur, 1e-12);
    EXPECT_EQ(sharpened.disks_for_any_blur(0.02), 2);
    EXPECT_EQ(sharpened.disks_for_any_blur(0.0), 0);
    EXPECT_GE(sharpened.disks_for_any_blur(1e-4), 3);
}

// Of a pattern of thousands of pixels its bound alone would take minutes.
TEST(DeconvolvedPsf, IsOfPatternsUpTo50Pixels) {
    const auto is_made = [](double f_number) {
        CameraModel camera = small_camera({PointSpread::Kind::ideal, 0.0});
        camera.lens->f_number = f_number;
        const double reach = 3.0 * PointSpreadFunction::of(camera).scale_px();
        return DeconvolvedPsf::of(
                   PointSpreadFunction::of(camera), [](double) { return 1.0; }, reach)
            .has_value();
    };
    EXPECT_TRUE(is_made(400.0));  // 600 nm, pixels of 6 um: 40 px
    EXPECT_FALSE(is_made(600.0));
}

TEST(SamplingBound, FollowsTheLawOfTheDisksRim) {
    // Without a spread the pixel is k whole samples: 255 * 0.0213 k^(-5/2) R^(-3/2) gray, measured
    // with a program of its own over R = 0.8 ... 16 px.
    const SamplingBound bound(nullptr);
    for (const double blur : {1.0, 2.7, 9.0, 40.0})
        for (const int k : {3, 4, 6, 9}) {
            const double law = 255.0 * 0.0213 * std::pow(k, -2.5) * std::pow(blur, -1.5);
            EXPECT_GT(bound.of_points(k, blur, along_the_pixels), 0.9 * law) << k << " " << blur;
            EXPECT_LT(bound.of_points(k, blur, along_the_pixels), 1.16 * law)
                << k << " " << blur;  // bins of 8 %
        }
    EXPECT_EQ(bound.of_boxes(1, along_the_pixels), 0.0);
    EXPECT_EQ(bound.of_no_spread(), 0.0);
}

TEST(SamplingBound, KnowsTheLineSpreadOfAGaussian) {
    // Its peak is 1 / (sigma sqrt(2 pi)); beside an edge it moves sigma / sqrt(2 pi) of light.
    const PointSpreadFunction spread = PointSpreadFunction::gaussian(0.31);
    const SamplingBound bound(&spread);
    const double root = std::sqrt(2.0 * std::numbers::pi);
    EXPECT_NEAR(bound.line_spread_peak(), 1.0 / (0.31 * root), 0.01);
    EXPECT_NEAR(bound.of_no_spread(), 255.0 * 0.31 / root, 0.2);
}

}  // namespace
}  // namespace etalon
