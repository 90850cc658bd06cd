#include "sim/undistortion_map.h"

#include <gtest/gtest.h>

#include "sim/benchmark_scenes.h"

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

TEST(UndistortionMap, GroupsBoundTheirTilesOnEveryLevel) {
    const UndistortionMap map(Projector(benchmark_scene("webcam-500").camera), 20);
    ASSERT_GE(map.levels(), 4);  // 170 x 130 tiles
    for (int level = 1; level < map.levels(); ++level) {
        const cv::Rect below = map.groups(level - 1);
        for (int j = below.y; j < below.br().y; ++j)
            for (int i = below.x; i < below.br().x; ++i) {
                const int up_i = (i + 400) / 4 - 100, up_j = (j + 400) / 4 - 100;
                const Box &tile = map.bounds(level - 1, i, j),
                          &group = map.bounds(level, up_i, up_j);
                EXPECT_TRUE((group.low.array() <= tile.low.array()).all());
                EXPECT_TRUE((group.high.array() >= tile.high.array()).all());
            }
    }
    EXPECT_LE(map.groups(map.levels() - 1).area(), 16);
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

}  // namespace
}  // namespace etalon
