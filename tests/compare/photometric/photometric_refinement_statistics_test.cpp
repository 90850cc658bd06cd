// Intrinsics from pixels, on photographs made by the reference integrator and the sensor's noise.
#include "compare/photometric/photometric_refinement.h"

#include "sim/render/reference_integrator.h"
#include "tests/compare/board_photos.h"
#include "tests/compare/rendered_targets.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int photo_count = 8;

CameraModel true_camera() {
    CameraModel camera = camera_with(160, 120, {383.0, 378.5, 77.0, 61.5});
    camera.sensor = Sensor{.pixel_pitch_um = 6.0, .gain_e_per_dn = 40.0, .read_noise_e = 20.0};
    camera.lens = Lens{.f_number = 16.0, .focus_distance_mm = 300.0, .wavelength_nm = 550.0};
    camera.lens->psf = {.kind = PointSpread::Kind::gaussian, .sigma_px = 0.7};
    return camera;
}

const Marker& refined_board() {
    static const Marker marker = parse_marker("chessboard:7x5@11mm", "test");
    return marker;
}

// Tilted up to 35 degrees every way, by the golden angle: no two alike.
Rigid pose_of(int photo) {
    const double turn = 2.4 * photo;
    const Eigen::Vector3d tilt(0.6 * std::cos(turn), 0.55 * std::sin(turn),
                               0.1 * std::sin(3 * turn));
    const Eigen::Vector3d place(6 * std::sin(5 * turn), 4 * std::cos(2 * turn),
                                300 + 30 * std::sin(4 * turn));
    return board_pose(refined_board(), tilt, place);
}

// 1024 samples a pixel where they are needed: half a gray at edges, below the noise of 1 to 2.
const std::vector<Radiance>& references() {
    static const std::vector<Radiance> images = [] {
        std::vector<Radiance> made;
        const CameraModel camera = true_camera();
        for (int i = 0; i < photo_count; ++i)
            made.push_back(0.8 *
                           integrate_reference(camera, {{{refined_board().grid, pose_of(i)}}, 1.0},
                                               cv::Rect(0, 0, camera.width, camera.height),
                                               {.samples_per_scramble = 64, .stop_at_gray = 0.3})
                               .mean);
        return made;
    }();
    return images;
}

struct Photographs {
    std::vector<CodeImage> images;
    std::vector<CalibrationView> views;
};

// Corners as a detector with this noise would find them.
Photographs photographs(double corner_noise_px, std::uint64_t seed) {
    const CameraModel camera = true_camera();
    const Projector projector(camera);
    Photographs made;
    for (int i = 0; i < photo_count; ++i) {
        const auto frame = static_cast<std::uint32_t>(i);
        made.images.push_back(SensorModel(camera).expose(references()[static_cast<std::size_t>(i)],
                                                         NoiseKey{seed, frame}));
        RandomStream random(seed, 7, frame);
        CalibrationView view{refined_board().points_mm, {}};
        for (const Eigen::Vector3d& point : view.points_mm) {
            const Eigen::Vector2d noise(random.normal(), random.normal());
            view.pixels.push_back(projector.project(pose_of(i) * point).value() +
                                  corner_noise_px * noise);
        }
        made.views.push_back(view);
    }
    return made;
}

// As a calibration does it: nothing is known of lens and noise.
PhotometricRefinement refined(const Photographs& photos) {
    const CalibrationModel& model = calibration_model("pinhole");
    const CameraFit corners = fit_camera(photos.views, {160, 120}, model);
    return refine_photometrically(photos.images, photos.views, refined_board().grid,
                                  compared_area(refined_board(), {}, "test"), corners, model);
}

