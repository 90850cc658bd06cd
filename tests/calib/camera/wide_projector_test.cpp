// Projector with lenses that see more than a plane: their projection (lens_projection_test.cpp) and
// the distortion (projector_test.cpp) one after the other, and back.

#include <opencv2/calib3d.hpp>
#include <opencv2/ccalib/omnidir.hpp>

#include "tests/calib/cameras.h"
#include "tests/calib/lens_tables.h"
#include "tests/test.h"

namespace etalon {
namespace {

using test::pi, test::ray_at;

CameraModel wide(LensProjection projection, Distortion distortion = {}, double focal = 150.0) {
    CameraModel camera =
        test::camera_with(700, 500, {focal, 0.97 * focal, 361.0, 239.0}, distortion);
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
            wide(test::polynomials()[0], some),
            wide(test::polynomials()[1]),
            wide(cahvors[2]),
            wide(cahvors[3], {.k1 = 0.001, .p2 = -0.0007}),
            wide(test::splines()[0]),
            wide(test::splines()[1], {.k1 = 0.001, .p2 = -0.0007})};
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

}  // namespace
}  // namespace etalon
