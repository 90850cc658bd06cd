#include "sim/render/renderer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "bench/benchmark_scenes.h"
#include "calib/camera/projector.h"
#include "core/program/errors.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

using test::gray;
using test::half_plane;
using test::largest_difference;

CameraModel pinhole() {
    CameraModel camera;
    camera.width = 96;
    camera.height = 72;
    camera.intrinsics = {400.0, 400.0, 47.0, 35.0};
    return camera;
}

// Blur radius at z: 400 * d/2 * |1/z - 1/z_f|, with v = 2.4 mm and d = f/N.
CameraModel with_lens(PointSpread spread = {PointSpread::Kind::gaussian, 0.7}) {
    CameraModel camera = pinhole();
    camera.sensor = Sensor{.pixel_pitch_um = 6.0};
    camera.lens = Lens{1.4, 150.0, 600.0, spread};
    return camera;
}

// A rectangle of 4 x 3 cells in front of the camera, tilted.
Scene small_marker() {
    Scene scene{{PlacedMarker{}}};
    scene.markers[0].grid.cells =
        (cv::Mat_<float>(3, 4) << 0, 0.8, 0.2, 1, 1, 0, 0.6, 0, 0.3, 1, 0, 0.9);
    scene.markers[0].grid.cell_mm = {7.0, 5.0};
    scene.markers[0].grid.corner_mm = {-14.0, -7.5};
    scene.markers[0].camera_from_marker.rotation = rotation_from_vector({0.3, -0.4, 0.2});
    scene.markers[0].camera_from_marker.translation = {3.0, -2.0, 250.0};
    return scene;
}

TEST(Renderer, OfAPinholeAveragesThePixelsAreaExactly) {
    // The edge lies at pixel x = 47 + 400 * 1.3 / 250 = 49.08: pixel 49 is white from there on.
    const auto image = Renderer(pinhole()).render(half_plane(1.3, 250.0)).radiance;
    EXPECT_EQ(image.at<float>(30, 48), 0.0f);
    EXPECT_NEAR(image.at<float>(30, 49), 49.5 - 49.08, 1e-6);
    EXPECT_EQ(image.at<float>(30, 50), 1.0f);
}

// Across an edge the disk's, the Gaussian's and the box's spreads meet in one dimension:
// profile(x) = integral over the disk's line spread of the mean of Phi over the box.
double edge_profile(double distance_px, double disk_px, double sigma_px) {
    const auto phi_integral = [&](double x) {  // antiderivative of the normal distribution function
        const double t = x / sigma_px;
        const double density = std::exp(-0.5 * t * t) / std::sqrt(2.0 * std::numbers::pi);
        return sigma_px * (t * 0.5 * std::erfc(-t / std::sqrt(2.0)) + density);
    };
    constexpr int steps = 20000;
    double sum = 0.0;
    for (int i = 0; i < steps; ++i) {  // x = R sin(angle): weight 2/pi cos^2
        const double angle = ((i + 0.5) / steps - 0.5) * std::numbers::pi;
        const double x = distance_px - disk_px * std::sin(angle);
        sum += std::cos(angle) * std::cos(angle) * (phi_integral(x + 0.5) - phi_integral(x - 0.5));
    }
    return sum * 2.0 / steps;
}

class DefocusedEdge : public testing::TestWithParam<double> {};

TEST_P(DefocusedEdge, HasItsClosedFormProfile) {
    const double z = GetParam();
    const CameraModel camera = with_lens();
    const auto image = Renderer(camera).render(half_plane(0.001 * z, z));
    const double edge_px = 47.0 + 400.0 * 0.001;
    const double blur = blur_radius_px(camera, z);
    for (int x = 30; x < 64; ++x)
        EXPECT_NEAR(image.radiance.at<float>(33, x), edge_profile(x - edge_px, blur, 0.7),
                    0.1 * gray)
            << "pixel " << x << " blur " << blur << " px, " << image.plan.describe();
}

