// A telecentric camera: projection, the closed-form methods' geometry and the reference, against
// rays traced by hand and closed-form images.
#include "sim/psf/diffraction.h"
#include "sim/render/motion_blur.h"
#include "sim/render/wave_render.h"
#include "tests/evidence/edge_spread.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

// 8.2 px/mm along x at 5 um: magnification 0.041.
CameraModel telecentric(double object_na = 0.03) {
    CameraModel camera = camera_with(
        160, 120, {8.2, 7.9, 81.0, 57.0}, {}, Sensor{.pixel_pitch_um = 5.0},
        Lens{.focus_distance_mm = 150.0, .wavelength_nm = 600.0, .object_na = object_na});
    camera.projection.kind = Projection::telecentric;
    return camera;
}

// A grid of 4 x 3 cells of 2.1 x 1.7 mm.
PlacedMarker marker_at(const Eigen::Vector3d& rotation, const Eigen::Vector3d& translation) {
    return twelve_cells({2.1, 1.7}, {-4.2, -2.5}, {rotation_from_vector(rotation), translation});
}

TEST(TelecentricProjector, KeepsSizeAtEveryDepthAndDistortsMillimetres) {
    CameraModel camera = telecentric();
    camera.distortion = {.k1 = 1e-4, .p2 = -2e-5};
    const Projector projector(camera);
    const double x = 5.0, y = -3.0, r2 = 34.0;
    const double expected_x = x * (1 + 1e-4 * r2) - 2e-5 * (r2 + 2 * x * x);
    const double expected_y = y * (1 + 1e-4 * r2) - 2 * 2e-5 * x * y;
    for (const double z : {1.0, 150.0, 9000.0}) {
        const auto pixel = projector.project({x, y, z});
        ASSERT_TRUE(pixel);
        EXPECT_NEAR(pixel->x(), 81.0 + 8.2 * expected_x, 1e-9);
        EXPECT_NEAR(pixel->y(), 57.0 + 7.9 * expected_y, 1e-9);
        const auto back = projector.unproject(*pixel);
        ASSERT_TRUE(back);
        EXPECT_LT((*back - Eigen::Vector2d(x, y)).norm(), 1e-9);
    }
    EXPECT_FALSE(projector.project({x, y, 0.0}));
    EXPECT_FALSE(projector.project({x, y, -1.0}));
}

TEST(TelecentricProjector, HasTheJacobianOfItsProjection) {
    CameraModel camera = telecentric();
    camera.distortion = {.k1 = 1e-4, .p1 = 3e-5};
    const Projector projector(camera);
    const Eigen::Vector3d p(4.0, -2.5, 130.0);
    const auto projected = projector.project_with_jacobian(p);
    for (int axis = 0; axis < 3; ++axis) {
        const Eigen::Vector3d step = 1e-4 * Eigen::Vector3d::Unit(axis);
        const Eigen::Vector2d slope =
            (*projector.project(p + step) - *projector.project(p - step)) / 2e-4;
        EXPECT_LT((projected->jacobian.col(axis) - slope).norm(), 1e-6) << axis;
    }
}

TEST(TelecentricProjector, RefusesAPerspectiveTilt) {
    CameraModel camera = telecentric();
    camera.distortion.tau_y = 0.02;
    EXPECT_THROW(Projector{camera}, NumericalError);
    EXPECT_THROW(telecentric_lens(camera), NumericalError);
}

TEST(TelecentricLens, HasItsNumbers) {
    const TelecentricLens lens = telecentric_lens(telecentric());
    EXPECT_NEAR(lens.magnification, 0.041, 1e-15);
    EXPECT_NEAR(lens.working_f_number, 0.041 / 0.06, 1e-14);
    EXPECT_NEAR(lens.cone_tangent, std::tan(std::asin(0.03)), 1e-15);
    EXPECT_NEAR(blur_radius_px(telecentric(), 142.0), 8.2 * std::tan(std::asin(0.03)) * 8.0, 1e-12);
    EXPECT_THROW(thin_lens(telecentric()), NumericalError);
    EXPECT_THROW(telecentric_lens(telecentric(1.0)), NumericalError);
    EXPECT_THROW(telecentric_lens(telecentric(0.0)), NumericalError);
    EXPECT_THROW(telecentric_lens(telecentric(std::nan(""))), NumericalError);
    // Airy: first zero at 0.61 lambda / NA in object space.
    const double scale = PointSpreadFunction::of(telecentric()).scale_px();
    EXPECT_NEAR(1.2196699 * scale / 8.2, 0.60983495 * 0.6e-3 / 0.03, 1e-9);
}

