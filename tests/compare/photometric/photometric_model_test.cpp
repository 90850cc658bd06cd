#include "compare/photometric/photometric_model.h"

#include "compare/photometric/photo_match.h"
#include "compare/photometric/photometric_equations.h"
#include "sim/marker/marker.h"
#include "sim/sensor/sensor_model.h"
#include "tests/calib/cameras.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int width = 160, height = 120;

PhotometricModel some_model() {
    PhotometricModel model;
    model.black.head<3>() << 23.0, 7.0, -5.0;
    model.white.head<3>() << 201.0, -31.0, 17.0;
    model.psf_sigma_px = 0.83;
    return model;
}

TEST(PhotometricModel, PredictsBlackAndWhitePlanes) {
    const PhotometricModel model = some_model();
    Radiance flat(height, width, CV_32FC1, cv::Scalar(0));
    const cv::Mat dark = predicted_gray(model, flat, {});
    // Top left is half an image from the centre, less half a pixel: 159/320 and 119/240.
    EXPECT_NEAR(dark.at<float>(0, 0), 23.0 - 7.0 * 159 / 320 + 5.0 * 119 / 240, 1e-4);
    EXPECT_NEAR(dark.at<float>(height - 1, 0), 23.0 - 7.0 * 159 / 320 - 5.0 * 119 / 240, 1e-4);
    flat.setTo(1.0f);
    const cv::Mat light = predicted_gray(model, flat, {});
    EXPECT_NEAR(light.at<float>(0, width - 1), 201.0 - 31.0 * 159 / 320 - 17.0 * 119 / 240, 1e-4);
}

// A camera with a black level of 8 sees black at 23 and white at 201 of 255: on Rec. 709's straight
// toe (below 0.081) and on its power. Half of that light is neither's half.
TEST(PhotometricModel, TakesTheCamerasTransferCurveBetweenItsOwnLevels) {
    PhotometricModel model = some_model();
    model.psf_sigma_px = 0.0;
    model.black.tail<5>().setZero();
    model.white.tail<5>().setZero();
    const Radiance half(height, width, CV_32FC1, cv::Scalar(0.5));
    Sensor sensor;
    sensor.transfer.kind = Transfer::Kind::rec709;
    sensor.black_dn = 8.0;
    const double dark = 15.0 / 247.0 / 4.5;
    const double light = std::pow((193.0 / 247.0 + 0.099) / 1.099, 1.0 / 0.45);
    const double expected = 8.0 + 247.0 * (1.099 * std::pow(0.5 * (dark + light), 0.45) - 0.099);
    const cv::Mat seen = predicted_gray(model, half, {sensor, model});
    EXPECT_NEAR(seen.at<float>(60, 80), expected, 1e-3);
    EXPECT_GT(std::abs(expected - (23.0 + 178.0 * (1.099 * std::pow(0.5, 0.45) - 0.099))), 0.5)
        << "what a curve between 0 and 1 would give";
}

TEST(LightCurve, RunsFromBlackToWhiteWithItsOwnSlope) {
    Sensor sensor;
    sensor.transfer.kind = Transfer::Kind::rec709;
    const PhotometricModel model = some_model();
    const LightCurve curve(sensor, model);
    EXPECT_NEAR(curve.value(0.0), 0.0, 1e-12);
    EXPECT_NEAR(curve.value(1.0), 1.0, 1e-12);
    for (const double radiance : {-0.02, 0.3, 0.7}) {
        const double slope = (curve.value(radiance + 1e-3) - curve.value(radiance - 1e-3)) / 2e-3;
        EXPECT_NEAR(curve.at(radiance).slope, slope, 1e-3);
    }
    EXPECT_EQ(LightCurve().value(0.37), 0.37);
    EXPECT_EQ(LightCurve(std::nullopt, model).value(0.37), 0.37);
}

TEST(PhotometricModel, SaysHowGrayChangesWithWhatIsSeen) {
    PhotometricModel model = some_model();
    model.tone = 0.3;
    model.saturation = Saturation{190.0, 12.0};
    const Vector6d terms = level_terms(31.0, 90.0, {width, height});
    constexpr double step = 1e-5;
    for (const double seen : {0.0, 0.4, 0.8, 0.95, 1.0}) {
        const double slope =
            (model.at(terms, seen + step).gray - model.at(terms, seen - step).gray) / (2 * step);
        EXPECT_NEAR(model.at(terms, seen).by_seen, slope, 1e-4) << "seen " << seen;
    }
}

