#include "sim/tiles/undistortion_map.h"

#include <Eigen/LU>
#include <Eigen/SVD>

#include "bench/benchmark_scenes.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Largest distance, in px, between the map and Newton's method over some tiles; and whether every
// exact point lies in its tile's bounds, up to that distance.
double worst_error_px(const UndistortionMap& map, int stride) {
    const double fx = map.projector().camera().intrinsics.fx;
    std::vector<std::optional<MappedPoint>> points;
    double worst = 0.0;
    for (int j = map.tiles().y; j < map.tiles().br().y; j += stride)
        for (int i = map.tiles().x; i < map.tiles().br().x; i += stride) {
            if (map.validity(i, j) != UndistortionMap::Validity::all)
                continue;
            map.sample(i, j, 3, points);
            for (int q = 0; q < 9; ++q) {
                const Eigen::Vector2d pixel(4 * i - 0.5 + (q % 3 + 0.5) * 4 / 3.0,
                                            4 * j - 0.5 + (q / 3 + 0.5) * 4 / 3.0);
                const auto exact = map.exact(pixel);
                const auto& mapped = *points[static_cast<std::size_t>(q)];
                worst = std::max(worst, fx * (mapped.x - exact->x).norm());
                worst = std::max(worst, 1e-2 * fx * (mapped.jacobian - exact->jacobian).norm());
                const Box& box = map.bounds(i, j);
                EXPECT_TRUE((exact->x.array() > box.low.array() - 1e-7).all());
                EXPECT_TRUE((exact->x.array() < box.high.array() + 1e-7).all());
            }
        }
    return worst;
}

TEST(UndistortionMap, IsRightToAHundredThousandthOfAPixelOnAWebcam) {
    const UndistortionMap map(Projector(benchmark_scene("webcam-500").camera), 20);
    EXPECT_LT(worst_error_px(map, 5), 1e-5);
}

// The image's corner lies at the fold of this model (r = 0.419, its image 0.368), where the inverse
// has a square root's singularity.
TEST(UndistortionMap, IsRightToAThousandthOfAPixelNextToAFold) {
    const UndistortionMap map(Projector(benchmark_scene("canon-500").camera), 20);
    EXPECT_LT(worst_error_px(map, 23), 1e-3);
}

// Rays up to 1.4 rad from the axis, seen by one that looks 0.35 rad aside: X/Z grows to 1.8 there.
// Through a tile's corners and its neighbours' a cubic errs by up to 6e-4 px.
TEST(UndistortionMap, OfAFisheyeTurnedAsideHasCubicsWithinItsTiles) {
    const Projector fisheye(benchmark_scene("fisheye-60").camera);
    const UndistortionMap map(fisheye.turned(rotation_from_vector({0.1, 0.35, 0.0})),
                              cv::Rect(100, 200, 400, 300));
    EXPECT_EQ(map.tiles(), cv::Rect(25, 50, 100, 75));
    for (int j = 50; j < 125; ++j)
        for (int i = 25; i < 125; ++i)
            ASSERT_EQ(map.validity(i, j), UndistortionMap::Validity::all) << i << " " << j;
    EXPECT_LT(worst_error_px(map, 3), 1e-4);
}

TEST(UndistortionMap, BoundsAreTight) {
    CameraModel camera = benchmark_scene("webcam-500").camera;
    camera.distortion = {};
    const UndistortionMap map(Projector(camera), 8);
    const Box& box = map.bounds(7, 5);
    EXPECT_NEAR(box.low.x(), (4 * 7 - 0.5 - 319.5) / 538.55, 1e-12);
    EXPECT_NEAR(box.high.y(), (4 * 6 - 0.5 - 239.5) / 538.55, 1e-12);
}

TEST(UndistortionMap, KnowsWhereThereAreNoRays) {
    CameraModel camera = benchmark_scene("webcam-500").camera;
    camera.distortion = {.k1 = -0.6};  // folds over at r = 0.745, inside the image's diagonal
    const UndistortionMap map(Projector(camera), 8);
    EXPECT_EQ(map.validity(80, 60), UndistortionMap::Validity::all);
    EXPECT_EQ(map.validity(0, 0), UndistortionMap::Validity::none);
    int partly = 0;
    for (int i = 0; i < 80; ++i)
        partly += map.validity(i, 60) == UndistortionMap::Validity::some;
    EXPECT_GT(partly, 0);
}

void expect_bounds(const UndistortionMap& map, int level) {
    using Validity = UndistortionMap::Validity;
    const cv::Rect below = map.groups(level - 1);
    for (int j = below.y; j < below.br().y; ++j)
        for (int i = below.x; i < below.br().x; ++i) {
            const auto& part = map.group(level - 1, i, j);
            const auto& group = map.group(level, floor_div(i, 4), floor_div(j, 4));
            if (group.validity != Validity::some) {
                ASSERT_EQ(part.validity == Validity::none, group.validity == Validity::none);
            }
            if (part.validity == Validity::none)
                continue;
            ASSERT_TRUE((group.bounds.low.array() <= part.bounds.low.array()).all());
            ASSERT_TRUE((group.bounds.high.array() >= part.bounds.high.array()).all());
        }
}

