#include "compare/photometric/photo_match.h"

#include "tests/calib/cameras.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon {
namespace {

CameraModel small_camera() {
    return test::camera_with(320, 240, {300.0, 305.0, 161.0, 118.0}, {.k1 = -0.2});
}

Marker board() {
    return parse_marker("chessboard:9x6@25mm", "test");
}

// A tag of 8 x 8 cells of 5 mm, its border and its white surroundings included.
Marker tag() {
    return parse_marker("aruco:4X4_50:7@30mm", "test");
}

TEST(ComparedArea, OfAChessboardIsItsInnerCornersAndTheMargin) {
    const ComparedArea area = compared_area(board(), {}, "test");
    EXPECT_LT((area.low_mm - Eigen::Vector2d(-7.5, -16.25)).norm(), 1e-12);
    EXPECT_LT((area.high_mm - Eigen::Vector2d(207.5, 141.25)).norm(), 1e-12);
}

TEST(ComparedArea, OfATagIsItsWholeGrid) {
    const ComparedArea area = compared_area(tag(), {}, "test");
    EXPECT_LT((area.low_mm - Eigen::Vector2d(-20, -20)).norm(), 1e-12);
    EXPECT_LT((area.high_mm - Eigen::Vector2d(20, 20)).norm(), 1e-12);
}

TEST(ComparedArea, RefusesMarginsThatLeaveNothingOrReachOffTheBoard) {
    for (const double margin : {-0.5, 1.01, std::nan(""), HUGE_VAL}) {
        EXPECT_THROW(compared_area(board(), {margin, 0.1}, "test"), ConfigError);
        EXPECT_THROW(compared_area(board(), {0.1, margin}, "test"), ConfigError);
    }
}

// To the nearest line between two uses on that board.
double distance_to_border_mm(const Eigen::Vector3d& point) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const double x : {-2.5, 0.0, 20.0, 40.0, 42.5})
        nearest = std::min(nearest, std::abs(point.x() - x));
    for (const double y : {-5.0, 0.0, 20.0, 35.0})
        nearest = std::min(nearest, std::abs(point.y() - y));
    return nearest;
}

// Truth: the pixel's own ray cut with the plane, by solving for the depth. What is interpolated may
// be a hundredth of a pixel aside.
TEST(PixelUses, FollowThePlaneThroughDistortionAndTilt) {
    const Projector projector(small_camera());
    const ComparedArea area =
        compared_area(parse_marker("chessboard:5x4@10mm", "test"), {0.25, 0.5}, "test");
    const Rigid pose{rotation_from_vector({0.5, -0.3, 0.4}), {-12.0, -8.0, 110.0}};
    const cv::Mat uses = pixel_uses(projector, pose, area);
    ASSERT_EQ(uses.size(), cv::Size(320, 240));
    const Eigen::Vector3d normal = pose.rotation * Eigen::Vector3d::UnitZ();
    int counted[3] = {0, 0, 0};
    for (int y = 0; y < 240; ++y)
        for (int x = 0; x < 320; ++x) {
            const Eigen::Vector3d ray = projector.unproject({x, y}).value().homogeneous();
            const Eigen::Vector3d hit = ray * (normal.dot(pose.translation) / normal.dot(ray));
            const Eigen::Vector3d p_marker = pose.inverse() * hit;
            const bool inside = p_marker.x() >= -2.5 && p_marker.x() <= 42.5 &&
                                p_marker.y() >= -5.0 && p_marker.y() <= 35.0 && hit.z() > 0;
            const int block_x = static_cast<int>(std::floor(p_marker.x() / 20.0));
            const int block_y = static_cast<int>(std::floor(p_marker.y() / 20.0));
            const int expected = !inside ? 0 : (block_x + block_y) % 2 == 0 ? 1 : 2;
            const double hundredth_px_mm = 0.01 * hit.z() / projector.camera().intrinsics.fx;
            if (distance_to_border_mm(p_marker) > hundredth_px_mm) {
                EXPECT_EQ(uses.at<uchar>(y, x), expected) << x << ", " << y;
            }
            ++counted[uses.at<uchar>(y, x)];
        }
    EXPECT_GT(counted[pixel_fitted], 3000);
    EXPECT_GT(counted[pixel_scored], 3000);
}

TEST(PixelUses, AreNoneForAMarkerBehindTheCameraEdgeOnOrOutside) {
    const Projector projector(small_camera());
    const ComparedArea area = compared_area(tag(), {}, "test");
    const auto count = [&](const Rigid& pose) {
        return cv::countNonZero(pixel_uses(projector, pose, area));
    };
    EXPECT_GT(count({Eigen::Quaterniond::Identity(), {7, 5, 150}}), 100);
    EXPECT_EQ(count({Eigen::Quaterniond::Identity(), {7, 5, -150}}), 0);
    EXPECT_EQ(count({Eigen::Quaterniond::Identity(), {900, 5, 150}}), 0);
    EXPECT_EQ(count({rotation_from_vector({std::acos(-1.0) / 2, 0, 0}), {0, 0, 150}}), 0);
}

// A photograph that the model describes exactly, but for noise and rounding.
struct NoisyScene {
    explicit NoisyScene(const CameraModel& model) : camera(model) {}

    PhotoOfMarker photo(double noise_gray, int bits) const {
        PhotometricModel truth;
        truth.black << 30.0, 4.0, -6.0, 8.0, -3.0, 5.0;
        truth.white << 190.0, -20.0, 10.0, -30.0, 12.0, -25.0;
        truth.psf_sigma_px = 0.9;
        truth.psf_anisotropy_px2 = 0.2;
        const Radiance radiance = camera.at_sensor({{{marker.grid, pose}}, 1.0}, {0, 0, 320, 240});
        cv::Mat gray = predicted_gray(truth, radiance, {});
        RandomStream random(3, 9);
        gray += test::normal_noise(gray.size(), noise_gray, random);
        CodeImage image{{}, bits};
        gray.convertTo(image.pixels, bits > 8 ? CV_16U : CV_8U, image.full_scale() / 255.0);
        return {gray_of(image), marker.grid, use, pixel_fitted, 1.0};
    }

