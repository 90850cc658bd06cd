#include "calib/camera/projector.h"

#include <opencv2/calib3d.hpp>

#include "tests/calib/cameras.h"
#include "tests/calib/lens_tables.h"
#include "tests/test.h"

namespace etalon {
namespace {

using test::camera_with;
using test::Complex, test::ComplexPoint, test::ComplexRay;

Eigen::Vector2d opencv_projection(const CameraModel& camera, const Eigen::Vector3d& p) {
    const Intrinsics& i = camera.intrinsics;
    const cv::Matx33d k(i.fx, 0, i.cx, 0, i.fy, i.cy, 0, 0, 1);
    const auto c = camera.distortion.in_opencv_order();
    const std::vector<cv::Point3d> points{{p.x(), p.y(), p.z()}};
    std::vector<cv::Point2d> pixels;
    cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), k, std::vector<double>(c.begin(), c.end()),
                      pixels);
    return {pixels[0].x, pixels[0].y};
}

CameraModel centred(const Distortion& distortion) {
    return camera_with(640, 480, {500, 500, 320, 240}, distortion);
}

// The documented formulas once more, for complex numbers.
ComplexPoint complex_projection(const CameraModel& camera, const ComplexRay& p) {
    const Distortion& d = camera.distortion;
    const Complex x = p[0] / p[2], y = p[1] / p[2], r2 = x * x + y * y;
    const Complex radial = (1.0 + d.k1 * r2 + d.k2 * r2 * r2 + d.k3 * r2 * r2 * r2) /
                           (1.0 + d.k4 * r2 + d.k5 * r2 * r2 + d.k6 * r2 * r2 * r2);
    const Complex xd =
        x * radial + 2.0 * d.p1 * x * y + d.p2 * (r2 + 2.0 * x * x) + d.s1 * r2 + d.s2 * r2 * r2;
    const Complex yd =
        y * radial + d.p1 * (r2 + 2.0 * y * y) + 2.0 * d.p2 * x * y + d.s3 * r2 + d.s4 * r2 * r2;
    const double cx = std::cos(d.tau_x), sx = std::sin(d.tau_x);
    const double cy = std::cos(d.tau_y), sy = std::sin(d.tau_y);
    // Rows of Ry(tau_y) Rx(tau_x), then the projection onto the tilted sensor.
    const Complex rx = cy * xd + sy * sx * yd - sy * cx;
    const Complex ry = cx * yd + sx;
    const Complex rz = sy * xd - cy * sx * yd + cy * cx;
    const Complex u = (cy * cx * rx + sy * cx * rz) / rz;
    const Complex v = (cy * cx * ry - sx * rz) / rz;
    const Intrinsics& i = camera.intrinsics;
    return {i.fx * u + i.skew * v + i.cx, i.fy * v + i.cy};
}

const std::vector<Eigen::Vector3d> points{
    {0, 0, 500}, {110, -70, 500}, {-90, 130, 730}, {210, 170, 900}, {-7, -5, 40}};

TEST(Projector, AgreesWithOpenCvForEveryCoefficient) {
    for (const CameraModel& camera :
         {test::webcam(), test::canon(), test::all_fourteen(), test::wide_angle()}) {
        const Projector projector(camera);
        for (const Eigen::Vector3d& p : points) {
            const auto pixel = projector.project(p);
            ASSERT_TRUE(pixel) << p.transpose();
            EXPECT_LT((*pixel - opencv_projection(camera, p)).norm(), 1e-9) << p.transpose();
        }
    }
}

CameraModel skewed() {
    CameraModel camera = test::all_fourteen();
    camera.intrinsics.skew = -23.7;
    return camera;
}

TEST(Projector, PutsTheSkewAfterTheDistortion) {
    const Projector projector(skewed());
    for (const Eigen::Vector3d& p : points) {
        const auto expected = complex_projection(skewed(), p.cast<Complex>());
        const auto pixel = projector.project(p);
        ASSERT_TRUE(pixel);
        EXPECT_NEAR(pixel->x(), expected[0].real(), 1e-11);
        EXPECT_NEAR(pixel->y(), expected[1].real(), 1e-11);
        const Eigen::Vector2d x = p.hnormalized();
        const Eigen::Vector2d step(1e-6, -2e-6);
        EXPECT_LT((projector.pixel_by_normalised(x) * 2.0 * step -
                   (*projector.project((x + step).homogeneous()) -
                    *projector.project((x - step).homogeneous())))
                      .norm(),
                  1e-11);
    }
}

