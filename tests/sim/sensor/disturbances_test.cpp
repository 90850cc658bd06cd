#include "sim/sensor/disturbances.h"

#include <opencv2/imgproc.hpp>

#include "sim/render/motion_blur.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

CameraModel undistorted_camera() {
    return test::camera_with(96, 72, {110.0, 118.0, 46.0, 37.0}, {});
}

CameraModel distorted_camera() {
    return test::camera_with(96, 72, {110.0, 118.0, 46.0, 37.0},
                             {.k1 = -0.21, .k2 = 0.06, .p1 = 0.012});
}

// 45 x 33 mm with its origin away from the centre, 80 mm away: 62 x 49 px.
PlacedMarker checked_marker(const Eigen::Vector3d& rotation, const Eigen::Vector3d& translation) {
    return {{cv::Mat(3, 5, CV_32FC1, cv::Scalar(1.0f)), {-20.0, -18.0}, {9.0, 11.0}},
            {rotation_from_vector(rotation), translation}};
}
PlacedMarker frontal_marker() {
    return checked_marker({0.0, 0.0, 0.0}, {0.0, 0.0, 80.0});
}

Disturber disturber_of(const CameraModel& camera) {
    return Disturber(camera, SensorModel(camera));
}

Radiance even(double radiance, const CameraModel& camera = undistorted_camera()) {
    return Radiance(camera.height, camera.width, CV_32FC1, cv::Scalar(radiance));
}

// Values from 0 to 1, no two neighbours alike.
Radiance texture(const CameraModel& camera = undistorted_camera()) {
    Radiance image = even(0.0, camera);
    for (int y = 0; y < image.rows; ++y)
        for (int x = 0; x < image.cols; ++x)
            image.at<float>(y, x) =
                static_cast<float>(0.5 + 0.5 * std::sin(0.61 * x + 0.37 * y + 0.011 * x * y));
    return image;
}

Radiance disturbed(const Radiance& image, const Disturbances& disturbances,
                   const NoiseKey& key = {7, 5}, const CameraModel& camera = undistorted_camera()) {
    return disturber_of(camera).disturbed(image, frontal_marker(), disturbances, key);
}

bool same_bytes(const cv::Mat& a, const cv::Mat& b) {
    return a.size() == b.size() && a.type() == b.type() &&
           std::equal(a.datastart, a.dataend, b.datastart, b.dataend);
}

TEST(Disturbances, OfNoKindLeaveTheImageItself) {
    const Radiance image = texture();
    EXPECT_EQ(disturbed(image, {}).data, image.data);
    Disturbances only_after;  // JPEG comes after the sensor
    only_after.jpeg_quality = 40.0;
    EXPECT_EQ(disturbed(image, only_after).data, image.data);
    const CodeImage codes = SensorModel(undistorted_camera()).expose(image);
    EXPECT_EQ(compressed(codes, 0.0).pixels.data, codes.pixels.data);
}

TEST(Disturbances, DoNotTouchTheImageTheyAreGiven) {
    const Radiance image = texture();
    const Radiance before = image.clone();
    const Disturbances all{1.3, 0.6, 0.4, 0.3, 2.5, 3.0, 50.0};
    const Radiance after = disturbed(image, all);
    EXPECT_TRUE(same_bytes(image, before));
    EXPECT_FALSE(same_bytes(image, after));
}

TEST(Exposure, MultipliesTheLight) {
    const Radiance after = disturbed(texture(), {.exposure = 1.7});
    for (const auto& [x, y] : {std::pair{0, 0}, {11, 3}, {95, 71}})
        EXPECT_EQ(after.at<float>(y, x), static_cast<float>(1.7 * texture().at<float>(y, x)));
}

TEST(Contrast, PullsTheSceneToMidGray) {
    for (const auto& [before, after] : {std::pair{0.0, 0.35}, {0.5, 0.5}, {1.0, 0.65}, {0.2, 0.41}})
        EXPECT_FLOAT_EQ(disturbed(even(before), {.contrast = 0.3}).at<float>(13, 7),
                        static_cast<float>(after));
    EXPECT_EQ(cv::norm(disturbed(texture(), {.contrast = 0.0}), even(0.5), cv::NORM_INF), 0.0);
}