// In front of the plane of focus (150 mm), on it, just and far behind it: blur radii 0 to 8 px.
INSTANTIATE_TEST_SUITE_P(Depths, DefocusedEdge,
                         testing::Values(32.6, 53.5, 60.0, 110.0, 148.0, 150.0, 156.0, 160.0, 168.8,
                                         183.5, 200.0, 236.0, 356.0, 700.0, 1486.0, 5000.0));

TEST(Renderer, FindsTheDiffractionTailsAsymptote) {
    // Far from an edge, 2 lambda N_w / (pi^3 D) of the light comes from beyond it, less what the
    // tail's finite reach leaves out (0.01 gray at most).
    CameraModel camera = with_lens({PointSpread::Kind::ideal, 0.0});
    camera.width = 400;
    const double n_w = thin_lens(camera).working_f_number;
    const auto image = Renderer(camera).render(half_plane(0.0, 150.0)).radiance;
    for (const int distance : {30, 60, 120, 300}) {
        const double expected = 2.0 * 0.6 * n_w / 6.0 / (std::pow(std::numbers::pi, 3) * distance);
        EXPECT_NEAR(1.0 - image.at<float>(35, 47 + distance), expected,
                    0.02 * expected + 0.011 * gray)
            << distance;
    }
}

TEST(Renderer, KeepsTheEnergyOfASmallMarker) {
    // A black marker of 4.2 x 3 mm at 200 mm, square to the axis, covers 8.4 x 6 px; blur and
    // spread only move its darkness about.
    Scene scene{{PlacedMarker{}}};
    scene.markers[0].grid.cells = cv::Mat::zeros(1, 1, CV_32FC1);
    scene.markers[0].grid.cell_mm = {4.2, 3.0};
    scene.markers[0].grid.corner_mm = {-1.7, -1.9};
    scene.markers[0].camera_from_marker.translation = {0.3, 0.2, 200.0};
    const auto image = Renderer(with_lens()).render(scene).radiance;
    EXPECT_NEAR(cv::sum(1.0 - image)[0], 8.4 * 6.0, 0.02);
}

TEST(Renderer, SeesAMarkerSmallerThanAPixel) {
    Scene scene{{PlacedMarker{}}};
    scene.markers[0].grid.cells = cv::Mat::zeros(2, 3, CV_32FC1);
    scene.markers[0].grid.cell_mm = {0.05, 0.04};  // 0.3 x 0.16 px in all
    scene.markers[0].grid.corner_mm = {0.01, 0.02};
    scene.markers[0].camera_from_marker.translation = {0.0, 0.0, 200.0};
    for (const CameraModel& camera : {pinhole(), with_lens()}) {
        const auto image = Renderer(camera).render(scene).radiance;
        EXPECT_NEAR(cv::sum(1.0 - image)[0], 0.3 * 0.16, 2e-4);
    }
}

TEST(Renderer, ShiftsByWholePixelsWithTheMarker) {
    for (const CameraModel& camera : {pinhole(), with_lens({PointSpread::Kind::ideal, 0.0})}) {
        const Renderer renderer(camera);
        Scene scene = small_marker();
        scene.markers[0].camera_from_marker.rotation = rotation_from_vector({0.0, 0.0, 0.3});
        const auto first = renderer.render(scene).radiance;
        scene.markers[0].camera_from_marker.translation +=
            Eigen::Vector3d(7.0, -5.0, 0.0) * 250.0 / 400.0;
        const auto second = renderer.render(scene).radiance;
        const cv::Rect here(20, 20, 50, 40), there(27, 15, 50, 40);
        // The far tail's blocks do not move along: a few thousandths of a gray.
        EXPECT_LT(largest_difference(first(here), second(there)), 0.01 * gray);
    }
}

TEST(Renderer, WithAPinpricksApertureIsThePinhole) {
    CameraModel camera = with_lens({PointSpread::Kind::ideal, 0.0});
    camera.lens->f_number = 1e7;
    camera.lens->wavelength_nm = 1e-6;  // otherwise diffraction would take over
    const auto lens = Renderer(camera).render(small_marker()).radiance;
    EXPECT_LT(largest_difference(lens, Renderer(pinhole()).render(small_marker()).radiance),
              0.5 * gray);
}