TEST(Projector, JacobianIsTheComplexStepDerivative) {
    for (const CameraModel& camera :
         {test::webcam(), test::canon(), test::all_fourteen(), test::wide_angle(), skewed()}) {
        const Projector projector(camera);
        for (const Eigen::Vector3d& p : points) {
            const auto projected = projector.project_with_jacobian(p);
            ASSERT_TRUE(projected);
            const Eigen::MatrixXd expected = test::complex_step(
                [&](const ComplexRay& at) { return complex_projection(camera, at); }, p);
            EXPECT_LT((projected->jacobian - expected).norm(), 1e-12 * expected.norm())
                << projected->jacobian << "\n"
                << expected;
        }
    }
}

// Distorts every k-th pixel's ray again; the pixel must come back to 1e-8 px.
void expect_round_trip(const CameraModel& camera, int step) {
    const Projector projector(camera);
    for (int y = 0; y < camera.height; y += step)
        for (int x = 0; x < camera.width; x += step) {
            const Eigen::Vector2d pixel(x, y);
            const auto ray = projector.unproject(pixel);
            ASSERT_TRUE(ray) << x << " " << y;
            const auto back = projector.project(ray->homogeneous());
            ASSERT_TRUE(back) << x << " " << y;
            ASSERT_LT((*back - pixel).norm(), 1e-8) << x << " " << y;
        }
}

TEST(Projector, EveryPixelOfTheNamedCamerasSurvivesTheRoundTrip) {
    expect_round_trip(test::webcam(), 3);
    expect_round_trip(test::canon(), 17);
    expect_round_trip(test::all_fourteen(), 3);
    expect_round_trip(skewed(), 3);
    expect_round_trip(test::wide_angle(), 7);
}

TEST(Projector, WorksFromFivePixelsToHalfAMillionPixelsOfFocalLength) {
    expect_round_trip(camera_with(640, 480, {5, 7, 319.5, 239.5}, {.k1 = 0.01, .k4 = 0.02}), 7);
    expect_round_trip(camera_with(640, 480, {5e5, 4e5, 319.5, 239.5}, {.k1 = -1e5, .p1 = 7.0}), 7);
}

TEST(Projector, InvertsAStronglyTiltedSensor) {
    expect_round_trip(camera_with(640, 480, {800, 790, 320, 240}, {.k1 = -0.1, .tau_x = 0.5}), 7);
    expect_round_trip(camera_with(640, 480, {800, 790, 320, 240}, {.tau_x = -0.3, .tau_y = 0.7}),
                      7);
}

// r - 0.4 r^3 rises up to r = sqrt(1 / 1.2) and returns to every radius beyond: a second ray for
// the same pixel.
TEST(Projector, GivesNothingBeyondTheFoldOfABarrel) {
    const CameraModel barrel = centred({.k1 = -0.4});
    const Projector projector(barrel);
    const double fold = std::sqrt(1.0 / 1.2);
    EXPECT_NEAR(projector.valid_region().border({7, -5}), fold, 1e-12);
    const Eigen::Vector2d direction = Eigen::Vector2d(7, -5).normalized();
    EXPECT_TRUE(projector.is_valid(0.999 * fold * direction));
    EXPECT_FALSE(projector.is_valid(1.001 * fold * direction));
    EXPECT_FALSE(projector.project((1.3 * fold * direction).homogeneous()));
    const double reach = 500 * (fold - 0.4 * fold * fold * fold);
    EXPECT_TRUE(projector.unproject(Eigen::Vector2d(320, 240) + 0.9999 * reach * direction));
    EXPECT_FALSE(projector.unproject(Eigen::Vector2d(320, 240) + 1.0001 * reach * direction));
}