// The scene is faded before the light falls on it: 2 (0.5 + 0.4 (0.75 - 0.5)), not
// 0.5 + 0.4 (2 * 0.75 - 0.5).
TEST(Contrast, BelongsToTheSceneAndNotToItsLight) {
    const Radiance after = disturbed(even(0.75), {.exposure = 2.0, .contrast = 0.4});
    EXPECT_FLOAT_EQ(after.at<float>(3, 4), 1.2f);
}

// Of a plane two differences tell the gradient, and the outer corners are extrapolated from a
// pixel: 1 at the brightest, 1 - uneven at the darkest.
TEST(UnevenLight, FallsLinearlyFromCornerToCorner) {
    for (const std::uint32_t pose : {0u, 1u, 2u, 3u, 4u, 5u}) {
        const Radiance light = disturbed(even(1.0), {.uneven = 0.37}, {3, pose});
        const double at_0 = light.at<float>(0, 0);
        const Eigen::Vector2d slope((light.at<float>(0, 95) - at_0) / 95.0,
                                    (light.at<float>(71, 0) - at_0) / 71.0);
        const auto plane = [&](double x, double y) { return at_0 + slope.x() * x + slope.y() * y; };
        for (const auto& [x, y] : {std::pair{40, 50}, {13, 66}, {95, 71}})
            EXPECT_NEAR(light.at<float>(y, x), plane(x, y), 5e-7);
        const auto [least, most] = std::minmax(
            {plane(-0.5, -0.5), plane(95.5, -0.5), plane(-0.5, 71.5), plane(95.5, 71.5)});
        EXPECT_NEAR(most, 1.0, 1e-6);
        EXPECT_NEAR(least, 1.0 - 0.37, 1e-6);
        EXPECT_LT((-slope.normalized() - disturbance_directions({3, pose}).fall).norm(), 1e-4);
    }
}

// Means of N cosines and sines of uniform angles, or of the differences of independent ones, have
// the standard deviation 1 / sqrt(2 N): 5 of them, for the first two harmonics.
TEST(DisturbanceDirections, AreUniformAndIndependent) {
    constexpr int n = 4000;
    const double tolerance = 5.0 / std::sqrt(2.0 * n);
    using Directions = std::array<Eigen::Vector2d, 3>;
    const auto angle = [](const Eigen::Vector2d& v) { return std::atan2(v.y(), v.x()); };
    const auto expect_uniform = [&](auto angle_of) {
        for (const int harmonic : {1, 2}) {
            double cosine = 0.0, sine = 0.0;
            for (std::uint32_t pose = 0; pose < n; ++pose) {
                const auto d = disturbance_directions({11, pose});
                const double a = harmonic * angle_of(Directions{d.fall, d.card, d.motion});
                cosine += std::cos(a) / n;
                sine += std::sin(a) / n;
            }
            EXPECT_LT(std::abs(cosine), tolerance);
            EXPECT_LT(std::abs(sine), tolerance);
        }
    };
    for (const std::size_t i : {0u, 1u, 2u}) {
        expect_uniform([&](const Directions& d) { return angle(d[i]); });
        expect_uniform([&](const Directions& d) { return angle(d[i]) - angle(d[(i + 1) % 3]); });
    }
    EXPECT_NEAR(disturbance_directions({11, 3}).motion.norm(), 1.0, 1e-15);
}

// How far the ray of a pixel position meets the marker's plane in a direction of that plane, mm.
double along_plane(const Projector& projector, const PlacedMarker& marker,
                   const Eigen::Vector2d& direction, const Eigen::Vector2d& pixel) {
    const Rigid marker_from_camera = marker.camera_from_marker.inverse();
    const Eigen::Vector3d eye = marker_from_camera.translation;
    const Eigen::Vector3d ray =
        marker_from_camera.rotation * projector.unproject(pixel)->homogeneous();
    return (eye - eye.z() / ray.z() * ray).head<2>().dot(direction);
}

// By counting points of the marker: where its share towards the direction begins, mm.
double edge_by_counting(const PlacedMarker& marker, const Eigen::Vector2d& direction,
                        double share) {
    constexpr int n = 1000;
    std::vector<double> along;
    along.reserve(n * n);
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
            along.push_back(marker.grid.point_mm(5.0 * (i + 0.5) / n, 3.0 * (j + 0.5) / n)
                                .head<2>()
                                .dot(direction));
    const auto at = along.begin() + std::lround((1.0 - share) * n * n);
    std::nth_element(along.begin(), at, along.end());
    return *at;
}

