// Poses from pixels, on photographs made by the reference integrator and the sensor's noise: the
// renderer that is fitted has no part in them.
#include <Eigen/Cholesky>
#include <opencv2/imgproc.hpp>

#include "compare/photometric/photometric_detector.h"
#include "compare/photometric/photometric_refinement.h"
#include "sim/render/reference_integrator.h"
#include "tests/compare/board_photos.h"
#include "tests/compare/rendered_tags.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon {
namespace {

CameraModel noisy_camera() {
    return camera_with(
        120, 90, {203.0, 199.0, 57.0, 46.0}, {.k1 = -0.2, .k2 = 0.05},
        Sensor{.pixel_pitch_um = 6.0, .black_dn = 5.0, .gain_e_per_dn = 40.0, .read_noise_e = 20.0},
        Lens{2.8, 110.0, 550.0, {}});
}

Rigid tag_pose() {
    return rigid_from_vector({0.35, -0.41, 0.2, 3.0, -2.0, 160.0});
}

const Marker& tag() {
    static const Marker marker = parse_marker("apriltag:36h11:5@40mm", "test");
    return marker;
}

// White paper at 0.8 of full scale. 4096 samples a pixel: some tenths of a gray at edges, below
// the noise of 1 to 2.
Radiance tag_reference() {
    static const Radiance radiance = [] {
        const CameraModel camera = noisy_camera();
        const Scene scene{{{tag().grid, tag_pose()}}, 1.0};
        return integrate_reference(camera, scene, cv::Rect(0, 0, camera.width, camera.height),
                                   {.samples_per_scramble = 256, .stop_at_gray = 0.2})
            .mean;
    }();
    return 0.8 * radiance;
}

const auto noisy = std::make_shared<const PhotometricCamera>(noisy_camera());

PhotoOfMarker photo(const Rigid& near, std::uint64_t seed) {
    const CodeImage image = SensorModel(noisy->model()).expose(tag_reference(), NoiseKey{seed, 0});
    return {gray_of(image), tag().grid,
            pixel_uses(noisy->projector(), near, compared_area(tag(), {}, "test")) != pixel_outside,
            255, 1.0};
}

constexpr PhotometricTerms planes_only{.level_terms = 3, .psf = false, .tone = false};

// Half a degree and a third of a pixel away.
Rigid displaced_start() {
    return left_perturbed(tag_pose(), {0.01, -0.012, 0.004, 0.25, -0.2, 0.6});
}

PhotometricPose pose_from(const PhotoOfMarker& seen, const Rigid& start) {
    return photometric_pose(seen, noisy, starting_state(seen, *noisy, start, planes_only),
                            planes_only);
}

// Of an error in standard deviations as stated, of all six components together.
double squared_distance(const PhotometricPose& pose) {
    const Vector6d error = left_difference(tag_pose(), pose.camera_from_marker);
    return error.dot(pose.covariance.ldlt().solve(error));
}

// The sum of 16 squared Mahalanobis distances of six components is a chi-square of 96 degrees of
// freedom: within 58 and 146 for all but 1 in 300 runs. A stated covariance that is wrong by a
// factor of 1.6 fails.
TEST(PhotometricPose, ScattersAsItsCovarianceSays) {
    double distances = 0.0;
    int converged = 0;
    for (std::uint64_t seed = 1; seed <= 16; ++seed) {
        const PhotoOfMarker seen = photo(displaced_start(), seed);
        const PhotometricPose pose = pose_from(seen, displaced_start());
        converged += pose.converged ? 1 : 0;
        EXPECT_NEAR(pose.reduced_squares, 1.0, 0.1);
        // No light gives 5 codes, full light 5 + 0.8 * 250.
        EXPECT_NEAR(pose.photometry.black[0], 5.0, 0.5);
        EXPECT_NEAR(pose.photometry.white[0], 205.0, 0.5);
        distances += squared_distance(pose);
    }
    EXPECT_EQ(converged, 16);
    EXPECT_GT(distances, 58.0);
    EXPECT_LT(distances, 146.0);
}

// A camera that says nothing of its noise: the residuals do, and the pose is the same.
TEST(PhotometricPose, TakesTheNoiseFromTheResidualsWhereTheCameraHasNone) {
    CameraModel silent = noisy_camera();
    silent.sensor->gain_e_per_dn = 0.0;
    silent.sensor->read_noise_e = 0.0;
    const auto without = std::make_shared<const PhotometricCamera>(silent);
    const PhotoOfMarker seen = photo(displaced_start(), 4);
    const PhotoState start = starting_state(seen, *noisy, displaced_start(), planes_only);
    const PhotometricPose known = photometric_pose(seen, noisy, start, planes_only);
    const PhotometricPose found = photometric_pose(seen, without, start, planes_only);
    // The noise of dark and light pixels differs by a factor of two, of which one number knows
    // nothing: the weights are other ones, and the deviations agree to a few tenths.
    for (int i = 0; i < 6; ++i) {
        const double ratio = std::sqrt(found.covariance(i, i) / known.covariance(i, i));
        EXPECT_GT(ratio, 0.7);
        EXPECT_LT(ratio, 1.5);
    }
}

// The photograph as a bent print gives it: displaced by 0.1 px, smoothly over some 14 px.
cv::Mat bent(const cv::Mat& gray, std::uint64_t seed) {
    RandomStream random(seed, 5);
    std::array<cv::Mat, 2> knots, by;
    for (cv::Mat& each : knots)
        each.create(8, 8, CV_32FC1);
    for (int i = 0; i < 64; ++i)
        for (cv::Mat& each : knots)
            each.at<float>(i / 8, i % 8) = static_cast<float>(0.1 * random.normal());
    for (std::size_t k = 0; k < 2; ++k) {
        cv::resize(knots[k], by[k], gray.size(), 0, 0, cv::INTER_CUBIC);
        by[k] += image_of(gray.size(), [k](int x, int y) { return k == 0 ? x : y; });
    }
    cv::Mat result;
    cv::remap(gray, result, by[0], by[1], cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    return result;
}

// What a bent print does to the pose no noise of single pixels explains: taken as independent they
// would state deviations five times too small, a sum of squares of some 6000. 40 poses of six
// components make 240. Neighbouring parts of the picture bend alike, which the parts' own scatter
// does not show: deviations may be too small by half, no more.
TEST(PhotometricPose, StatesWhatABentPrintDoesToIt) {
    double distances = 0.0;
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
        PhotoOfMarker seen = photo(displaced_start(), seed);
        seen.gray = bent(seen.gray, seed);
        distances += squared_distance(pose_from(seen, displaced_start()));
    }
    EXPECT_GT(distances, 240.0 / 4.0);
    EXPECT_LT(distances, 240.0 * 4.0);
}

TEST(PhotometricPose, MirrorsTheTiltAboutTheLineOfSight) {
    const Rigid mirrored = tilt_mirrored(tag_pose(), tag().grid);
    // The middle of a tag is its origin: it stays. So do the axes' components across the line of
    // sight; those along it change sign.
    EXPECT_LT((mirrored.translation - tag_pose().translation).norm(), 1e-12);
    const Eigen::Vector3d sight = tag_pose().translation.normalized();
    for (const Eigen::Vector3d axis : {Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY()}) {
        const Eigen::Vector3d before = tag_pose().rotation * axis;
        const Eigen::Vector3d after = mirrored.rotation * axis;
        EXPECT_NEAR(sight.dot(after), -sight.dot(before), 1e-12);
        EXPECT_LT(sight.cross(after - before).norm(), 1e-12);
    }
    const Rigid twice = tilt_mirrored(mirrored, tag().grid);
    EXPECT_LT(left_difference(tag_pose(), twice).norm(), 1e-12);
}

// Either start ends in the true pose, and the other solution is stated with its loss.
TEST(PhotometricPose, TellsThePlanarSolutionsApartByTheirLoss) {
    const PhotoOfMarker seen = photo(tag_pose(), 5);
    for (const Rigid& start : {displaced_start(), tilt_mirrored(displaced_start(), tag().grid)}) {
        const PhotometricPose pose = pose_from(seen, start);
        EXPECT_LT(squared_distance(pose), 30.0);
        ASSERT_TRUE(pose.other);
        EXPECT_GT(pose.other->log_likelihood_ratio, 100.0);
        EXPECT_NEAR(pose.other->loss - pose.loss, pose.other->log_likelihood_ratio, 1e-9);
        // Tilted by 31 degrees: twice that apart.
        const double apart = pose.other->camera_from_marker.rotation.angularDistance(
            pose.camera_from_marker.rotation);
        EXPECT_GT(apart, 0.5);
    }
}

TEST(PhotometricPose, RefusesWhatDeterminesNoPose) {
    PhotoOfMarker seen = photo(tag_pose(), 6);
    PhotoOfMarker nothing = seen;
    nothing.use = cv::Mat(seen.use.size(), CV_8UC1, cv::Scalar(0));
    EXPECT_THROW(starting_state(nothing, *noisy, tag_pose(), planes_only), NumericalError);
    const PhotoState start = starting_state(seen, *noisy, tag_pose(), planes_only);
    EXPECT_THROW(photometric_pose(nothing, noisy, start, planes_only), NumericalError);
    PhotoOfMarker other_size = seen;
    other_size.gray = cv::Mat(20, 30, CV_32FC1, cv::Scalar(100));
    EXPECT_THROW(photometric_pose(other_size, noisy, start, planes_only), NumericalError);
    seen.gray.at<float>(45, 60) = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THROW(photometric_pose(seen, noisy, start, planes_only), NumericalError);
}

// ---- photometric refinement

// Intrinsics from pixels, on photographs made by the reference integrator and the sensor's noise.

constexpr int photo_count = 8;

CameraModel true_camera() {
    return camera_with(160, 120, {383.0, 378.5, 77.0, 61.5}, {},
                       Sensor{.pixel_pitch_um = 6.0, .gain_e_per_dn = 40.0, .read_noise_e = 20.0},
                       Lens{16.0, 300.0, 550.0, {PointSpread::Kind::gaussian, 0.7}});
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
            const Eigen::Vector2d noise{random.normal(), random.normal()};
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