TEST(Renderer, OfAUniformSceneIsUniform) {
    Scene scene = small_marker();
    scene.markers[0].grid.cells.setTo(0.625f);
    scene.background = 0.625;
    const auto image = Renderer(with_lens({PointSpread::Kind::ideal, 0.0})).render(scene).radiance;
    EXPECT_EQ(largest_difference(image, cv::Mat(image.size(), CV_32FC1, cv::Scalar(0.625))), 0.0);
}

TEST(Renderer, InsideALargeCellShowsItsRadiance) {
    Scene scene = half_plane(-1000.0, 250.0);
    scene.markers[0].grid.cells.at<float>(0, 1) = 0.25f;
    const auto image = Renderer(with_lens()).render(scene).radiance;
    EXPECT_NEAR(image.at<float>(35, 47), 0.25, 1e-6);
}

TEST(Renderer, IsLinearInTheRadiances) {
    const Renderer renderer(with_lens({PointSpread::Kind::ideal, 0.0}));
    Scene scene = small_marker();
    // A fainter scene would need fewer samples and less of the tail.
    const RenderOptions options{.samples_per_side = 6, .keep = {NeglectedEffect::tail}};
    const auto full = renderer.render(scene, options).radiance;
    scene.markers[0].grid.cells = 0.3 + 0.2 * scene.markers[0].grid.cells;
    scene.background = 0.5;
    const auto faint = renderer.render(scene, options).radiance;
    EXPECT_LT(largest_difference(faint, 0.3 + 0.2 * full), 0.01 * gray);
}

// The sum of what each alone takes from the background, tails to the image's end included, which
// come from grids of their own near each of them. Within float's rounding.
TEST(Renderer, OfSeveralMarkersIsTheSumOfTheirDifferences) {
    CameraModel camera = benchmark_scene("webcam-500").camera;
    camera.lens->psf = {PointSpread::Kind::ideal, 0.0};
    camera.lens->wavelength_nm = 600.0;
    const Renderer renderer(camera);
    Scene scene{{}, 0.9};
    Radiance sum(camera.height, camera.width, CV_32FC1, cv::Scalar(0.9));
    for (const auto& [x_mm, y_mm] : {std::pair{-130.0, -70.0}, {20.0, 15.0}, {110.0, 80.0}}) {
        PlacedMarker marker = small_marker().markers[0];
        marker.camera_from_marker.translation = {x_mm, y_mm, 500.0};
        scene.markers.push_back(marker);
        const RenderOptions keep{.samples_per_side = 6, .keep = {NeglectedEffect::tail}};
        sum += renderer.render({{marker}, 0.9}, keep).radiance - 0.9;
    }
    const auto all =
        renderer.render(scene, {.samples_per_side = 6, .keep = {NeglectedEffect::tail}}).radiance;
    EXPECT_LT(largest_difference(all, sum), 1e-6);
}

TEST(Renderer, OfARegionIsThatPartOfTheWhole) {
    const Renderer renderer(with_lens({PointSpread::Kind::ideal, 0.0}));
    RenderOptions options;
    options.region = {37, 21, 22, 19};
    const auto part = renderer.render(small_marker(), options).radiance;
    const auto whole = renderer.render(small_marker()).radiance;
    EXPECT_LT(largest_difference(part(options.region), whole(options.region)), 0.005 * gray);
    EXPECT_EQ(part.at<float>(0, 0), 1.0f);
}

// Far from the marker, where its tail alone is seen, of one marker and of two.
TEST(Renderer, OfAFarRegionIsThatPartOfTheWhole) {
    BenchmarkScene webcam = benchmark_scene("webcam-500");
    const Renderer renderer(webcam.camera);
    RenderOptions options{.tolerance_gray = 0.01};
    for (const bool two : {false, true}) {
        if (two) {
            webcam.scene.markers.push_back(webcam.scene.markers.front());
            webcam.scene.markers.back().camera_from_marker.translation.x() -= 60.0;
        }
        options.region = {};
        const auto whole = renderer.render(webcam.scene, options).radiance;
        for (const cv::Point& corner : {cv::Point(4, 4), cv::Point(596, 7), cv::Point(3, 440),
                                        cv::Point(600, 445), cv::Point(601, 250)}) {
            options.region = {corner, cv::Size(37, 31)};
            const auto part = renderer.render(webcam.scene, options).radiance;
            EXPECT_LT(largest_difference(part(options.region), whole(options.region)), 1e-6)
                << options.region << " two " << two;
        }
    }
}