// Proportion of n x n points of a pixel that see the card; all or none where its corners agree.
double counted_cover(const Projector& projector, const PlacedMarker& marker,
                     const Eigen::Vector2d& direction, double edge_mm, int x, int y) {
    const auto is_hidden = [&](double right, double down) {
        const Eigen::Vector2d pixel(x + right, y + down);
        return along_plane(projector, marker, direction, pixel) > edge_mm;
    };
    const int corners =
        is_hidden(-0.5, -0.5) + is_hidden(0.5, -0.5) + is_hidden(-0.5, 0.5) + is_hidden(0.5, 0.5);
    if (corners == 0 || corners == 4)
        return corners / 4.0;
    constexpr int n = 16;
    int hidden = 0;
    for (int k = 0; k < n * n; ++k)
        hidden += is_hidden((k % n + 0.5) / n - 0.5, (k / n + 0.5) / n - 0.5);
    return hidden / double(n * n);
}

struct Occluded {
    CameraModel camera;
    PlacedMarker marker;
    double share;
    NoiseKey key;
};

// Each pixel of the image. A straight line is counted wrong by at most 1/n of the pixel, and on
// average not at all: over the 50 or more pixels of the edge it is 1/n/sqrt(50) = 0.009 at the very
// most; half a pixel's shift would show as 0.25.
void expect_card_as_counted(const Occluded& scene) {
    const Radiance image = disturber_of(scene.camera)
                               .disturbed(even(0.0, scene.camera), scene.marker,
                                          {.occlusion = scene.share}, scene.key);
    const Projector projector(scene.camera);
    const Eigen::Vector2d direction = disturbance_directions(scene.key).card;
    const double edge_mm = edge_by_counting(scene.marker, direction, scene.share);
    double sum = 0.0;
    int on_edge = 0;
    for (int y = 0; y < image.rows; ++y)
        for (int x = 0; x < image.cols; ++x) {
            const double cover = 2.0 * image.at<float>(y, x);  // of mid gray on black
            const double counted = counted_cover(projector, scene.marker, direction, edge_mm, x, y);
            ASSERT_NEAR(cover, counted, 0.07) << x << ' ' << y;
            if (cover > 0.0 && cover < 1.0) {
                sum += cover - counted;
                ++on_edge;
            }
        }
    EXPECT_GT(on_edge, 10);
    EXPECT_LT(std::abs(sum / on_edge), 0.01);
}

TEST(Occlusion, HidesItsShareOfTheMarkersPlane) {
    const PlacedMarker tilted = checked_marker({0.7, -0.4, 0.3}, {2.0, -3.0, 90.0});
    const PlacedMarker steep = checked_marker({-0.2, 0.9, -1.1}, {-1.0, 4.0, 85.0});
    expect_card_as_counted({undistorted_camera(), frontal_marker(), 0.3, {1, 0}});
    expect_card_as_counted({undistorted_camera(), tilted, 0.03, {1, 1}});
    expect_card_as_counted({distorted_camera(), tilted, 0.55, {1, 2}});
    expect_card_as_counted({distorted_camera(), steep, 0.17, {1, 3}});
    expect_card_as_counted({distorted_camera(), steep, 0.9, {1, 4}});
}

TEST(Occlusion, HidesItsShareFromATelecentricCamera) {
    CameraModel camera = undistorted_camera();
    camera.projection.kind = Projection::telecentric;
    camera.intrinsics.fx = camera.intrinsics.fy = 1.6;  // px/mm
    const PlacedMarker marker = checked_marker({0.7, -0.4, 0.3}, {2.0, -3.0, 90.0});
    const Radiance image =
        disturber_of(camera).disturbed(even(0.0, camera), marker, {.occlusion = 0.23}, {1, 0});
    // Points of the marker by what their pixel shows: the pixel itself is evenly filled with them,
    // but for those on the outline, two of which the edge crosses, of 1600.
    const Projector projector(camera);
    double hidden = 0.0;
    constexpr int n = 500;
    for (int k = 0; k < n * n; ++k) {
        const Eigen::Vector2d at = *projector.project(
            marker.camera_from_marker *
            marker.grid.point_mm(5.0 * (k % n + 0.5) / n, 3.0 * (k / n + 0.5) / n));
        hidden += 2.0 * image.at<float>(static_cast<int>(std::lround(at.y())),
                                        static_cast<int>(std::lround(at.x())));
    }
    EXPECT_NEAR(hidden / (n * n), 0.23, 2.0 / 1600.0);
}