// The expectation of min(gray + n, level) as a sum over n, and its derivatives from differences.
double clipped_mean(double gray, double level, double knee) {
    constexpr int steps = 40000;
    double sum = 0.0, weights = 0.0;
    for (int i = -steps; i <= steps; ++i) {
        const double z = 10.0 * i / steps, weight = std::exp(-0.5 * z * z);
        sum += weight * std::min(gray + knee * z, level);
        weights += weight;
    }
    return sum / weights;
}

TEST(Saturation, IsTheMeanOfAClippedNormal) {
    constexpr double level = 246.0, knee = 17.0, step = 0.01;
    for (const double gray : {40.0, 180.0, 215.0, 243.0, 246.0, 271.0, 330.0, 500.0}) {
        const Saturation::Point point = Saturation{level, knee}.at(gray);
        const auto change = [&](double by_gray, double by_level, double by_knee) {
            return (clipped_mean(gray + by_gray, level + by_level, knee + by_knee) -
                    clipped_mean(gray - by_gray, level - by_level, knee - by_knee)) /
                   (2.0 * step);
        };
        EXPECT_NEAR(point.gray, clipped_mean(gray, level, knee), 1e-4);
        EXPECT_NEAR(point.slope, change(step, 0, 0), 1e-4) << "gray " << gray;
        EXPECT_NEAR(point.by_level, change(0, step, 0), 1e-4) << "gray " << gray;
        EXPECT_NEAR(point.by_knee, change(0, 0, step), 1e-4) << "gray " << gray;
    }
}

TEST(GrayOf, ScalesEveryBitDepthTo255) {
    const cv::Mat eight(1, 1, CV_8UC1, cv::Scalar(51));
    EXPECT_NEAR(gray_of({eight, 8}).at<float>(0), 51.0, 1e-4);
    const cv::Mat twelve(1, 1, CV_16UC1, cv::Scalar(819));
    EXPECT_NEAR(gray_of({twelve, 12}).at<float>(0), 51.0, 1e-4);
}

// Of the impulse response of blurred(): the sum, the second moments along x and y, the fourth
// along x.
template <class Sigma>
Eigen::Vector4d moments(const Sigma& sigma) {
    cv::Mat impulse = cv::Mat::zeros(61, 61, CV_64FC1);
    impulse.at<double>(30, 30) = 1.0;
    const cv::Mat response = blurred(impulse, sigma);
    Eigen::Vector4d sums = Eigen::Vector4d::Zero();
    for (int y = -30; y <= 30; ++y)
        for (int x = -30; x <= 30; ++x)
            sums += response.at<double>(y + 30, x + 30) *
                    Eigen::Vector4d(1, x * x, y * y, std::pow(x, 4));
    return sums;
}

TEST(Blurred, MayDifferAlongXAndY) {
    PhotometricModel model;
    model.psf_sigma_px = 1.1;
    model.psf_anisotropy_px2 = 0.35;
    const Eigen::Vector4d found = moments(model.psf_sigmas_px());
    EXPECT_NEAR(found[1], 1.21 + 0.35, 1e-3);
    EXPECT_NEAR(found[2], 1.21 - 0.35, 1e-3);
}

// The moments of the impulse response are a Gaussian's of the variance asked for, at every width.
TEST(Blurred, HasExactlyTheVarianceAskedForAndKeepsTheSum) {
    for (const double sigma : {0.0, 0.2, 0.5, 0.83, 1.7, 3.0}) {
        const Eigen::Vector4d found = moments(sigma);
        EXPECT_NEAR(found[0], 1.0, 1e-9);
        EXPECT_NEAR(found[3], 3.0 * std::pow(sigma, 4), 1e-3 * (3.0 * std::pow(sigma, 4) + 0.01));
        EXPECT_NEAR(found[1], sigma * sigma, 1e-4 * (sigma * sigma + 0.01)) << "sigma " << sigma;
    }
}

constexpr double pi = std::numbers::pi;

// The mean code: truth is the uniform quantiser's Fourier series, and the sensor itself with its
// noise drawn. Without a curve and nearly without shot noise: sigma in codes is the read noise's.
Sensor steady_sensor(double sigma_codes, double black) {
    return {.black_dn = black, .gain_e_per_dn = 1e7, .read_noise_e = sigma_codes * 1e7};
}

// Widrow and Kollar: the mean of a rounded normal variable.
double rounded_mean(double code, double sigma) {
    double mean = code;
    for (int n = 1; n < 40; ++n)
        mean += (n % 2 ? -1.0 : 1.0) / (pi * n) * std::sin(2.0 * pi * n * code) *
                std::exp(-2.0 * pi * pi * n * n * sigma * sigma);
    return mean;
}

