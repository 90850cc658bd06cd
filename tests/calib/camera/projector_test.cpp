#include "calib/camera/projector.h"

#include <opencv2/calib3d.hpp>
#include <opencv2/ccalib/omnidir.hpp>

#include "calib/camera/camera_model.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

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
    for (const CameraModel& camera : {webcam(), canon(), all_fourteen(), wide_angle()}) {
        const Projector projector(camera);
        for (const Eigen::Vector3d& p : points) {
            const auto pixel = projector.project(p);
            ASSERT_TRUE(pixel) << p.transpose();
            EXPECT_LT((*pixel - opencv_projection(camera, p)).norm(), 1e-9) << p.transpose();
        }
    }
}

CameraModel skewed() {
    CameraModel camera = all_fourteen();
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
    for (const CameraModel& camera : {webcam(), canon(), all_fourteen(), wide_angle(), skewed()}) {
        const Projector projector(camera);
        for (const Eigen::Vector3d& p : points) {
            const auto projected = projector.project_with_jacobian(p);
            ASSERT_TRUE(projected);
            const Eigen::MatrixXd expected = complex_step(
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
    expect_round_trip(webcam(), 3);
    expect_round_trip(canon(), 17);
    expect_round_trip(all_fourteen(), 3);
    expect_round_trip(skewed(), 3);
    expect_round_trip(wide_angle(), 7);
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
         {webcam(), all_fourteen(), camera_with(8, 8, {5, 7, 3, 2}, {})}) {
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

// ---- wide projector

// Projector with lenses that see more than a plane: their projection (lens_projection_test.cpp) and
// the distortion (projector_test.cpp) one after the other, and back.

CameraModel wide(LensProjection projection, Distortion distortion = {}, double focal = 150.0) {
    CameraModel camera = camera_with(700, 500, {focal, 0.97 * focal, 361.0, 239.0}, distortion);
    camera.projection = projection;
    return camera;
}

// Every kind, those that end and those that do not, with all coefficients that it may have.
std::vector<CameraModel> wide_cameras() {
    using enum Projection;
    const Distortion some{.k1 = 0.011,
                          .k2 = -0.0021,
                          .p1 = 0.0012,
                          .p2 = -0.0007,
                          .k3 = 3e-4,
                          .s1 = 0.001,
                          .s4 = -2e-4,
                          .k7 = -2e-5};
    const auto cahvors = test::cahvors();
    return {wide({equidistant}, some),
            wide({stereographic}, some, 180.0),
            wide({field_of_view, 0.93}, some),
            wide({unified, 0.71}, some, 220.0),
            wide({unified, 1.83}, some, 700.0),
            wide({extended_unified, 1.13, 0.62}, some),
            wide({double_sphere, -0.21, 0.57}, some),
            wide({equidistant}),
            wide({double_sphere, 0.34, 0.44}),
            wide(polynomials()[0], some),
            wide(polynomials()[1]),
            wide(cahvors[2]),
            wide(cahvors[3], {.k1 = 0.001, .p2 = -0.0007}),
            wide(splines()[0]),
            wide(splines()[1], {.k1 = 0.001, .p2 = -0.0007})};
}

TEST(WideProjector, IsOpenCvsFisheyeOverTheWholeImage) {
    CameraModel camera =
        wide({Projection::equidistant}, {.k1 = 0.021, .k2 = -0.013, .k3 = 0.004, .k7 = -0.0006});
    camera.intrinsics.skew = 7.3;
    const Intrinsics& i = camera.intrinsics;
    const cv::Matx33d k(i.fx, 0, i.cx, 0, i.fy, i.cy, 0, 0, 1);
    const cv::Vec4d coefficients(0.021, -0.013, 0.004, -0.0006);
    const Projector projector(camera);
    int compared = 0;
    for (int y = 0; y < camera.height; y += 7)
        for (int x = 0; x < camera.width; x += 7) {
            const auto ray = projector.ray({x, y});
            if (!ray || ray->z() < 0.05)
                continue;  // OpenCV's own stops before 90 degrees
            const std::vector<cv::Point3d> points{{ray->x(), ray->y(), ray->z()}};
            std::vector<cv::Point2d> pixels;
            cv::fisheye::projectPoints(points, pixels, cv::Vec3d(), cv::Vec3d(), k, coefficients,
                                       i.skew / i.fx);
            ASSERT_LT((Eigen::Vector2d(pixels[0].x, pixels[0].y) - Eigen::Vector2d(x, y)).norm(),
                      1e-9)
                << x << " " << y;
            ++compared;
        }
    EXPECT_GT(compared, 3000);
}

TEST(WideProjector, IsOpenCvsOmnidirOverTheWholeImage) {
    CameraModel camera = wide({Projection::unified, 1.27},
                              {.k1 = -0.11, .k2 = 0.031, .p1 = 0.0021, .p2 = -0.0034}, 500.0);
    camera.intrinsics.skew = -4.1;
    const Intrinsics& i = camera.intrinsics;
    const cv::Matx33d k(i.fx, i.skew, i.cx, 0, i.fy, i.cy, 0, 0, 1);
    const Projector projector(camera);
    for (int y = 0; y < camera.height; y += 7)
        for (int x = 0; x < camera.width; x += 7) {
            const auto ray = projector.ray({x, y});
            ASSERT_TRUE(ray);
            const std::vector<cv::Point3d> points{{ray->x(), ray->y(), ray->z()}};
            std::vector<cv::Point2d> pixels;
            cv::omnidir::projectPoints(points, pixels, cv::Vec3d(), cv::Vec3d(), k, 1.27,
                                       cv::Vec4d(-0.11, 0.031, 0.0021, -0.0034));
            ASSERT_LT((Eigen::Vector2d(pixels[0].x, pixels[0].y) - Eigen::Vector2d(x, y)).norm(),
                      1e-9)
                << x << " " << y;
        }
}

TEST(WideProjector, EveryPixelComesBack) {
    for (const CameraModel& camera : wide_cameras()) {
        SCOPED_TRACE(name_of(camera.projection.kind).name);
        const Projector projector(camera);
        int behind = 0, seen = 0;
        for (int y = 0; y < camera.height; y += 11)
            for (int x = 0; x < camera.width; x += 11) {
                const auto ray = projector.ray({x, y});
                if (!ray)
                    continue;
                ++seen;
                behind += ray->z() < 0.0;
                const auto back = projector.project(731.0 * *ray);
                ASSERT_TRUE(back) << x << " " << y;
                ASSERT_LT((*back - Eigen::Vector2d(x, y)).norm(), 1e-9) << x << " " << y;
            }
        EXPECT_GT(seen, 2000);
        EXPECT_GT(behind, 0);
    }
}

// Central differences; what they lose is some 1e-9 of the derivative.
TEST(WideProjector, HasTheDerivativesOfBoth) {
    for (const CameraModel& camera : wide_cameras()) {
        SCOPED_TRACE(name_of(camera.projection.kind).name);
        const Projector projector(camera);
        for (const double angle : {0.0, 0.3, 0.9, 1.6}) {
            const Eigen::Vector3d p = ray_at(angle, 2.13, 3.7);
            const auto at = projector.project_with_jacobian(p);
            ASSERT_TRUE(at);
            for (int i = 0; i < 3; ++i) {
                const Eigen::Vector3d step = 2e-5 * Eigen::Vector3d::Unit(i);
                const Eigen::Vector2d slope =
                    (*projector.project(p + step) - *projector.project(p - step)) / 4e-5;
                EXPECT_LT((at->jacobian.col(i) - slope).norm(), 2e-8 * at->jacobian.norm());
            }
        }
    }
}

// theta (1 - 0.05 theta^2) is imaged as far as it grows: to sqrt(1 / 0.15) = 2.58 rad.
TEST(WideProjector, EndsAtTheFirstOfFoldAndProjection) {
    const Projector folding(wide({Projection::equidistant}, {.k1 = -0.05}));
    const double fold = std::sqrt(1.0 / 0.15);
    EXPECT_TRUE(folding.project(ray_at(fold - 1e-6, 0.4)));
    EXPECT_FALSE(folding.project(ray_at(fold + 1e-6, 0.4)));
    const Projector ending(wide({Projection::equidistant}, {.k1 = 0.02}));
    EXPECT_TRUE(ending.project(ray_at(pi - 1e-6, 0.4)));
    const double edge = 150.0 * pi * (1.0 + 0.02 * pi * pi);
    EXPECT_TRUE(ending.ray({361.0 + edge - 1e-3, 239.0}));
    EXPECT_FALSE(ending.ray({361.0 + edge + 1e-3, 239.0}));
    EXPECT_FALSE(ending.project({0.0, 0.0, -1.0}));
}

TEST(WideProjector, RefusesWhatNoLensIs) {
    EXPECT_THROW(Projector(wide({Projection::equidistant}, {.tau_x = 0.1})), NumericalError);
    EXPECT_THROW(Projector(wide({Projection::double_sphere, -1.0, 0.5})), NumericalError);
    EXPECT_THROW(require_perspective(wide({Projection::equidistant}), "this"), NumericalError);
}

// Up to 80 degrees, with the derivative that differences have.
TEST(WideProjector, HasNormalisedCoordinatesInFront) {
    for (const CameraModel& camera : wide_cameras()) {
        SCOPED_TRACE(name_of(camera.projection.kind).name);
        const Projector projector(camera);
        for (const double angle : {0.0, 0.4, 1.1, 1.39}) {
            const Eigen::Vector3d ray = ray_at(angle, 0.9);
            const Eigen::Vector2d x = ray.hnormalized();
            const auto found = projector.unproject(*projector.project(ray));
            ASSERT_TRUE(found);
            EXPECT_LT((*found - x).norm(), 1e-11 * (1.0 + x.squaredNorm()));
            const Eigen::Matrix2d derivative = projector.pixel_by_normalised(x);
            for (int i = 0; i < 2; ++i) {
                const Eigen::Vector2d step = 1e-5 * Eigen::Vector2d::Unit(i);
                const Eigen::Vector2d slope = (*projector.project((x + step).homogeneous()) -
                                               *projector.project((x - step).homogeneous())) /
                                              2e-5;
                EXPECT_LT((derivative.col(i) - slope).norm(), 1e-5);
            }
        }
        EXPECT_FALSE(projector.unproject(*projector.project(ray_at(1.397, 0.9))));
    }
}

TEST(WideProjector, HasRaysOfFlatLensesToo) {
    const Projector webcam(test::webcam());
    const auto plane = webcam.unproject({17, 400});
    EXPECT_EQ(*webcam.ray({17, 400}), Eigen::Vector3d(plane->x(), plane->y(), 1.0));
}

// ---- camera model

CameraModel webcam_with_lens(double focus_distance_mm) {
    CameraModel camera = webcam();
    camera.lens = Lens{2.5, focus_distance_mm, 650, {}};
    camera.sensor = Sensor{.pixel_pitch_um = 8.3};
    return camera;
}

TEST(ThinLens, SatisfiesTheLensEquation) {
    const ThinLens lens = thin_lens(webcam_with_lens(150));
    EXPECT_NEAR(lens.image_distance_mm, 538.55 * 0.0083, 1e-15);
    EXPECT_NEAR(1 / lens.focal_length_mm, 1 / 150.0 + 1 / lens.image_distance_mm, 1e-15);
    EXPECT_NEAR(lens.aperture_diameter_mm, lens.focal_length_mm / 2.5, 1e-15);
    EXPECT_NEAR(lens.working_f_number, lens.image_distance_mm / lens.aperture_diameter_mm, 1e-15);
    EXPECT_GT(lens.working_f_number, 2.5);  // bellows factor
}

TEST(ThinLens, FocusedAtInfinityHasItsSensorInTheFocalPlane) {
    const ThinLens lens = thin_lens(webcam_with_lens(std::numeric_limits<double>::infinity()));
    EXPECT_EQ(lens.inverse_focus_per_mm, 0.0);
    EXPECT_DOUBLE_EQ(lens.focal_length_mm, lens.image_distance_mm);
    EXPECT_DOUBLE_EQ(lens.working_f_number, 2.5);
}

// Similar triangles: a point at z is sharp at z' = 1 / (1/f - 1/z) behind the lens, and the cone
// from the aperture has the diameter d |z' - v| / z' where the sensor cuts it.
TEST(BlurRadius, IsTheConeFromTheApertureCutByTheSensor) {
    const CameraModel camera = webcam_with_lens(150);
    const ThinLens lens = thin_lens(camera);
    for (const double z : {90.0, 500.0, 1700.0}) {
        const double sharp = 1 / (1 / lens.focal_length_mm - 1 / z);
        const double diameter_mm =
            lens.aperture_diameter_mm * std::abs(sharp - lens.image_distance_mm) / sharp;
        EXPECT_NEAR(blur_radius_px(camera, z), diameter_mm / 2 / 0.0083, 1e-10);
    }
    EXPECT_NEAR(blur_radius_px(camera, 150), 0.0, 1e-12);
}

TEST(BlurRadius, IsZeroWithoutALensAndRefusedBehindIt) {
    EXPECT_EQ(blur_radius_px(webcam(), 500), 0.0);
    EXPECT_THROW(blur_radius_px(webcam_with_lens(150), 0.0), NumericalError);
    EXPECT_THROW(blur_radius_px(webcam_with_lens(150), std::nan("")), NumericalError);
}

TEST(ThinLens, RefusesLensesThatCannotExist) {
    EXPECT_THROW(thin_lens(webcam()), NumericalError);
    EXPECT_THROW(thin_lens(webcam_with_lens(0.0)), NumericalError);
    EXPECT_THROW(thin_lens(webcam_with_lens(std::nan(""))), NumericalError);
    CameraModel camera = webcam_with_lens(150);
    camera.lens->f_number = 0.0;
    EXPECT_THROW(thin_lens(camera), NumericalError);
}

}  // namespace
}  // namespace etalon