TEST(Occlusion, CanHideAllOfTheMarker) {
    const PlacedMarker marker = frontal_marker();
    const Radiance image =
        disturber_of(undistorted_camera()).disturbed(texture(), marker, {.occlusion = 1.0}, {2, 9});
    const Projector projector(undistorted_camera());
    for (const auto& [u, v] :
         {std::pair{0.1, 0.1}, {4.9, 0.1}, {0.1, 2.9}, {4.9, 2.9}, {2.0, 1.5}}) {
        const auto at = projector.project(marker.camera_from_marker * marker.grid.point_mm(u, v));
        EXPECT_EQ(image.at<float>(static_cast<int>(std::lround(at->y())),
                                  static_cast<int>(std::lround(at->x()))),
                  0.5f);
    }
}

// The card is at rest and of mid gray, whatever fades and moves; the light falls on it, too.
TEST(Occlusion, IsNeitherMovedNorFaded) {
    const Radiance still = disturbed(even(0.8), {.occlusion = 0.4});
    EXPECT_TRUE(same_bytes(still, disturbed(even(0.8), {.occlusion = 0.4, .motion_px = 6.0})));
    const Radiance faded = disturbed(even(0.8), {.contrast = 0.2, .occlusion = 0.4});
    const Radiance lit = disturbed(even(0.8), {.exposure = 0.6, .occlusion = 0.4});
    const cv::Mat card = still == 0.5f;
    EXPECT_GT(cv::countNonZero(card), 500);
    EXPECT_EQ(cv::countNonZero((faded == 0.5f) != card), 0);
    EXPECT_NEAR(cv::mean(lit, card)[0], 0.3, 1e-6);
}

// The model's fold is at r^2 = 1 / (3 * 0.35), its image 0.65 f = 20 px from the centre.
TEST(Occlusion, LeavesPixelsWithoutARayAlone) {
    CameraModel camera = undistorted_camera();
    camera.intrinsics = {30.0, 30.0, 46.0, 37.0};
    camera.distortion.k1 = -0.35;
    const Radiance before = texture(camera);
    const Radiance after = disturbed(before, {.occlusion = 1.0}, {4, 4}, camera);
    const Projector projector(camera);
    int card = 0;
    for (int y = 0; y < 72; ++y)
        for (int x = 0; x < 96; ++x)
            if (projector.unproject(Eigen::Vector2d(x, y)))
                card += after.at<float>(y, x) == 0.5f;
            else
                EXPECT_EQ(after.at<float>(y, x), before.at<float>(y, x));
    EXPECT_GT(card, 300);
}

// What a point becomes: the line's mass, centre and covariance m m^T / 12, px^2.
void expect_line(const Radiance& image, const Eigen::Vector2d& point, const Eigen::Vector2d& motion,
                 double tolerance) {
    const cv::Moments m = cv::moments(image);
    Eigen::Matrix2d second;
    second << m.mu20, m.mu11, m.mu11, m.mu02;
    EXPECT_NEAR(m.m00, 1.0, 1e-6);
    EXPECT_LT((Eigen::Vector2d(m.m10, m.m01) / m.m00 - point).norm(), 1e-5);
    EXPECT_LT((second - motion * motion.transpose() / 12.0).norm(), tolerance) << motion;
}

TEST(MotionBlur, HasTheLengthAskedForInTheDirectionOfItsKey) {
    for (const std::uint32_t pose : {0u, 1u, 2u}) {
        Radiance impulse = even(0.0);
        impulse.at<float>(40, 50) = 1.0f;
        const Radiance after = disturbed(impulse, {.motion_px = 7.3}, {9, pose});
        expect_line(after, {50, 40}, 7.3 * disturbance_directions({9, pose}).motion, 1e-3);
    }
}

// 16 bits, black 500 DN, response down to 0.58 at the corners.
CameraModel noisy_camera() {
    CameraModel camera =
        test::camera_with(320, 200, {300.0, 300.0, 150.0, 110.0}, {},
                          Sensor{.bits = 16, .black_dn = 500.0, .gain_e_per_dn = 4.0});
    camera.sensor->illumination = {Illumination::Kind::polynomial, {-0.4, 0.0, 0.0}};
    return camera;
}