TEST(MeanCode, IsThatOfTheUniformQuantisersSeries) {
    for (const double sigma : {0.12, 0.17, 0.31, 0.9}) {
        const MeanCode mean(steady_sensor(sigma, 7.3));
        for (const double code : {41.0, 41.21, 41.5, 41.83, 126.37})
            EXPECT_NEAR(mean.at(code).gray, rounded_mean(code, sigma), 0.008) << sigma;
    }
    EXPECT_NEAR(rounded_mean(41.21, 0.17), 41.05, 0.01) << "the bias that is meant";
}

TEST(MeanCode, SlopesAsItRises) {
    const MeanCode mean(steady_sensor(0.17, 7.3));
    constexpr double step = 0.01;
    for (double gray = -3.03; gray < 260.0; gray += 0.177) {
        const MeanCode::Point at = mean.at(gray);
        EXPECT_GE(at.slope, 0.0);
        const double chord = (mean.at(gray + step).gray - mean.at(gray - step).gray) / (2 * step);
        EXPECT_NEAR(at.slope, chord, 0.35) << gray;  // a kink of the table's may lie between
    }
}

// 10 bits behind a curve, with black at 0, where half of the noise is cut off, and white at the
// end.
TEST(MeanCode, IsTheMeanOfWhatTheSensorDraws) {
    CameraModel camera = camera_with(1000, 800, {});
    Sensor& sensor = camera.sensor.emplace(Sensor{
        .transfer = {Transfer::Kind::rec709, {}}, .gain_e_per_dn = 60.0, .read_noise_e = 10.0});
    for (const int bits : {8, 10}) {
        sensor.bits = bits;
        const SensorModel model(camera);
        const MeanCode mean(sensor);
        std::uint64_t seed = 3;
        for (const double radiance : {0.0, 0.00071, 0.0213, 0.17, 0.77, 0.9999}) {
            const Radiance even(camera.height, camera.width, CV_32FC1, cv::Scalar(radiance));
            const cv::Mat codes = gray_of(model.expose(even, NoiseKey{seed++, 0}));
            cv::Scalar found, scatter;
            cv::meanStdDev(codes, found, scatter);
            const double standard_error = scatter[0] / std::sqrt(codes.total());
            EXPECT_NEAR(mean.at(255.0 * encode(sensor.transfer, radiance)).gray, found[0],
                        4.0 * standard_error + 0.002)
                << bits << " bits, " << radiance;
        }
    }
}

TEST(MeanCode, ChangesWithTheStatedNoise) {
    constexpr double more = 0.01;
    const MeanCode mean(steady_sensor(0.2, 7.3)), noisier(steady_sensor(0.2 * (1.0 + more), 7.3));
    for (const double gray : {7.3, 41.21, 126.83, 254.9}) {
        const double change = (noisier.at(gray).gray - mean.at(gray).gray) / more;
        EXPECT_NEAR(mean.at(gray).by_log_noise, change, 0.02 * std::abs(change) + 1e-6);
        EXPECT_GT(std::abs(change), 0.01);
    }
}

TEST(MeanCode, IsTheLightsOwnWhereNoNoiseIsStatedAndWhereCodesAreFine) {
    Sensor silent, fine = steady_sensor(0.2, 7.3);
    fine.bits = 12;
    for (const Sensor& sensor : {silent, fine}) {
        const MeanCode::Point at = MeanCode(sensor).at(41.21);
        EXPECT_EQ(at.gray, 41.21);
        EXPECT_EQ(at.slope, 1.0);
        EXPECT_EQ(at.by_log_noise, 0.0);
    }
}

// Hardly any noise: a step would have no slope for a fit to follow.
TEST(MeanCode, IsNoStaircase) {
    const MeanCode mean(steady_sensor(1e-4, 0.0));
    for (double gray = 3.0; gray < 4.0; gray += 0.01)
        EXPECT_NEAR(mean.at(gray).gray, rounded_mean(gray, 0.1), 0.02);
}

// ---- photo fit