// Corners that are 0.3 px off leave a camera whose error the held-out pixels see. The refined one
// is right to its formal deviations, as this noise is independent from pixel to pixel: four
// parameters of two seeds exceed 3.5 of them in 1 of 270 runs, and the mean of their squares is
// near 1.
TEST(PhotometricRefinement, FindsTheTrueCameraWhereCornersAreBad) {
    const CalibrationModel& model = calibration_model("pinhole");
    const Eigen::VectorXd truth = parameters_of(true_camera(), model);
    double squares = 0.0;
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
        const PhotometricRefinement result = refined(photographs(0.3, seed));
        EXPECT_TRUE(result.accepted) << result.in_words();
        EXPECT_GT(result.gain_gray, 0.0);
        const Eigen::VectorXd error = parameters_of(result.camera, model) - truth;
        for (Eigen::Index i = 0; i < error.size(); ++i) {
            const ParameterDeviation& deviation = result.deviations[static_cast<std::size_t>(i)];
            EXPECT_LT(std::abs(error[i]), 3.5 * deviation.formal) << deviation.name;
            squares += std::pow(error[i] / deviation.formal, 2) / 8.0;
        }
    }
    EXPECT_GT(squares, 0.2);
    EXPECT_LT(squares, 2.5);
}

// Perfect corners: nothing is left to gain but what camera parameters take up of the photometric
// model's own error (a blur on the pixel grid for one before it), 0.001 of 3 gray. Whether the
// paired test sees so little is up to the noise.
TEST(PhotometricRefinement, GainsNextToNothingWhereCornersArePerfect) {
    const PhotometricRefinement result = refined(photographs(0.0, 9));
    EXPECT_LT(std::abs(result.gain_gray), 0.01) << result.in_words();
    EXPECT_LT(result.least_gain_gray, 0.003);
    EXPECT_NE(result.in_words().find(result.accepted ? "accepted" : "refused"), std::string::npos);
}

TEST(PhotometricRefinement, NeedsSixPhotographsThatMatchTheirViews) {
    Photographs photos = photographs(0.3, 1);
    const CalibrationModel& model = calibration_model("pinhole");
    const ComparedArea area = compared_area(refined_board(), {}, "test");
    const CameraFit corners = fit_camera(photos.views, {160, 120}, model);
    const auto images = std::span(photos.images);
    EXPECT_THROW(refine_photometrically(images.first(5), photos.views, refined_board().grid, area,
                                        corners, model),
                 NumericalError);
    CameraFit few = corners;
    few.camera_from_target.resize(5);
    EXPECT_THROW(refine_photometrically(images.first(5), std::span(photos.views).first(5),
                                        refined_board().grid, area, few, model),
                 NumericalError);
}

// Two sets of 13 real photographs (OpenCV's samples): JPEG at quality 50, the board's outer columns
// cut. docs/calibration.md has the figures.
PhotometricRefinement refined(const std::string& side) {
    const BoardPhotos photos(side);
    return refine_photometrically(photos.images, photos.views, photos.board.grid,
                                  compared_area(photos.board, {}, "test"), photos.fit,
                                  calibration_model("standard"));
}

// The photometric model leaves 6.4 gray on squares that were not fitted, of which 7 are allowed;
// JPEG alone leaves 3.0. Intrinsics change that by a few hundredths, and not significantly.
class RefiningRealPhotographs : public testing::TestWithParam<const char*> {};

TEST_P(RefiningRealPhotographs, ShowsNoGain) {
    if (!photos_are_there())
        GTEST_SKIP() << "no photographs in " << ETALON_PHOTO_DIR;
    const PhotometricRefinement result = refined(std::string(GetParam()));
    ASSERT_EQ(result.photos.size(), 13u);
    EXPECT_LE(result.corners_rms_gray, 7.0);
    EXPECT_GE(result.corners_rms_gray, 3.0);
    EXPECT_NEAR(result.gain_gray, 0.0, 0.1);
    EXPECT_FALSE(result.accepted);
    // Pixels are not independent, and only one of the two standard deviations knows.
    for (const ParameterDeviation& deviation : result.deviations)
        EXPECT_GT(deviation.cluster_robust, 3.0 * deviation.formal) << deviation.name;
}

INSTANTIATE_TEST_SUITE_P(Sides, RefiningRealPhotographs, testing::Values("left", "right"));

}  // namespace
}  // namespace etalon