// Where the marker is cut by the image, where all of it is seen, and where nothing is.
TEST(Renderer, OfAPartIsWhatDiffersFromTheBackground) {
    const Renderer renderer(with_lens());
    for (const double x_mm : {-27.0, 3.0, -400.0}) {
        Scene scene = small_marker();
        scene.background = 0.7;
        scene.markers[0].camera_from_marker.translation.x() = x_mm;
        const RenderedPart part = renderer.render_part(scene);
        Radiance whole(72, 96, CV_32FC1, cv::Scalar(0.7));
        if (!part.region.empty())
            part.radiance.copyTo(whole(part.region));
        EXPECT_EQ(part.background, 0.7);
        EXPECT_EQ(largest_difference(whole, renderer.render(scene).radiance), 0.0) << x_mm;
        EXPECT_LT(part.region.area(), 96 * 72) << x_mm;
        EXPECT_EQ(part.region.empty(), x_mm == -400.0);
    }
}

TEST(Renderer, MarksPixelsWithoutARay) {
    CameraModel camera = pinhole();
    camera.intrinsics.fx = camera.intrinsics.fy = 60.0;
    camera.distortion.k1 = -0.6;  // folds over 29.8 px from the centre
    const auto image = Renderer(camera).render(half_plane(0.0, 250.0));
    EXPECT_EQ(image.valid.at<uchar>(35, 47 + 29), 255);
    EXPECT_EQ(image.valid.at<uchar>(35, 47 + 31), 0);
    EXPECT_NEAR(image.radiance.at<float>(35, 47 - 20), 0.0f, 1e-6f);
    EXPECT_EQ(image.radiance.at<float>(35, 47 - 31), 1.0f);  // background, not the black marker
}

TEST(Renderer, MixesItsMethodsWhereThePlaneOfFocusCrossesTheMarker) {
    CameraModel camera = with_lens();
    camera.lens->f_number = 0.3;
    const Renderer renderer(camera);
    Scene scene = small_marker();
    scene.markers[0].camera_from_marker.translation.z() = 151.0;
    const auto mixed = renderer.render(scene);
    EXPECT_EQ(mixed.plan.min_blur_radius_px, 0.0);
    EXPECT_GT(mixed.plan.max_blur_radius_px, 0.3);
    RenderOptions exact_lens;  // sees the same where it samples finely enough
    exact_lens.method = RenderMethod::exact_lens;
    exact_lens.samples_per_side = 32;
    EXPECT_LT(largest_difference(mixed.radiance, renderer.render(scene, exact_lens).radiance),
              0.2 * gray);
}

TEST(Renderer, AreasAtLensPointsAreLensAverages) {
    for (const double sigma_px : {1e-4, 0.7}) {  // the narrow one is left out
        const Renderer renderer(with_lens({PointSpread::Kind::gaussian, sigma_px}));
        const Scene scene = half_plane(1.3, 140.0);  // along the pixels
        const auto areas = renderer.render(scene, {.method = RenderMethod::exact_area});
        EXPECT_NEAR(areas.plan.max_blur_radius_px, 0.16, 0.01);
        const auto averages =
            renderer.render(scene, {.method = RenderMethod::exact_lens, .samples_per_side = 48});
        EXPECT_LT(largest_difference(areas.radiance, averages.radiance), 0.1 * gray) << sigma_px;
    }
}