TEST(Projector, StopsBeforeAPoleOfTheRationalModel) {
    const Projector projector(centred({.k4 = -0.25}));
    EXPECT_NEAR(projector.valid_region().border({3, 4}), 2.0, 1e-12);
    EXPECT_TRUE(projector.project({1.99, 0, 1}));
    EXPECT_FALSE(projector.project({2.01, 0, 1}));
}

// 1 - 2 s + s^2 (s = r^2) touches zero at s = 1 without changing sign.
TEST(Projector, StopsBeforeAPoleThatChangesNoSign) {
    const Projector projector(centred({.k4 = -2, .k5 = 1}));
    EXPECT_TRUE(projector.project({0.7, 0.7, 1}));
    EXPECT_FALSE(projector.project({0.75, 0.75, 1}));
}

// The derivative 1 - 3 a s + 5 b s^2 of r - a r^3 + b r^5 dips below zero only between
// s = 0.99 and 1.01 (r in [0.99499, 1.00499]): less than a step of the search.
TEST(Projector, FindsAFoldThatUnfoldsAgain) {
    const double product = 0.99 * 1.01, sum = 2.0;
    const double b = 1.0 / (5.0 * product), a = sum / (3.0 * product);
    const Projector projector(centred({.k1 = -a, .k2 = b}));
    EXPECT_NEAR(projector.valid_region().border({1, 0}), std::sqrt(0.99), 1e-9);
    EXPECT_FALSE(projector.project({1.5, 0, 1}));
}

TEST(Projector, HasNoBorderWhereTheModelNeverFolds) {
    const double infinity = std::numeric_limits<double>::infinity();
    for (const Distortion& distortion :
         {Distortion{}, Distortion{.k1 = 0.2}, Distortion{.k1 = -0.1, .k2 = 0.3}})
        EXPECT_EQ(Projector(centred(distortion)).valid_region().border({7, 5}), infinity);
}

TEST(Projector, BorderOfAnAsymmetricModelIsWhereTheJacobianVanishes) {
    const CameraModel camera = centred({.k1 = -0.3, .p1 = 0.03, .p2 = -0.02});
    const Projector projector(camera);
    for (int i = 0; i < 97; ++i) {
        const double angle = 2 * 3.14159265358979 * i / 97;
        const Eigen::Vector2d direction(std::cos(angle), std::sin(angle));
        const double border = projector.valid_region().border(direction);
        EXPECT_GT(distort(camera.distortion, 0.999 * border * direction).jacobian.determinant(), 0);
        EXPECT_LT(distort(camera.distortion, 1.001 * border * direction).jacobian.determinant(), 0);
    }
}

TEST(Projector, GivesNothingBehindTheCameraAndForWhatIsNoNumber) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const double infinity = std::numeric_limits<double>::infinity();
    for (const CameraModel& camera :
         {test::webcam(), test::all_fourteen(), camera_with(8, 8, {5, 7, 3, 2}, {})}) {
        const Projector projector(camera);
        EXPECT_FALSE(projector.project({7, 5, 0}));
        EXPECT_FALSE(projector.project({7, 5, -500}));
        EXPECT_FALSE(projector.project({nan, 5, 500}));
        EXPECT_FALSE(projector.project({7, nan, 500}));
        EXPECT_FALSE(projector.project({7, 5, nan}));
        EXPECT_FALSE(projector.project({infinity, 5, 500}));
        EXPECT_FALSE(projector.project({7, 5, 1e-320}));
        EXPECT_FALSE(projector.unproject({nan, 5}));
        EXPECT_FALSE(projector.unproject({7, infinity}));
        EXPECT_FALSE(projector.is_valid({nan, 0}));
    }
}

TEST(Projector, RefusesCamerasThatCannotExist) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(Projector(camera_with(640, 480, {0, 500, 320, 240}, {})), NumericalError);
    EXPECT_THROW(Projector(camera_with(640, 480, {500, -1, 320, 240}, {})), NumericalError);
    EXPECT_THROW(Projector(camera_with(640, 480, {500, 500, nan, 240}, {})), NumericalError);
    EXPECT_THROW(Projector(camera_with(640, 480, {500, 500, 320, 240, nan}, {})), NumericalError);
    EXPECT_THROW(Projector(centred({.k2 = nan})), NumericalError);
}

}  // namespace
}  // namespace etalon