// What noise adds to the codes of an image of radiance 0.4, row by row.
std::vector<double> noise_codes(const CameraModel& camera, double noise_dn, const NoiseKey& key,
                                std::optional<NoiseKey> sensor_key = {}) {
    const SensorModel sensor(camera);
    const Radiance clean = even(0.4, camera);
    const Radiance noisy =
        disturber_of(camera).disturbed(clean, frontal_marker(), {.noise_dn = noise_dn}, key);
    cv::Mat difference;
    cv::subtract(sensor.expose(noisy, sensor_key).pixels, sensor.expose(clean).pixels, difference,
                 cv::noArray(), CV_64F);
    return {difference.begin<double>(), difference.end<double>()};
}

double mean_power(const std::vector<double>& values, int power) {
    double sum = 0.0;
    for (const double value : values)
        sum += std::pow(value, power);
    return sum / double(values.size());
}

double correlation(const std::vector<double>& a, const std::vector<double>& b, std::size_t lag) {
    double sum = 0.0;
    for (std::size_t i = lag; i < a.size(); ++i)
        sum += a[i] * b[i - lag];
    return sum / double(a.size() - lag) / std::sqrt(mean_power(a, 2) * mean_power(b, 2));
}

// N = 64 000 pixels of 200 DN: the mean's standard deviation is 200 / sqrt(N) = 0.79, the standard
// deviation's 200 / sqrt(2 N) = 0.56, the kurtosis' sqrt(24 / N) = 0.02; 5 of each. Rounding adds
// twice 1/12 DN^2: 0.0004 DN.
TEST(AddedNoise, HasItsDeviationInLinearCodesWhateverTheResponse) {
    const CameraModel camera = noisy_camera();
    const auto noise = noise_codes(camera, 200.0, {17, 3});
    const double n = double(noise.size());
    EXPECT_NEAR(mean_power(noise, 1), 0.0, 5.0 * 200.0 / std::sqrt(n));
    const double variance = mean_power(noise, 2);
    EXPECT_NEAR(std::sqrt(variance), 200.0, 5.0 * 200.0 / std::sqrt(2.0 * n));
    EXPECT_NEAR(mean_power(noise, 4) / (variance * variance), 3.0, 5.0 * std::sqrt(24.0 / n));
    // A sixteenth of the image where the response is lowest: 80 x 50 pixels.
    std::vector<double> corner;
    for (std::size_t y = 150; y < 200; ++y)
        corner.insert(corner.end(), noise.begin() + std::ptrdiff_t(y * 320 + 240),
                      noise.begin() + std::ptrdiff_t((y + 1) * 320));
    EXPECT_NEAR(std::sqrt(mean_power(corner, 2)), 200.0, 5.0 * 200.0 / std::sqrt(8000.0));
}

// A correlation's standard deviation is 1 / sqrt(N).
TEST(AddedNoise, IsIndependentBetweenPixelsPosesSeedsAndOfTheSensors) {
    const CameraModel camera = noisy_camera();
    const auto noise = noise_codes(camera, 200.0, {17, 3});
    const double tolerance = 5.0 / std::sqrt(double(noise.size()));
    for (const std::size_t lag : {1u, 2u, 3u, 319u, 320u, 321u})
        EXPECT_LT(std::abs(correlation(noise, noise, lag)), tolerance) << lag;
    for (const NoiseKey& other : {NoiseKey{17, 4}, NoiseKey{18, 3}})
        EXPECT_LT(std::abs(correlation(noise, noise_codes(camera, 200.0, other), 0)), tolerance);
    const auto of_sensor = noise_codes(camera, 0.0, {17, 3}, NoiseKey{17, 3});
    EXPECT_GT(mean_power(of_sensor, 2), 1000.0);
    EXPECT_LT(std::abs(correlation(noise, of_sensor, 0)), tolerance);
    // Were the generator's streams the same, row y would begin like pixel y.
    std::vector<double> row_begins;
    for (std::size_t y = 0; y < 200; ++y)
        row_begins.push_back(noise[320 * y]);
    const std::vector<double> first_pixels(of_sensor.begin(), of_sensor.begin() + 200);
    EXPECT_LT(std::abs(correlation(row_begins, first_pixels, 0)), 5.0 / std::sqrt(200.0));
    // Independent noises: the variances add up. 64 000 pixels: 0.56 % of the variance; 5 of them.
    const double sum = mean_power(noise_codes(camera, 200.0, {17, 3}, NoiseKey{17, 3}), 2);
    EXPECT_NEAR(sum / (mean_power(noise, 2) + mean_power(of_sensor, 2)), 1.0, 0.028);
}