TEST(TelecentricMarkerView, RefusesWhatItCannotSee) {
    const Aperture aperture = aperture_of(telecentric(0.2));
    const auto view = [&](const Eigen::Vector3d& rotation, double z) {
        MarkerView(marker_at(rotation, {0, 0, z}), 1.0, aperture);
    };
    EXPECT_NO_THROW(view({1.3, 0, 0}, 140));
    EXPECT_THROW(view({1.4, 0, 0}, 140), NumericalError);  // 80 degrees: rays at 11.5 meet its edge
    EXPECT_THROW(view({std::numbers::pi, 0, 0}, 140), NumericalError);
    EXPECT_THROW(view({0.5, 0, 0}, 0.5), NumericalError);  // a corner behind the lens
}

class TelecentricEdge : public testing::TestWithParam<double> {};

TEST_P(TelecentricEdge, HasItsClosedFormProfile) {
    CameraModel camera = telecentric();
    camera.lens->psf = {PointSpread::Kind::gaussian, 0.7};
    const double z = GetParam(), edge_mm = 0.31;
    const auto image = Renderer(camera).render(half_plane(edge_mm, z));
    const double blur = 8.2 * std::tan(std::asin(0.03)) * std::abs(z - 150.0);
    for (int x = 65; x < 102; ++x)
        EXPECT_NEAR(image.radiance.at<float>(33, x),
                    edge_profile(x - (81.0 + 8.2 * edge_mm), blur, 0.7), 0.1 * gray)
            << "pixel " << x << " blur " << blur << " px, " << image.plan.describe();
}

INSTANTIATE_TEST_SUITE_P(Depths, TelecentricEdge,
                         testing::Values(125.0, 149.9, 150.0, 151.5, 164.0));

// A tilted marker that the plane of focus crosses, and one all out of focus, with distortion.
TEST(TelecentricRenderer, AgreesWithTheReference) {
    CameraModel camera = telecentric(0.006);  // lambda N_w = 0.41 px
    camera.distortion = {.k1 = 2e-4, .p1 = 3e-5};
    for (const double z : {150.0, 110.0}) {
        const Scene scene{{marker_at({0.6, -0.35, 0.3}, {1.1, 0.4, z})}, 0.7};
        const auto image = Renderer(camera).render(scene);
        std::vector<cv::Point> pixels;
        for (int n = 0; n < 24; ++n)
            pixels.emplace_back(55 + (n * 37) % 60, 35 + (n * 23) % 45);
        SCOPED_TRACE(image.plan.describe());
        const auto truth = test::expect_reference(image.radiance, camera, scene, pixels,
                                                  {.samples_per_scramble = 2048}, 4.5);
        double largest_contrast = 0.0;
        for (const ReferencePixel& pixel : truth)
            largest_contrast = std::max(largest_contrast, std::abs(pixel.mean - 0.7));
        EXPECT_GT(largest_contrast, 0.2);  // the pixels do see the marker
    }
}

// ---- motion blur

CameraModel narrow_pinhole() {
    return camera_with(64, 24, {400.0, 400.0, 31.0, 11.0}, {});
}

// 4 x 3 cells in an image of 64 x 24 px.
Scene moving_marker() {
    return {{twelve_cells({3.0, 2.0}, {-6.0, -3.0},
                          {rotation_from_vector({0.3, -0.4, 0.2}), {1.0, -0.5, 250.0}})}};
}

MotionDuringExposure along_x(double mm_per_s, double exposure_s) {
    MotionDuringExposure motion{Vector6d::Zero(), exposure_s};
    motion.velocity[3] = mm_per_s;
    return motion;
}