TEST(Renderer, RefusesWhatItCannotRender) {
    const Renderer renderer(with_lens());
    const auto refused = [&](auto change) {
        Scene scene = small_marker();
        change(scene);
        EXPECT_THROW(renderer.render(scene), NumericalError);
    };
    const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
    refused([](Scene& s) { s.markers[0].camera_from_marker.translation.z() = -250.0; });
    refused([](Scene& s) { s.markers[0].camera_from_marker.translation.z() = 0.0; });
    refused([](Scene& s) {
        s.markers[0].camera_from_marker.translation.z() = 5.0;
    });  // a corner behind
    refused([&](Scene& s) { s.markers[0].camera_from_marker.translation.x() = nan; });
    refused([&](Scene& s) { s.markers[0].camera_from_marker.translation.y() = infinity; });
    refused([](Scene& s) { s.markers[0].camera_from_marker.rotation.coeffs() *= 2.0; });
    refused([](Scene& s) {
        s.markers[0].camera_from_marker.rotation = rotation_from_vector({0, 3.0, 0});
    });
    refused([&](Scene& s) { s.markers[0].grid.cells.at<float>(1, 2) = static_cast<float>(nan); });
    refused([](Scene& s) { s.markers[0].grid.cell_mm.x() = 0.0; });
    refused([](Scene& s) { s.markers[0].grid.cells = cv::Mat(); });
    refused([&](Scene& s) { s.background = nan; });
    // Seen edge-on, the marker's plane passes through the aperture.
    refused([](Scene& s) {
        s.markers[0].camera_from_marker.rotation =
            rotation_from_vector({0, std::numbers::pi / 2 - 0.001, 0});
        s.markers[0].camera_from_marker.translation.x() = 0.0;
    });
}

TEST(Renderer, RefusesOptionsWithoutAMeaning) {
    const Renderer renderer(pinhole());
    RenderOptions options;
    options.tolerance_gray = 0.0;
    EXPECT_THROW(renderer.render(small_marker(), options), NumericalError);
    options = {};
    options.region = {80, 60, 40, 40};
    EXPECT_THROW(renderer.render(small_marker(), options), NumericalError);
    CameraModel empty = pinhole();
    empty.width = 0;
    EXPECT_THROW(Renderer{empty}, NumericalError);
}

// How much of a pixel lies to the right of where rays with this x meet the sensor.
double part_right_of(const Projector& projector, double ray_x, int x, int y) {
    constexpr int rows = 64;
    double sum = 0.0;
    for (int row = 0; row < rows; ++row) {
        double left = x - 0.5, right = x + 0.5;
        for (int step = 0; step < 30; ++step) {
            const double middle = 0.5 * (left + right);
            const auto ray = projector.unproject({middle, y + (row + 0.5) / rows - 0.5});
            (ray->x() > ray_x ? right : left) = middle;
        }
        sum += x + 0.5 - left;
    }
    return sum / rows;
}

// Edges that are bent within a pixel: as parallelograms, pixels would be up to 0.7 gray off.
TEST(Renderer, FollowsDistortionsThatBendWithinAPixel) {
    CameraModel camera = pinhole();
    camera.intrinsics.fx = camera.intrinsics.fy = 30.0;
    camera.distortion.k1 = -0.25;
    camera.distortion.k2 = 0.05;
    const auto rendered = Renderer(camera).render(half_plane(160.0, 250.0));
    EXPECT_GT(rendered.plan.points_per_pixel_side, 1);
    const Projector projector(camera);
    for (int y = 20; y < 52; y += 3)
        for (int x = 47 + 14; x < 47 + 21; ++x)
            EXPECT_NEAR(rendered.radiance.at<float>(y, x),
                        part_right_of(projector, 160.0 / 250.0, x, y), 0.1 * gray)
                << x << ", " << y;
}

TEST(Renderer, SaysWhatItDid) {
    const auto scene = benchmark_scene("webcam-500");
    RenderOptions options;
    options.region = {380, 130, 80, 80};
    const auto plan = Renderer(scene.camera).render(scene.scene, options).plan;
    EXPECT_EQ(plan.method, RenderMethod::exact_lens);
    EXPECT_NEAR(plan.max_blur_radius_px, 2.03, 0.01);
    EXPECT_GT(plan.tail_reach_px, 80.0);
    EXPECT_THAT(plan.describe(), testing::HasSubstr("exact lens averages"));
}

}  // namespace
}  // namespace etalon