TEST(AddedNoise, DoesNotDependOnTheOtherDisturbances) {
    const cv::Mat alone = disturbed(even(0.4), {.noise_dn = 9.0}) - even(0.4);
    Disturbances others{1.3, 0.6, 0.4, 0.3, 2.5, 0.0, 0.0};
    const Radiance quiet = disturbed(texture(), others);
    others.noise_dn = 9.0;
    EXPECT_LT(cv::norm(disturbed(texture(), others) - quiet, alone, cv::NORM_INF), 3e-7);
}

TEST(Disturber, GivesTheSameBytesInAnyOrderOnAnyThread) {
    const Disturber disturber = disturber_of(distorted_camera());
    const Disturbances all{1.3, 0.6, 0.4, 0.3, 2.5, 3.0, 0.0};
    constexpr std::uint32_t poses = 12;
    const auto pose_image = [&](std::uint32_t pose) {
        return disturber.disturbed(texture(), frontal_marker(), all, {21, pose});
    };
    std::vector<Radiance> forward, threaded(poses);
    for (std::uint32_t pose = 0; pose < poses; ++pose)
        forward.push_back(pose_image(pose));
    std::vector<std::thread> threads;
    for (std::uint32_t first = 0; first < 3; ++first)
        threads.emplace_back([&, first] {
            for (std::uint32_t pose = poses - 1 - first; pose < poses; pose -= 3)  // wraps below 0
                threaded[pose] = pose_image(pose);
        });
    for (std::thread& thread : threads)
        thread.join();
    for (std::uint32_t pose = 0; pose < poses; ++pose)
        EXPECT_TRUE(same_bytes(forward[pose], threaded[pose])) << pose;
    EXPECT_FALSE(same_bytes(forward[0], forward[1]));
}

double rms(const CodeImage& a, const CodeImage& b) {
    return cv::norm(a.pixels, b.pixels, cv::NORM_L2) / std::sqrt(double(a.pixels.total()));
}

// At 100 all quantisation steps are 1. The transform is orthonormal: pixels get an error of
// variance 1/12, which rounding them turns into 1 where it is over 1/2: 8.3 % of a normal
// distribution. With 6912 pixels the RMS of 0.289 has the standard deviation 0.006; 5 of them. A
// second time there is less to round.
TEST(Jpeg, OnlyRoundsAtQuality100) {
    const CodeImage image = SensorModel(undistorted_camera()).expose(texture());
    const CodeImage once = compressed(image, 100.0), twice = compressed(once, 100.0);
    EXPECT_NEAR(rms(once, image), std::sqrt(0.083), 0.03);
    EXPECT_LT(rms(twice, once), 0.8 * rms(once, image));
    const CodeImage flat{cv::Mat(17, 23, CV_8UC1, cv::Scalar(93)), 8};
    EXPECT_TRUE(same_bytes(compressed(flat, 100.0).pixels, flat.pixels));
}

TEST(Jpeg, LosesMoreTheLowerItsQuality) {
    const CodeImage image = SensorModel(undistorted_camera()).expose(texture());
    double before = 0.0;
    for (const double quality : {100.0, 90.0, 75.0, 50.0, 25.0, 10.0, 1.0}) {
        const CodeImage after = compressed(image, quality);
        EXPECT_EQ(after.bits, 8);
        EXPECT_EQ(after.pixels.size(), image.pixels.size());
        EXPECT_GT(rms(after, image), before) << quality;
        before = rms(after, image);
    }
    EXPECT_TRUE(same_bytes(compressed(image, 49.6).pixels, compressed(image, 50.4).pixels));
}

TEST(Jpeg, RefusesWhatItCannotHold) {
    EXPECT_THROW(compressed({cv::Mat(5, 7, CV_16UC1, cv::Scalar(9)), 12}, 80.0), NumericalError);
    EXPECT_THROW(compressed({cv::Mat(5, 7, CV_8UC1, cv::Scalar(9)), 6}, 80.0), NumericalError);
    EXPECT_THROW(compressed({cv::Mat(), 8}, 80.0), NumericalError);
    const CodeImage image{cv::Mat(5, 7, CV_8UC1, cv::Scalar(9)), 8};
    for (const double quality : {0.4, -1.0, 101.0, std::nan("")})
        EXPECT_THROW(compressed(image, quality), NumericalError) << quality;
}

