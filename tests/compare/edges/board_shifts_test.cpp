#include "compare/edges/edge_summary.h"

#include <gtest/gtest.h>

#include "core/statistics/random.h"

namespace etalon {
namespace {

CameraModel camera() {
    CameraModel camera;
    camera.width = 640;
    camera.height = 480;
    camera.intrinsics = {611.0, 603.0, 321.0, 236.0};
    camera.distortion.k1 = -0.15;
    return camera;
}

// A board of 7 x 5 squares of 20 mm seen from ten places: the edges across x and y of its squares,
// displaced on the board by `on_board_mm` (by the edge's number) and in the image by noise.
template <class Function>
std::vector<EdgesOfPhoto> seen(Function on_board_mm, double noise_px) {
    const Projector projector(camera());
    std::vector<EdgesOfPhoto> photos;
    for (int photo = 0; photo < 10; ++photo) {
        RandomStream random(5, static_cast<std::uint32_t>(photo));
        const Rigid pose{
            rotation_from_vector({0.3 * std::sin(photo), 0.4 * std::cos(1.7 * photo), 0.2 * photo}),
            {-60.0 + 3.0 * photo, -50.0, 310.0 + 5.0 * photo}};
        EdgesOfPhoto edges{{}, pose};
        for (int axis = 0; axis < 2; ++axis)
            for (int line = 0; line <= 6; ++line)
                for (int along = 0; along < 5; ++along) {
                    Eigen::Vector3d point = Eigen::Vector3d::Zero();
                    point[axis] = 20.0 * line;
                    point[1 - axis] = 20.0 * along + 10.0;
                    const Eigen::Vector2d pixel = *projector.project(pose * point);
                    const Eigen::Vector2d beside = *projector.project(
                        pose * Eigen::Vector3d(point + Eigen::Vector3d::Unit(axis)));
                    EdgeShift edge;
                    edge.middle_px = pixel;
                    const double sign = (line + along) % 2 == 0 ? 1.0 : -1.0;  // towards the light
                    edge.normal = sign * (beside - pixel).normalized();
                    edge.shift_px =
                        sign * on_board_mm(35 * axis + 5 * line + along) * (beside - pixel).norm() +
                        noise_px * random.normal();
                    edges.edges.push_back(edge);
                }
        photos.push_back(edges);
    }
    return photos;
}

const ComparedArea area{{0, 0}, {140, 100}, {20, 20}, {0, 0}};

TEST(BoardShifts, AreToldFromNoise) {
    const auto shifts = board_shifts(seen([](int) { return 0.0; }, 0.1), Projector(camera()), area);
    ASSERT_TRUE(shifts);
    EXPECT_FALSE(shifts->are_the_boards());
    EXPECT_LT(shifts->share, 0.1);
}

// 0.05 mm are some 0.1 px: as much as the noise, so that half of the mean square is shared.
TEST(BoardShifts, OfABoardPrintedUnevenlyAreShared) {
    RandomStream random(9, 3);
    std::vector<double> displaced;
    for (int i = 0; i < 70; ++i)
        displaced.push_back(0.05 * random.normal());
    const auto shifts =
        board_shifts(seen([&](int edge) { return displaced[static_cast<std::size_t>(edge)]; }, 0.1),
                     Projector(camera()), area);
    ASSERT_TRUE(shifts);
    EXPECT_TRUE(shifts->are_the_boards());
    EXPECT_NEAR(shifts->rms_mm, 0.05, 0.01);
    EXPECT_NEAR(shifts->share, 0.5, 0.15);
}

TEST(BoardShifts, NeedEightPhotographs) {
    std::vector<EdgesOfPhoto> photos = seen([](int) { return 0.1; }, 0.1);
    photos.resize(7);
    EXPECT_FALSE(board_shifts(photos, Projector(camera()), area));
}

}  // namespace
}  // namespace etalon