// Integral of the pixel's value (the part of it right of the edge) from an edge at minus infinity.
double swept(double edge_to_pixel_px) {
    const double t = edge_to_pixel_px + 0.5;
    return t <= 0.0 ? 0.0 : t >= 1.0 ? t - 0.5 : 0.5 * t * t;
}

// 400 px/mm/250 mm = 1.6 px per mm: the edge sweeps from 33.4 - 4.8 to 33.4 + 4.8.
TEST(MovingEdge, IsTheTrapeziumOfItsSweep) {
    const auto moving =
        render_moving(Renderer(narrow_pinhole()), half_plane(1.5, 250.0), along_x(120.0, 0.05));
    EXPECT_GE(moving.path_px, 9.6);
    for (int x = 20; x < 48; ++x) {
        const double from = x - (33.4 - 4.8), to = x - (33.4 + 4.8);
        EXPECT_NEAR(moving.image.radiance.at<float>(10, x), (swept(from) - swept(to)) / 9.6,
                    0.1 * gray)
            << x;
    }
}

// The error of a swept edge's parts, 255 * 9.6 px / (4 n^2) gray, is at most 0.05 gray from
// sqrt(255 * 9.6 / 0.2) = 110.6 parts on.
TEST(MovingEdge, NeedsItsParts) {
    EXPECT_EQ(parts_of_exposure(9.6, 1.0, 0.05), 111);
}

TEST(MovingMarker, IsTheLongAverageOfStillOnes) {
    const Renderer renderer(narrow_pinhole());
    const Scene scene = moving_marker();
    MotionDuringExposure motion{Vector6d::Zero(), 0.02};
    motion.velocity << 0.4, -1.1, 6.0, 90.0, -40.0, 300.0;
    const auto moving = render_moving(renderer, scene, motion);
    cv::Mat sum = cv::Mat::zeros(24, 64, CV_64FC1);
    constexpr int steps = 600;
    for (int i = 0; i < steps; ++i) {
        const double t = ((i + 0.5) / steps - 0.5) * 0.02;
        Scene still = scene;
        still.markers[0].camera_from_marker =
            left_perturbed(scene.markers[0].camera_from_marker, motion.velocity * t);
        sum += renderer.render(still).radiance / steps;
    }
    EXPECT_LT(moving.parts, steps / 3);
    EXPECT_GT(moving.path_px, 2.5);
    cv::Mat truth;
    sum.convertTo(truth, CV_32F);
    EXPECT_LT(cv::norm(moving.image.radiance, truth, cv::NORM_INF), 0.1 * gray);
    EXPECT_GT(cv::norm(renderer.render(scene).radiance, truth, cv::NORM_INF), 20 * gray);
}

TEST(MovingMarker, StandsStillWithoutMotion) {
    const Renderer renderer(narrow_pinhole());
    const auto moving = render_moving(renderer, moving_marker(), along_x(120.0, 0.0));
    EXPECT_EQ(moving.parts, 1);
    EXPECT_EQ(moving.path_px, 0.0);
    const Radiance still = renderer.render(moving_marker(), {.tolerance_gray = 0.05}).radiance;
    EXPECT_EQ(cv::norm(moving.image.radiance, still, cv::NORM_INF), 0.0);
}

TEST(MovingScene, MovesAsOneBody) {
    Scene scene = moving_marker();
    scene.markers.push_back(scene.markers[0]);
    scene.markers[1].camera_from_marker.translation += Eigen::Vector3d(20.0, 5.0, -3.0);
    MotionDuringExposure motion{Vector6d::Zero(), 1.0};
    motion.velocity << 0.1, 0.2, -0.5, 3.0, 4.0, 5.0;
    const Scene moved = scene_at(scene, motion, 0.3);
    const auto relative = [](const Scene& s) {
        return s.markers[0].camera_from_marker.inverse() * s.markers[1].camera_from_marker;
    };
    EXPECT_LT(left_difference(relative(scene), relative(moved)).norm(), 1e-12);
    const Vector6d done =
        left_difference(scene.markers[0].camera_from_marker, moved.markers[0].camera_from_marker);
    EXPECT_LT((done - 0.3 * motion.velocity).norm(), 1e-12);
}