// Whatever is left to a block's own cubic: hardly bent, bent, and folded over within the image.
TEST(UndistortionMap, GroupsBoundTheirTilesOnEveryLevel) {
    CameraModel folded = benchmark_scene("webcam-500").camera;
    folded.distortion = {.k1 = -0.6};
    for (const CameraModel& camera :
         {benchmark_scene("webcam-500").camera, benchmark_scene("canon-900").camera, folded}) {
        const UndistortionMap map(Projector(camera), 20);
        ASSERT_GE(map.levels(), 4);  // 170 x 130 tiles
        for (int level = 1; level < map.levels(); ++level)
            expect_bounds(map, level);
        EXPECT_LE(map.groups(map.levels() - 1).area(), 16);
    }
}

TEST(UndistortionMap, IsTheSameWhateverWasAskedForBefore) {
    const Projector projector(benchmark_scene("webcam-500").camera);
    const UndistortionMap forwards(projector, 20), backwards(projector, 20);
    std::vector<Eigen::Vector2d> centres;
    for (int j = 0; j < 120; j += 7)
        for (int i = 0; i < 160; i += 5)
            centres.push_back(forwards.polynomial(i, j).centre);
    for (int j = 119; j >= 0; --j)
        for (int i = 159; i >= 0; --i)
            if (j % 7 == 0 && i % 5 == 0) {
                EXPECT_EQ(backwards.polynomial(i, j).centre, centres.back());
                centres.pop_back();
            }
}

TEST(UndistortionMap, PolynomialIsWhatIsSampled) {
    const UndistortionMap map(Projector(benchmark_scene("canon-500").camera), 20);
    std::vector<std::optional<MappedPoint>> points;
    map.sample(90, 70, 5, points);
    const TilePolynomial tile = map.polynomial(90, 70);
    for (int q = 0; q < 25; ++q) {
        const double s = (q % 5 + 0.5) / 5 - 0.5, t = (q / 5 + 0.5) / 5 - 0.5;
        const Eigen::Vector4d in_s(1, s, s * s, s * s * s), in_t(1, t, t * t, t * t * t);
        const Eigen::Vector2d x =
            tile.centre + Eigen::Vector2d(in_t.dot(tile.x * in_s), in_t.dot(tile.y * in_s));
        EXPECT_LT((x - points[static_cast<std::size_t>(q)]->x).norm(), 1e-14);
    }
}

// Of a strong barrel distortion, whose inverse is differentiated numerically.
TEST(UndistortionMap, KnowsHowMuchItBends) {
    const UndistortionMap map(
        Projector(camera_with(80, 64, {50.0, 70.0, 39.5, 31.5}, {.k1 = -0.15, .k2 = 0.02})), 8);
    const Eigen::Vector2d at(61.5, 21.5);  // the middle of tile (15, 5)
    const auto x = [&](double dx, double dy) {
        return *map.projector().unproject(at + Eigen::Vector2d(dx, dy));
    };
    constexpr double h = 0.01;
    Eigen::Matrix2d by_px;
    by_px << (x(h, 0) - x(-h, 0)) / (2 * h), (x(0, h) - x(0, -h)) / (2 * h);
    double curvature = 0.0;
    for (const Eigen::Vector2d& second :
         {Eigen::Vector2d((x(h, 0) - 2 * x(0, 0) + x(-h, 0)) / (h * h)),
          Eigen::Vector2d((x(0, h) - 2 * x(0, 0) + x(0, -h)) / (h * h)),
          Eigen::Vector2d((x(h, h) - x(h, -h) - x(-h, h) + x(-h, -h)) / (4 * h * h))})
        curvature = std::max(curvature, (by_px.inverse() * second).cwiseAbs().maxCoeff());
    const auto bend = map.bend(0, 15, 5);
    EXPECT_TRUE(bend.is_polynomial || map.validity(15, 5) == UndistortionMap::Validity::some);
    EXPECT_GT(curvature, 0.003);
    // From differences over tiles, of the tile's middle.
    EXPECT_NEAR(bend.curvature, curvature, 0.15 * curvature);
    const Eigen::Vector2d lengths =
        Eigen::JacobiSVD<Eigen::Matrix2d>(by_px.inverse()).singularValues();
    EXPECT_NEAR(bend.largest_scale, lengths[0] / 70.0, 0.02);
    EXPECT_NEAR(bend.least_scale, lengths[1] / 50.0, 0.02);
    // Around it there is more and less of it.
    const auto around = map.bend({8, 0, 11, 12});
    EXPECT_GT(around.curvature, bend.curvature);
    EXPECT_LT(around.least_scale, bend.least_scale);
}

TEST(UndistortionMap, DoesNotBendWithoutDistortion) {
    CameraModel camera = benchmark_scene("webcam-500").camera;
    camera.distortion = {};
    camera.intrinsics.fy *= 1.3;
    const auto bend = UndistortionMap(Projector(camera), 8).bend({3, 5, 40, 30});
    EXPECT_LT(bend.curvature, 1e-9);
    EXPECT_TRUE(bend.is_polynomial);
    EXPECT_NEAR(bend.least_scale, 1.0, 1e-9);
    EXPECT_NEAR(bend.largest_scale, 1.0, 1e-9);
}

}  // namespace
}  // namespace etalon