    PhotometricCamera camera;
    Marker marker = parse_marker("chessboard:6x5@10mm", "test");
    Rigid pose{rotation_from_vector({0.3, -0.2, 0.1}), {-25.0, -15.0, 120.0}};
    cv::Mat use = pixel_uses(camera.projector(), pose, compared_area(marker, {0.4, 0.4}, "test"));
};

// Rounding to 8 bits leaves an RMS of 1/sqrt(12) = 0.289 gray, and nothing else is wrong.
TEST(PhotoFit, LeavesOnlyRoundingWhenTheRenderingIsRight) {
    const NoisyScene scene(small_camera());
    const PhotoFit fit = fit_photometry(scene.photo(0.0, 8), scene.camera, scene.pose);
    EXPECT_NEAR(fit.scored.rms_gray, 0.289, 0.03);
    EXPECT_NEAR(fit.scored.mean_gray, 0.0, 0.05);
    EXPECT_LE(fit.scored.worst_gray, 0.9);
    EXPECT_EQ(fit.scored.pixels, cv::countNonZero(scene.use == pixel_scored));
}

TEST(PhotoFit, FindsAnErrorInTheScoredHalfAlone) {
    const NoisyScene scene(small_camera());
    PhotoOfMarker photo = scene.photo(0.0, 8);
    cv::add(photo.gray, cv::Scalar(12), photo.gray, scene.use == pixel_scored);
    const PhotoFit fit = fit_photometry(photo, scene.camera, scene.pose);
    EXPECT_NEAR(fit.scored.mean_gray, 12.0, 0.3);
    EXPECT_NEAR(fit.scored.rms_gray, 12.0, 0.3);
    EXPECT_NEAR(fit.fitted.mean_gray, 0.0, 0.1);
}

// Pure noise of the camera's own size: 0.27 % of normal deviates lie beyond three standard
// deviations. Of about 9 000 scored pixels 24 +- 5: between 0.05 % and 0.6 % by a wide margin.
TEST(PhotoFit, KnowsNoiseFromSignificantResiduals) {
    CameraModel model = small_camera();
    // 40 DN of read noise, much more than shot noise at any level.
    model.sensor = Sensor{.bits = 12, .gain_e_per_dn = 50.0, .read_noise_e = 50.0 * 40.0};
    const NoisyScene scene(model);
    const double sigma_gray = 40.0 * 255.0 / 4095.0;
    const PhotoFit quiet = fit_photometry(scene.photo(sigma_gray, 12), scene.camera, scene.pose);
    EXPECT_EQ(quiet.noise_source, NoiseSource::camera);
    EXPECT_NEAR(quiet.noise_gray, sigma_gray, 0.05) << "shot noise adds 1 to 2 %";
    EXPECT_LT(quiet.scored.significant.value(), 0.006);
    EXPECT_GT(quiet.scored.significant.value(), 0.0005);
    EXPECT_NEAR(quiet.scored.rms_gray, sigma_gray, 0.1);
    EXPECT_NEAR(quiet.scored.p99_gray, 2.576 * sigma_gray, 0.4);

    const PhotoFit loud =
        fit_photometry(scene.photo(3.0 * sigma_gray, 12), scene.camera, scene.pose);
    EXPECT_NEAR(loud.scored.significant.value(), 0.317, 0.04) << "beyond one standard deviation";
}

// Half of the scored pixels are 25 gray off: the noise, found on the other half, does not follow.
TEST(PhotoFit, TakesTheNoiseFromTheFittedHalfWhereTheCameraKnowsNone) {
    const NoisyScene scene(small_camera());
    PhotoOfMarker photo = scene.photo(2.5, 8);
    const PhotoFit right = fit_photometry(photo, scene.camera, scene.pose);
    EXPECT_EQ(right.noise_source, NoiseSource::residuals);
    EXPECT_NEAR(right.noise_gray, std::hypot(2.5, 0.289), 0.1);
    EXPECT_LT(right.scored.significant.value(), 0.006);
    cv::Mat left_half = scene.use == pixel_scored;
    left_half.colRange(160, 320).setTo(0);
    cv::add(photo.gray, cv::Scalar(25), photo.gray, left_half);
    const PhotoFit wrong = fit_photometry(photo, scene.camera, scene.pose);
    EXPECT_NEAR(wrong.noise_gray, right.noise_gray, 1e-3);
    EXPECT_NEAR(wrong.scored.significant.value(),
                cv::countNonZero(left_half) / static_cast<double>(wrong.scored.pixels), 0.01);
}

// 12 bit, 2 electrons a DN, 6 electrons read noise: at 1000 DN above black the variance is
// 1000 / 2 + 3^2 + 1/12 DN^2.
TEST(NoiseGray, IsShotReadAndRoundingNoise) {
    const Sensor sensor{.bits = 12, .black_dn = 64.0, .gain_e_per_dn = 2.0, .read_noise_e = 6.0};
    const double gray = (1000.0 + 64.0) / 4095.0 * 255.0;
    const double expected = std::sqrt(500.0 + 9.0 + 1.0 / 12.0) / 4095.0 * 255.0;
    EXPECT_NEAR(noise_gray(sensor, gray).value(), expected, 1e-6);
    EXPECT_FALSE(noise_gray(Sensor{}, gray));
}

}  // namespace
}  // namespace etalon
