// Poses from pixels, on photographs made by the reference integrator and the sensor's noise: the
// renderer that is fitted has no part in them.
#include "compare/photometric/photometric_detector.h"

#include <Eigen/Cholesky>
#include <opencv2/imgproc.hpp>

#include "sim/render/reference_integrator.h"
#include "tests/calib/cameras.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon {
namespace {

CameraModel noisy_camera() {
    CameraModel camera = camera_with(120, 90, {203.0, 199.0, 57.0, 46.0}, {.k1 = -0.2, .k2 = 0.05});
    camera.sensor = Sensor{.pixel_pitch_um = 6.0,
                           .bits = 8,
                           .black_dn = 5.0,
                           .gain_e_per_dn = 40.0,
                           .read_noise_e = 20.0};
    camera.lens = Lens{.f_number = 2.8, .focus_distance_mm = 110.0, .wavelength_nm = 550.0};
    return camera;
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

}  // namespace
}  // namespace etalon
