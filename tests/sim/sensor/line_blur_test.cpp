#include "sim/sensor/disturbances.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "sim/render/motion_blur.h"

namespace etalon {
namespace {

const Eigen::Vector2d motions[] = {{0.3, -0.2}, {0.9, 0.1}, {3.7, -2.2},
                                   {-1.5, 9.4}, {5.0, 0.0}, {0.0, -4.0}};

// A line's mass, centre and covariance m m^T / 12, whatever its length and direction.
TEST(LineBlur, HasTheMomentsOfTheLine) {
    for (const Eigen::Vector2d& motion : motions) {
        Radiance impulse = Radiance::zeros(35, 41, CV_32FC1);
        impulse.at<float>(17, 20) = 1.0f;
        const Radiance blurred = line_blurred(impulse, motion);
        double sum = 0.0;
        Eigen::Vector2d mean = Eigen::Vector2d::Zero();
        Eigen::Matrix2d second = Eigen::Matrix2d::Zero();
        for (int y = 0; y < 35; ++y)
            for (int x = 0; x < 41; ++x) {
                const Eigen::Vector2d from_centre(x - 20, y - 17);
                const double value = blurred.at<float>(y, x);
                sum += value;
                mean += value * from_centre;
                second += value * from_centre * from_centre.transpose();
            }
        EXPECT_NEAR(sum, 1.0, 1e-6);
        EXPECT_LT(mean.norm(), 1e-5);
        EXPECT_LT((second - motion * motion.transpose() / 12.0).norm(), 3e-5) << motion;
    }
}

// Integral of the normal distribution function from minus infinity.
double swept_normal(double z) {
    const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
    return z * 0.5 * std::erfc(-z / std::numbers::sqrt2) + density;
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
    CameraModel camera;
    camera.width = 64;
    camera.height = 48;
    camera.intrinsics = {400.0, 400.0, 31.0, 22.0};
    if (with_lens) {
        camera.sensor = Sensor{.pixel_pitch_um = 2.8};
        camera.lens = Lens{.f_number = 8.0, .focus_distance_mm = 250.0, .wavelength_nm = 600.0};
    }
    return camera;
}

// 4 x 3 cells of 5 px and more.
Scene frontal_scene() {
    Scene scene{{PlacedMarker{}}};
    scene.markers[0].grid.cells =
        (cv::Mat_<float>(3, 4) << 0, 0.8, 0.2, 1, 1, 0, 0.6, 0, 0.3, 1, 0, 0.9);
    scene.markers[0].grid.cell_mm = {4.0, 3.5};
    scene.markers[0].grid.corner_mm = {-8.0, -5.0};
    scene.markers[0].camera_from_marker.rotation = rotation_from_vector({0.0, 0.0, 0.2});
    scene.markers[0].camera_from_marker.translation = {0.4, -0.3, 250.0};
    return scene;
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
