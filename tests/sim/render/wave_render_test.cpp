#include "sim/render/wave_render.h"

#include "sim/psf/diffraction.h"
#include "tests/evidence/edge_spread.h"
#include "tests/gray.h"
#include "tests/sim/edge_scenes.h"
#include "tests/sim/image_checks.h"

namespace etalon {
namespace {

// lambda N_w = 0.44 px.
CameraModel wave_camera() {
    return test::camera_with_lens(64, 48, {400.0, 380.0, 31.0, 23.0}, {}, 6.0,
                                  {4.3, 150.0, 600.0, {PointSpread::Kind::wave, 0.0}});
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
    const cv::Mat image = difference_of(camera, test::half_plane(0.001 * z, z), region) + 1.0;
    const auto profile =
        test::pixel_profile([&](double r) { return psf.energy_within(r); }, 13.0, 10);
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
    const Scene scene{{test::twelve_cells({4.0, 3.0}, {-8.0, -4.5}, pose)}, 0.8};
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
    EXPECT_THROW(check_wave_scene(test::half_plane(0.0, 5.0), camera), NumericalError);
    EXPECT_THROW(integrate_reference(camera, test::half_plane(0.0, 5.0), {{3, 3}}), NumericalError);
    Scene two = test::half_plane(0.0, 200.0);
    two.markers.push_back(two.markers[0]);
    EXPECT_THROW(check_wave_scene(two, camera), NumericalError);
    EXPECT_THROW(PointSpreadFunction::of(camera), NumericalError);
}

}  // namespace
}  // namespace etalon
