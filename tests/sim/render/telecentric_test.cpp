// A telecentric camera: projection, the closed-form methods' geometry and the reference, against
// rays traced by hand and closed-form images.

#include "sim/psf/diffraction.h"
#include "tests/gray.h"
#include "tests/sim/edge_scenes.h"
#include "tests/sim/image_checks.h"

namespace etalon {
namespace {

// 8.2 px/mm along x at 5 um: magnification 0.041.
CameraModel telecentric(double object_na = 0.03) {
    CameraModel camera = test::camera_with_lens(
        160, 120, {8.2, 7.9, 81.0, 57.0}, {}, 5.0,
        {.focus_distance_mm = 150.0, .wavelength_nm = 600.0, .object_na = object_na});
    camera.projection.kind = Projection::telecentric;
    return camera;
}

// A grid of 4 x 3 cells of 2.1 x 1.7 mm.
PlacedMarker marker_at(const Eigen::Vector3d& rotation, const Eigen::Vector3d& translation) {
    return test::twelve_cells({2.1, 1.7}, {-4.2, -2.5},
                              {rotation_from_vector(rotation), translation});
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
    const auto image = Renderer(camera).render(test::half_plane(edge_mm, z));
    const double blur = 8.2 * std::tan(std::asin(0.03)) * std::abs(z - 150.0);
    for (int x = 65; x < 102; ++x)
        EXPECT_NEAR(image.radiance.at<float>(33, x),
                    test::edge_profile(x - (81.0 + 8.2 * edge_mm), blur, 0.7), 0.1 * gray)
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

}  // namespace
}  // namespace etalon