TEST(MotionDuringExposure, RefusesWhatIsNone) {
    const Renderer renderer(narrow_pinhole());
    EXPECT_THROW(render_moving(renderer, moving_marker(), along_x(std::nan(""), 0.1)),
                 NumericalError);
    EXPECT_THROW(render_moving(renderer, moving_marker(), along_x(1.0, -0.1)), NumericalError);
    EXPECT_THROW(render_moving(renderer, moving_marker(), along_x(1e9, 1.0)), NumericalError);
}

// ---- wave render

// lambda N_w = 0.44 px.
CameraModel wave_camera() {
    return camera_with(64, 48, {400.0, 380.0, 31.0, 23.0}, {}, Sensor{.pixel_pitch_um = 6.0},
                       Lens{4.3, 150.0, 600.0, {PointSpread::Kind::wave, 0.0}});
}

cv::Mat difference_of(const CameraModel& camera, const Scene& scene, const cv::Rect& region) {
    const MarkerView view(scene.markers[0], scene.background, aperture_of(camera));
    return wave_difference(view, UndistortionMap(Projector(camera), 8), WaveFilter(camera), region,
                           0.1);
}

class WaveEdge : public testing::TestWithParam<double> {};

TEST_P(WaveEdge, HasTheProfileOfItsEncircledEnergy) {
    const CameraModel camera = wave_camera();
    const double z = GetParam(), edge_px = 31.0 + 400.0 * 0.001;
    const WavePointSpread psf(lambda_n_px(camera), blur_radius_px(camera, z));
    const cv::Rect region(20, 22, 24, 2);
    const cv::Mat image = difference_of(camera, half_plane(0.001 * z, z), region) + 1.0;
    const auto profile = pixel_profile([&](double r) { return psf.energy_within(r); }, 13.0, 10);
    for (int x = 0; x < region.width; ++x) {
        const double t = edge_px - (region.x + x);  // into the dark side
        const auto i = static_cast<std::size_t>(std::lround((t + 13.0) * 10.0));
        EXPECT_NEAR(image.at<float>(1, x), profile[i], 0.1 * gray)
            << "pixel " << region.x + x << ", blur " << psf.blur_radius_px() << " px";
    }
}

INSTANTIATE_TEST_SUITE_P(Depths, WaveEdge, testing::Values(20.0, 40.0, 90.0, 150.0, 260.0));

TEST(WaveRender, AgreesWithTheReferenceOnATiltedMarker) {
    CameraModel camera = wave_camera();
    camera.distortion.k1 = -0.2;
    const Rigid pose{rotation_from_vector({0.3, -0.4, 0.2}), {1.0, -0.5, 260.0}};
    const Scene scene{{twelve_cells({4.0, 3.0}, {-8.0, -4.5}, pose)}, 0.8};
    std::vector<cv::Point> pixels;
    for (int n = 0; n < 20; ++n)
        pixels.emplace_back(16 + (n * 17) % 32, 12 + (n * 11) % 22);
    const cv::Mat image =
        difference_of(camera, scene, {0, 0, camera.width, camera.height}) + scene.background;
    test::expect_reference(image, camera, scene, pixels, {.samples_per_scramble = 1024}, 4.5);
}

TEST(WaveRender, RefusesWhatItCannotRender) {
    const CameraModel camera = wave_camera();
    EXPECT_GT(blur_radius_px(camera, 5.0), 20.0);
    EXPECT_THROW(check_wave_scene(half_plane(0.0, 5.0), camera), NumericalError);
    EXPECT_THROW(integrate_reference(camera, half_plane(0.0, 5.0), {{3, 3}}), NumericalError);
    Scene two = half_plane(0.0, 200.0);
    two.markers.push_back(two.markers[0]);
    EXPECT_THROW(check_wave_scene(two, camera), NumericalError);
    EXPECT_THROW(PointSpreadFunction::of(camera), NumericalError);
}

}  // namespace
}  // namespace etalon