CameraModel small_camera() {
    return camera_with(320, 240, {300.0, 305.0, 161.0, 118.0}, {.k1 = -0.2});
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
        gray += normal_noise(gray.size(), noise_gray, random);
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

// ---- render derivatives

// Derivatives of renderings against central differences of renderings.

const cv::Rect region(60, 30, 140, 130);

CameraModel distorted_camera(double psf_sigma_px) {
    CameraModel camera =
        camera_with(240, 180, {301.0, 296.0, 117.0, 93.0},
                    {.k1 = -0.21, .k2 = 0.07, .p1 = 0.002, .p2 = -0.001, .k3 = 0.01});
    if (psf_sigma_px > 0) {
        camera.sensor = Sensor{.pixel_pitch_um = 6.0};
        camera.lens = Lens{1000.0, 200.0, 550.0, {PointSpread::Kind::gaussian, psf_sigma_px}};
    }
    return camera;
}

Scene scene_at(const Rigid& pose) {
    return {{{parse_marker("apriltag:36h11:5@40mm", "test").grid, pose}}, 1.0};
}

cv::Mat rendered(const CameraModel& camera, const Rigid& pose) {
    return Renderer(camera).render(scene_at(pose), {.tolerance_gray = 0.02}).radiance(region);
}

// The derivative image of one column of the motion.
cv::Mat derivative(const RenderedGradient& gradient, const ImageMotion& motion, int column) {
    Eigen::Matrix2Xd moved(2, motion.columns());
    return image_of(region.size(), [&](int x, int y) {
        if (!motion.at(region.x + x, region.y + y, moved))
            return 0.0;
        return -(gradient.by_x.at<float>(y, x) * moved(0, column) +
                 gradient.by_y.at<float>(y, x) * moved(1, column));
    });
}

double relative_error(const cv::Mat& found, const cv::Mat& truth) {
    return cv::norm(found - truth) / cv::norm(truth);
}

// The step that moves the image by at most 0.1 px: there the central difference itself is right to
// some tenths of a per cent where the image is blurred.
double largest_motion(const ImageMotion& motion, int column) {
    Eigen::Matrix2Xd moved(2, motion.columns());
    double largest = 0.0;
    for (int y = region.y; y < region.br().y; y += 8)
        for (int x = region.x; x < region.br().x; x += 8)
            if (motion.at(x, y, moved))
                largest = std::max(largest, moved.col(column).norm());
    return largest;
}

// `share` is of the derivatives that move the marker as a whole, `share_of_others` of those that
// stretch or bend it.
void expect_central_differences(const CameraModel& camera, double share, double share_of_others) {
    const CalibrationModel& model = calibration_model("standard");
    const Rigid pose = rigid_from_vector({0.31, -0.42, 0.23, 4.0, 2.0, 190.0});
    const ImageMotion motion(Projector(camera), pose, model, region);
    const RenderedGradient gradient = PhotometricCamera(camera).gradient_at_sensor(
        scene_at(pose).markers.front(), 1.0, motion, Differences::central, 0.02);
    ASSERT_EQ(motion.columns(), 15);
    for (int column = 0; column < 15; ++column) {
        const double step = 0.1 / largest_motion(motion, column);
        const auto moved = [&](double by) {
            if (column >= 9) {
                Vector6d delta = Vector6d::Zero();
                delta[column - 9] = by;
                return rendered(camera, left_perturbed(pose, delta));
            }
            CameraModel other = camera;
            Eigen::VectorXd parameters = parameters_of(camera, model);
            parameters[column] += by;
            set_parameters(other, model, parameters);
            return rendered(other, pose);
        };
        const cv::Mat truth = (moved(step) - moved(-step)) / (2.0 * step);
        const bool as_a_whole = column == 2 || column == 3 || column == 12 || column == 13;
        EXPECT_LT(relative_error(derivative(gradient, motion, column), truth),
                  as_a_whole ? share : share_of_others)
            << "column " << column;
    }
}

// Measured: 0.4 % where the marker moves as a whole. Else the displacement is not constant over the
// blur's width b of some 0.6 px: it grows by 1/r per px by depth and tilt, by 7/r for k3, at radii
// r around 50 px: 2 % and 8 %.
TEST(RenderDerivatives, AreTheCentralDifferencesOfABlurredRendering) {
    expect_central_differences(distorted_camera(0.5), 0.015, 0.1);
}

// Box pixels without any lens: the derivative jumps where an edge leaves a pixel, and two finite
// differences of 0.1 px do not agree better than this.
TEST(RenderDerivatives, AreTheCentralDifferencesOfASharpRendering) {
    expect_central_differences(distorted_camera(0.0), 0.06, 0.12);
}

TEST(RenderDerivatives, KnowNothingBehindTheHorizonOfTheMarkersPlane) {
    const CameraModel camera = distorted_camera(0.0);
    // The plane falls away to the right and meets the optical axis: rays to its left miss it.
    const ImageMotion motion(Projector(camera), rigid_from_vector({0.0, 1.5, 0.0, 0.0, 0.0, 200.0}),
                             {}, cv::Rect(0, 0, camera.width, camera.height));
    int seen = 0, missed = 0;
    Eigen::Matrix2Xd moved(2, 6);
    for (int x = 0; x < camera.width; ++x)
        ++(motion.at(x, 90, moved) ? seen : missed);
    // The horizon is at tan(pi/2 - 1.5) = 0.0709 f = 21 px beside the centre.
    EXPECT_GT(seen, 90);
    EXPECT_GT(missed, 75);
}

}  // namespace
}  // namespace etalon