TEST(DisturbanceAxes, ReachEveryMemberByItsName) {
    const Disturbances d{2, 3, 5, 7, 11, 13, 17};
    std::vector<std::pair<std::string, double>> found;
    for (const DisturbanceAxis& axis : disturbance_axes) {
        found.emplace_back(axis.name, d.*axis.value);
        EXPECT_TRUE(axis.is_valid(axis.neutral()));
        EXPECT_TRUE(axis.is_valid(axis.least) && axis.is_valid(axis.most));
        EXPECT_FALSE(axis.is_valid(std::nan("")));
    }
    EXPECT_THAT(found, ElementsAre(testing::Pair("exposure", 2.0), testing::Pair("contrast", 3.0),
                                   testing::Pair("uneven", 5.0), testing::Pair("occlusion", 7.0),
                                   testing::Pair("motion-px", 11.0),
                                   testing::Pair("noise-dn", 13.0), testing::Pair("jpeg", 17.0)));
    static_assert(sizeof(Disturbances) == disturbance_axes.size() * sizeof(double));
}

TEST(Disturbances, OutOfTheirRangeAreRefusedByName) {
    const double infinity = std::numeric_limits<double>::infinity();
    for (const DisturbanceAxis& axis : disturbance_axes)
        for (const double value : {-0.1, 2.0 * axis.most, infinity, -infinity, std::nan("")}) {
            Disturbances wrong;
            wrong.*axis.value = value;
            EXPECT_THAT(text_of_error<NumericalError>([&] { disturbed(even(0.3), wrong); }),
                        HasSubstr(axis.name))
                << value;
        }
}

TEST(Disturber, RefusesImagesThatAreNotTheCameras) {
    EXPECT_THROW(disturbed(Radiance(), {}), NumericalError);
    EXPECT_THROW(disturbed(Radiance(96, 72, CV_32FC1), {.exposure = 2.0}), NumericalError);
    EXPECT_THROW(disturbed(cv::Mat(72, 96, CV_8UC1), {.exposure = 2.0}), NumericalError);
    Radiance image = texture();
    image.at<float>(31, 7) = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THAT(text_of_error<NumericalError>([&] { disturbed(image, {.exposure = 2.0}); }),
                HasSubstr("row 31"));
    EXPECT_THAT(text_of_error<NumericalError>([&] { disturbed(even(3e38), {.exposure = 50.0}); }),
                HasSubstr("finite"));
}

const Eigen::Vector2d motions[] = {{0.3, -0.2}, {0.9, 0.1}, {3.7, -2.2},
                                   {-1.5, 9.4}, {5.0, 0.0}, {0.0, -4.0}};

// Whatever its length and direction.
TEST(LineBlur, HasTheMomentsOfTheLine) {
    for (const Eigen::Vector2d& motion : motions) {
        Radiance impulse = Radiance::zeros(35, 41, CV_32FC1);
        impulse.at<float>(17, 20) = 1.0f;
        expect_line(line_blurred(impulse, motion), {20, 17}, motion, 3e-5);
    }
}

// An edge of Gaussian blur sigma that moves by L along its normal: the mean of the normal
// distribution function over L, which is a ramp of that length with its corners rounded.
TEST(LineBlur, MakesARampOfItsLengthOfAnEdge) {
    constexpr double sigma = 1.1;
    const Eigen::Vector2d normal(std::cos(0.7), std::sin(0.7)), on_edge(22.3, 16.8);
    Radiance edge(33, 45, CV_32FC1);
    const auto distance = [&](int x, int y) {
        return normal.dot(Eigen::Vector2d(x, y) - on_edge) / sigma;
    };
    for (int y = 0; y < 33; ++y)
        for (int x = 0; x < 45; ++x)
            edge.at<float>(y, x) =
                static_cast<float>(0.5 * std::erfc(-distance(x, y) / std::numbers::sqrt2));
    for (const Eigen::Vector2d& motion : motions) {
        const Radiance blurred = line_blurred(edge, motion);
        const double half = 0.5 * std::abs(normal.dot(motion)) / sigma;
        double largest = 0.0;
        for (int y = 8; y < 25; ++y)
            for (int x = 6; x < 39; ++x) {
                const double truth =
                    (swept_normal(distance(x, y) + half) - swept_normal(distance(x, y) - half)) /
                    (2.0 * half);
                largest = std::max(largest, std::abs(blurred.at<float>(y, x) - truth));
            }
        EXPECT_LT(largest, 2e-3) << motion;
    }
}

