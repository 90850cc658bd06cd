// Cells smaller than a pixel: several edges add their errors up, and the plan has to know.
#include <gtest/gtest.h>

#include "core/statistics/random.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

using test::gray;

constexpr double depth_mm = 190.0;
constexpr int cells = 16;

// Square cells of this many px, turned by an angle: a checkerboard, stripes or random ones.
Scene small_cells(const CameraModel& camera, double cell_px, double angle, int kind) {
    RandomStream random(7, 3);
    PlacedMarker marker;
    marker.grid.cells.create(cells, cells, CV_32FC1);
    for (int j = 0; j < cells; ++j)
        for (int i = 0; i < cells; ++i)
            marker.grid.cells.at<float>(j, i) = static_cast<float>(
                kind == 0 ? (i + j) % 2 : (kind == 1 ? i % 2 : random.uniform() < 0.5));
    const double per_px = depth_mm / camera.intrinsics.fx, side = cell_px * per_px;
    marker.grid.cell_mm = {side, side};
    marker.grid.corner_mm = Eigen::Vector2d::Constant(-0.5 * cells * side);
    marker.camera_from_marker = {
        Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ())),
        {0.31 * per_px, -0.17 * per_px, depth_mm}};
    return {{marker}, 1.0};
}

// Error of the automatic plan, which aims at 0.1 gray, against 24 exact lens averages a side.
double error_gray(const Renderer& renderer, const Scene& scene) {
    const std::vector<NeglectedEffect> keep{NeglectedEffect::lens, NeglectedEffect::diffraction,
                                            NeglectedEffect::tail};
    const cv::Rect middle(36, 24, 24, 24);
    const RenderedImage planned = renderer.render(scene, {.region = middle, .keep = keep});
    const RenderedImage exact = renderer.render(scene, {.method = RenderMethod::exact_lens,
                                                        .tolerance_gray = 1e3,
                                                        .samples_per_side = 24,
                                                        .region = middle,
                                                        .keep = keep});
    return test::largest_difference(planned.radiance, exact.radiance) / gray;
}

TEST(SmallCells, AreWithinTheToleranceWhereverTheirEdgesLie) {
    for (const PointSpread& spread : {PointSpread{PointSpread::Kind::gaussian, 0.11},
                                      PointSpread{PointSpread::Kind::ideal, 0.0}}) {
        CameraModel camera = test::small_camera(spread);
        camera.lens->focus_distance_mm = 197.0;  // blurred by some 0.3 px
        const Renderer renderer(camera);
        for (const double cell_px : {0.21, 0.61})
            for (int kind = 0; kind < 3; ++kind)
                EXPECT_LT(error_gray(renderer, small_cells(camera, cell_px, 0.37, kind)), 0.15)
                    << cell_px << " px, kind " << kind;
    }
}

}  // namespace
}  // namespace etalon
