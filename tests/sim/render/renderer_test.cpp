#include "sim/render/renderer.h"

#include "bench/benchmark_scenes.h"
#include "sim/marker/marker.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

CameraModel pinhole() {
    return camera_with(96, 72, {400.0, 400.0, 47.0, 35.0}, {});
}

// Blur radius at z: 400 * d/2 * |1/z - 1/z_f|, with v = 2.4 mm and d = f/N.
CameraModel with_lens(PointSpread spread = {PointSpread::Kind::gaussian, 0.7}) {
    return small_camera(spread);
}

// A rectangle of 4 x 3 cells in front of the camera, tilted.
Scene small_marker() {
    return {{twelve_cells({7.0, 5.0}, {-14.0, -7.5},
                          {rotation_from_vector({0.3, -0.4, 0.2}), {3.0, -2.0, 250.0}})}};
}

TEST(Renderer, OfAPinholeAveragesThePixelsAreaExactly) {
    // The edge lies at pixel x = 47 + 400 * 1.3 / 250 = 49.08: pixel 49 is white from there on.
    const auto image = Renderer(pinhole()).render(half_plane(1.3, 250.0)).radiance;
    EXPECT_EQ(image.at<float>(30, 48), 0.0f);
    EXPECT_NEAR(image.at<float>(30, 49), 49.5 - 49.08, 1e-6);
    EXPECT_EQ(image.at<float>(30, 50), 1.0f);
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

PlacedMarker black_cells(int rows, int columns, const Eigen::Vector2d& cell_mm,
                         const Eigen::Vector2d& corner_mm, const Eigen::Vector3d& at) {
    return {{cv::Mat::zeros(rows, columns, CV_32FC1), corner_mm, cell_mm},
            {Eigen::Quaterniond::Identity(), at}};
}

TEST(Renderer, KeepsTheEnergyOfASmallMarker) {
    // A black marker of 4.2 x 3 mm at 200 mm, square to the axis, covers 8.4 x 6 px; blur and
    // spread only move its darkness about.
    const Scene scene{{black_cells(1, 1, {4.2, 3.0}, {-1.7, -1.9}, {0.3, 0.2, 200.0})}};
    const auto image = Renderer(with_lens()).render(scene).radiance;
    EXPECT_NEAR(cv::sum(1.0 - image)[0], 8.4 * 6.0, 0.02);
}

TEST(Renderer, SeesAMarkerSmallerThanAPixel) {
    // 0.3 x 0.16 px in all.
    const Scene scene{{black_cells(2, 3, {0.05, 0.04}, {0.01, 0.02}, {0.0, 0.0, 200.0})}};
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
    const RenderOptions options{.region = {37, 21, 22, 19}};
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
    // Sees the same where it samples finely enough.
    const RenderOptions exact_lens{.method = RenderMethod::exact_lens, .samples_per_side = 32};
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
    for (const RenderOptions& options :
         {RenderOptions{.tolerance_gray = 0.0}, RenderOptions{.region = {80, 60, 40, 40}}})
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

// Cells smaller than a pixel: several edges add their errors up, and the plan has to know.
constexpr double depth_mm = 190.0;
constexpr int cells = 16;

// Square cells of this many px, turned by an angle: a checkerboard, stripes or random ones.
Scene small_cells(const CameraModel& camera, double cell_px, double angle, int kind) {
    RandomStream random(7, 3);
    cv::Mat_<float> radiances(cells, cells);
    for (int j = 0; j < cells; ++j)
        for (int i = 0; i < cells; ++i)
            radiances(j, i) = static_cast<float>(
                kind == 0 ? (i + j) % 2 : (kind == 1 ? i % 2 : random.uniform() < 0.5));
    const double per_px = depth_mm / camera.intrinsics.fx, side = cell_px * per_px;
    const Eigen::AngleAxisd turn(angle, Eigen::Vector3d::UnitZ());
    return {{{{radiances, Eigen::Vector2d::Constant(-0.5 * cells * side), {side, side}},
              {Eigen::Quaterniond(turn), {0.31 * per_px, -0.17 * per_px, depth_mm}}}},
            1.0};
}

// Error of the automatic plan, which aims at 0.1 gray, against 24 exact lens averages a side.
double error_gray(const Renderer& renderer, const Scene& scene) {
    const std::vector<NeglectedEffect> keep{NeglectedEffect::lens, NeglectedEffect::diffraction,
                                            NeglectedEffect::tail};
    const cv::Rect middle(36, 24, 24, 24);
    const RenderedImage planned = renderer.render(scene, {.region = middle, .keep = keep});
    const RenderedImage exact = renderer.render(scene, {.method = RenderMethod::exact_lens,
                                                        .tolerance_gray = 1e3,
                                                        .samples_per_side = 24,
                                                        .region = middle,
                                                        .keep = keep});
    return largest_difference(planned.radiance, exact.radiance) / gray;
}

TEST(SmallCells, AreWithinTheToleranceWhereverTheirEdgesLie) {
    for (const PointSpread& spread : {PointSpread{PointSpread::Kind::gaussian, 0.11},
                                      PointSpread{PointSpread::Kind::ideal, 0.0}}) {
        CameraModel camera = small_camera(spread);
        camera.lens->focus_distance_mm = 197.0;  // blurred by some 0.3 px
        const Renderer renderer(camera);
        for (const double cell_px : {0.21, 0.61})
            for (int kind = 0; kind < 3; ++kind)
                EXPECT_LT(error_gray(renderer, small_cells(camera, cell_px, 0.37, kind)), 0.15)
                    << cell_px << " px, kind " << kind;
    }
}

// Disks of confusion of up to 2 px on both sides of the focus, the largest skew that a lens takes.
CameraModel skewed_camera(double f_number) {
    CameraModel camera =
        camera_with(120, 100, {905.0, 880.0, 57.0, 51.0}, {.k1 = -0.2},
                    Sensor{.pixel_pitch_um = 17.0}, Lens{f_number, 300.0, 550.0, {}});
    camera.intrinsics.skew = -max_skew_of_a_lens * camera.intrinsics.fx;
    return camera;
}

// The reference's point spread leans in pixels as the columns do.
TEST(SkewedLens, IsBlurredAsItsRaysMeetTheMarker) {
    // Turned by 45 degrees, at which a pattern that leans shows most.
    const cv::Mat cells = (cv::Mat_<float>(2, 3) << 0, 1, 0, 1, 0, 1);
    const Rigid pose{rotation_from_vector({0.3, -0.7, 0.8}), {1.0, -0.5, 300.0}};
    const Scene scene{{{{cells, {-10.5, -9.0}, {7.0, 9.0}}, pose}}, 0.5};
    std::vector<cv::Point> pixels;
    for (int y = 22; y < 80; y += 7)
        for (int x = 27; x < 90; x += 6)
            pixels.emplace_back(x, y);
    for (const double f_number : {1.4, 8.0}) {
        const CameraModel camera = skewed_camera(f_number);
        test::expect_reference(Renderer(camera).render(scene).radiance, camera, scene, pixels,
                               {.samples_per_scramble = 2048});
    }
}

TEST(SkewedLens, IsRefusedWhereItsPointSpreadWouldLean) {
    CameraModel camera = skewed_camera(1.4);
    camera.intrinsics.skew *= 1.01;
    EXPECT_THROW(Renderer{camera}, NumericalError);
}

// Barrel distortion folds over where r (1 + k1 r^2) is largest: r = 1 / sqrt(-3 k1), image radius
// 2/3 of that.
constexpr double k1 = -0.3, focal_px = 4000.0;
const double fold = 1.0 / std::sqrt(-3.0 * k1), fold_px = focal_px * 2.0 / 3.0 * fold;

// A sharp camera whose fold, hardly curved within the image, passes through `at`, its outward
// direction turned by `angle` from x.
CameraModel camera_with_fold(const Eigen::Vector2d& at, double angle) {
    const Eigen::Vector2d centre = at - fold_px * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    return camera_with(24, 16, {focal_px, focal_px, centre.x(), centre.y()}, {.k1 = k1});
}

// Black wherever the camera sees anything, before a white background.
Scene black_scene(double angle) {
    const double place = 250.0 * fold;
    return {{black_cells(1, 1, {400.0, 400.0}, {-200.0, -200.0},
                         {place * std::cos(angle), place * std::sin(angle), 250.0})},
            1.0};
}

// Of the pixel's area, by the midpoint rule on 1000 rows with the border's exact x in each.
double share_beyond_fold(const CameraModel& camera, int x, int y) {
    double share = 0.0;
    for (int i = 0; i < 1000; ++i) {
        const double dy = y - 0.5 + (i + 0.5) / 1000.0 - camera.intrinsics.cy;
        const double border = camera.intrinsics.cx + std::sqrt(fold_px * fold_px - dy * dy);
        share += std::clamp(x + 0.5 - border, 0.0, 1.0) / 1000.0;
    }
    return share;
}

TEST(FoldBorder, CutsAPixelToTheToleranceWhicheverWayItRuns) {
    for (const double angle : {0.0, 0.61})
        for (const double x : {15.27, 15.49, 15.508, 16.53, 17.06, 17.13, 17.29, 17.41}) {
            const CameraModel camera = camera_with_fold({x, 7.0}, angle);
            const RenderedImage image =
                Renderer(camera).render(black_scene(angle), {.region = {12, 4, 8, 4}});
            for (int column = 14; column <= 19; ++column) {
                if (image.valid.at<uchar>(7, column) == 0)
                    continue;
                EXPECT_NEAR(255.0 * image.radiance.at<float>(7, column),
                            255.0 * share_beyond_fold(camera, column, 7), 0.13)
                    << "angle " << angle << ", border at " << x << ", column " << column;
            }
        }
}

// Blurred, a pixel beside the border is off by what the plan states: 0.45 gray.
TEST(FoldBorder, IsWithinWhatThePlanStatesUnderALens) {
    const CameraModel camera =
        camera_with(640, 480, {616.6, 616.6, 319.5, 239.5}, {.k1 = -0.38},
                    Sensor{.pixel_pitch_um = 4.8}, Lens{2.8, 150.0, 600.0, {}});
    const Marker marker = parse_marker("apriltag:36h11:5@60mm", "marker");
    const Rigid pose{rotation_from_vector({0.26494, 0.01620, 0.57263}), {272.0, 204.0, 400.0}};
    const Scene scene{{{marker.grid, pose}}, 1.0};
    const cv::Rect region(636, 456, 3, 3);
    const RenderedImage image = Renderer(camera).render(scene, {.region = region});
    const ReferenceImage reference =
        integrate_reference(camera, scene, region, {.scrambles = 16, .samples_per_scramble = 4096});
    EXPECT_LT(image.plan.border_gray, 0.5);
    EXPECT_LT(image.plan.sampling_gray, 0.1);
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x)
            if (image.valid.at<uchar>(region.y + y, region.x + x) != 0) {
                EXPECT_NEAR(255.0 * image.radiance.at<float>(region.y + y, region.x + x),
                            255.0 * reference.mean.at<float>(y, x),
                            0.1 + image.plan.border_gray +
                                4.0 * 255.0 * reference.standard_error.at<float>(y, x));
            }
}

}  // namespace
}  // namespace etalon