CameraModel camera_of(bool with_lens) {
    const Intrinsics intrinsics{400.0, 400.0, 31.0, 22.0};
    return with_lens ? test::camera_with(64, 48, intrinsics, {}, Sensor{.pixel_pitch_um = 2.8},
                                         Lens{8.0, 250.0, 600.0, {}})
                     : test::camera_with(64, 48, intrinsics, {});
}

// 4 x 3 cells of 5 px and more.
Scene frontal_scene() {
    return {{twelve_cells({4.0, 3.5}, {-8.0, -5.0},
                          {rotation_from_vector({0.0, 0.0, 0.2}), {0.4, -0.3, 250.0}})}};
}

// Against renders along the way, to which nothing between the pixels is unknown. Largest and RMS
// difference, of the contrast 1.
struct Difference {
    double largest, rms;
};
Difference from_moving_renders(const CameraModel& camera, const Eigen::Vector2d& motion) {
    const Renderer renderer(camera);
    MotionDuringExposure in_front{Vector6d::Zero(), 1.0};
    in_front.velocity.segment<2>(3) = motion * 250.0 / 400.0;
    const Radiance truth = render_moving(renderer, frontal_scene(), in_front).image.radiance;
    const Radiance blurred = line_blurred(renderer.render(frontal_scene()).radiance, motion);
    return {cv::norm(blurred, truth, cv::NORM_INF),
            cv::norm(blurred, truth, cv::NORM_L2) / std::sqrt(double(truth.total()))};
}

TEST(LineBlur, IsCloseToAMovingRender) {
    for (const Eigen::Vector2d& motion : motions) {
        const auto sharp = from_moving_renders(camera_of(false), motion);
        EXPECT_LT(sharp.largest, 0.07) << motion;
        EXPECT_LT(sharp.rms, 0.009) << motion;
        const auto with_lens = from_moving_renders(camera_of(true), motion);
        EXPECT_LT(with_lens.largest, 0.01) << motion;
        EXPECT_LT(with_lens.rms, 0.0012) << motion;
    }
}

TEST(LineBlur, LeavesWhatIsEvenToTheLastBit) {
    Radiance image(48, 64, CV_32FC1, cv::Scalar(0.1f));
    EXPECT_EQ(cv::norm(line_blurred(image, {3.7, -2.2}), image, cv::NORM_INF), 0.0);
    image(cv::Rect(30, 20, 6, 5)).setTo(0.7f);
    const Radiance blurred = line_blurred(image, {3.7, -2.2});
    // 2 px and 2 of the interpolation along x; along y 1.1 px and 2.
    const cv::Rect touched(26, 16, 14, 13);
    cv::Mat differs = blurred != image;
    EXPECT_GT(cv::countNonZero(differs), 20);
    differs(touched).setTo(0);
    EXPECT_EQ(cv::countNonZero(differs), 0);
    EXPECT_EQ(line_blurred(image, {0.0, 0.0}).data, image.data);
}

TEST(LineBlur, GoesOnBeyondTheBorderAsAtTheBorder) {
    Radiance image(21, 30, CV_32FC1);
    for (int y = 0; y < 21; ++y)
        for (int x = 0; x < 30; ++x)
            image.at<float>(y, x) =
                static_cast<float>(0.5 + 0.3 * std::sin(0.9 * x + 0.05 * y * y));
    Radiance wide;
    cv::copyMakeBorder(image, wide, 20, 20, 20, 20, cv::BORDER_REPLICATE);
    const Radiance expected = line_blurred(wide, {7.3, -4.1})(cv::Rect(20, 20, 30, 21));
    EXPECT_EQ(cv::norm(line_blurred(image, {7.3, -4.1}), expected, cv::NORM_INF), 0.0);
    // A part of a larger image ends where it ends, too.
    Radiance canvas(40, 60, CV_32FC1, cv::Scalar(0.9f));
    image.copyTo(canvas(cv::Rect(9, 13, 30, 21)));
    const Radiance part = line_blurred(canvas(cv::Rect(9, 13, 30, 21)), {7.3, -4.1});
    EXPECT_EQ(cv::norm(part, expected, cv::NORM_INF), 0.0);
}

}  // namespace
}  // namespace etalon
