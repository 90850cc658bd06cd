#include "compare/edges/edge_summary.h"

#include "core/statistics/random.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

EdgeShift edge(double x, double y, double angle, double shift, double deviation) {
    return {.middle_px = {x, y},
            .normal = {std::cos(angle), std::sin(angle)},
            .depth_mm = 400.0 + x,
            .radius_px = std::hypot(x - 319.5, y - 239.5),
            .pixels = 100,
            .shift_px = shift,
            .shift_deviation_px = deviation,
            .blur_deviation_px2 = 0.01};
}

// With equal deviations the definition is solved by hand: mean square less variance.
TEST(EdgeSummary, TakesTheNoiseOutOfTheShifts) {
    const std::vector<EdgeShift> edges = {edge(0, 0, 0, 0.5, 0.3), edge(0, 0, 0, -0.7, 0.3),
                                          edge(0, 0, 0, 0.4, 0.3)};
    const EdgeSummary summary = edge_summary(edges);
    EXPECT_NEAR(summary.shift.with_noise_px, std::sqrt(0.9 / 3.0), 1e-12);
    EXPECT_NEAR(summary.shift.noise_px, 0.3, 1e-12);
    EXPECT_NEAR(summary.shift.rms_px, std::sqrt(0.9 / 3.0 - 0.09), 1e-9);
    EXPECT_NEAR(summary.median_shift_px, 1.4826 * 0.5, 1e-12);
    EXPECT_NEAR(summary.mean_shift_px, 0.2 / 3.0, 1e-12);
    EXPECT_EQ(edge_summary({{edge(0, 0, 0, 0.2, 0.3)}}).shift.rms_px, 0.0);
    EXPECT_EQ(edge_summary({}).edges, 0);
}

// Deviations from 0.01 to 0.3 px about a spread of 0.07 px: found within its stated deviation.
// 400 runs: the mean pull within 3.5 / sqrt(400) and 0.1 for a root's bias, mean square of 1 within
// 3.5 sqrt(2 / 400), and a tenth.
TEST(EdgeSummary, FindsASpreadUnderUnequalNoise) {
    double sum = 0.0, squares = 0.0;
    for (std::uint32_t run = 0; run < 400; ++run) {
        RandomStream random(11, run);
        std::vector<EdgeShift> edges;
        for (int i = 0; i < 75; ++i) {
            const double deviation = 0.01 * std::pow(30.0, random.uniform());
            edges.push_back(
                edge(0, 0, 0, std::hypot(0.07, deviation) * random.normal(), deviation));
        }
        const ShiftSpread spread = edge_summary(edges).shift;
        const double pull = (spread.rms_px - 0.07) / spread.rms_deviation_px;
        sum += pull / 400.0;
        squares += pull * pull / 400.0;
    }
    EXPECT_LT(std::abs(sum), 0.28);
    EXPECT_GT(squares, 0.65);
    EXPECT_LT(squares, 1.35);
}

TEST(EdgeSummary, LeavesEdgesBeyondTheirRangeOut) {
    std::vector<EdgeShift> edges = {edge(0, 0, 0, 0.1, 0.01), edge(0, 0, 0, 0.6, 0.01)};
    edges[1].is_beyond_range = true;
    const EdgeSummary summary = edge_summary(edges);
    EXPECT_EQ(summary.edges, 1);
    EXPECT_EQ(summary.beyond_range, 1);
    EXPECT_NEAR(summary.mean_shift_px, 0.1, 1e-12);
}

TEST(EdgeSummary, PartsKeepTheirSigns) {
    std::vector<EdgeShift> edges = {edge(0, 0, 0, 0.1, 0.01), edge(0, 0, 0, 0.2, 0.01)};
    edges[0].shares = {700.0, -300.0, 400.0, 1000.0};
    edges[1].shares = {100.0, 100.0, -500.0, 300.0};
    const EdgeParts parts = edge_summary(edges).parts;  // of 200 pixels
    EXPECT_NEAR(parts.shift_gray, 2.0, 1e-12);
    EXPECT_NEAR(parts.blur_gray, -1.0, 1e-12);
    EXPECT_NEAR(parts.photometric_gray, -std::sqrt(0.5), 1e-12);
    EXPECT_NEAR(parts.rest_gray, std::sqrt(6.5), 1e-12);
    EXPECT_NEAR(parts.residual_gray, 3.0, 1e-12);
}

// Edges of two slanted directions that one vector moves, 7 of one and 5 of the other.
TEST(ShiftField, FindsTheVectorsThatEdgesShowPartsOf) {
    const Eigen::Vector2d left(0.13, -0.31), right(-0.2, 0.05);
    std::vector<EdgeShift> edges;
    for (int i = 0; i < 12; ++i)
        for (const double x : {100.0, 500.0}) {
            EdgeShift one = edge(x + 3 * i, 40.0 + 2 * i, i < 7 ? 0.3 : 2.1, 0, 0.01 + 0.002 * i);
            one.shift_px = one.normal.dot(x < 300 ? left : right);
            edges.push_back(one);
        }
    for (int i = 0; i < 9; ++i)  // all of one direction: no vector
        edges.push_back(edge(300.0 + i, 400.0, 0.3, 0.1, 0.01));
    const std::vector<ShiftVector> field = shift_field(edges, {640, 480}, 160.0);
    ASSERT_EQ(field.size(), 2u);
    EXPECT_LT((field[0].shift_px - left).norm(), 1e-12);
    EXPECT_LT((field[1].shift_px - right).norm(), 1e-12);
    EXPECT_EQ(field[0].edges, 12);
    EXPECT_NEAR(field[0].position_px.x(), 116.5, 1e-9);
    // Information of the two directions, by hand in one of them.
    double information = 0.0;
    for (int i = 0; i < 12; ++i)
        information += std::pow(std::cos(i < 7 ? 0.3 : 2.1) / (0.01 + 0.002 * i), 2);
    EXPECT_NEAR(field[0].covariance_px2.inverse()(0, 0), information, 1e-6 * information);
    EXPECT_THROW(shift_field(edges, {640, 480}, 0.0), NumericalError);
}

TEST(EdgeBins, CoverRadiusAndDepth) {
    std::vector<EdgeShift> edges;
    for (int i = 0; i < 7; ++i)
        edges.push_back(edge(319.5 + 50.0 * i, 239.5, 0, 0.1 * i, 0.01));
    const auto by_radius = edges_by_radius(edges, {640, 480}, 4);  // to 399.2 px
    ASSERT_EQ(by_radius.size(), 4u);
    EXPECT_NEAR(by_radius[3].high, std::hypot(319.5, 239.5), 1e-9);
    EXPECT_EQ(by_radius[0].summary.edges, 2);
    EXPECT_EQ(by_radius[1].summary.edges, 2);
    EXPECT_EQ(by_radius[3].summary.edges, 1);
    EXPECT_EQ(by_radius[3].summary.pixels, 100);
    const auto by_depth = edges_by_depth(edges, 3);
    ASSERT_EQ(by_depth.size(), 3u);
    EXPECT_NEAR(by_depth[0].low, 719.5, 1e-9);
    EXPECT_NEAR(by_depth[2].high, 1019.5, 1e-9);
    EXPECT_EQ(by_depth[0].summary.edges + by_depth[1].summary.edges + by_depth[2].summary.edges, 7);
    EXPECT_EQ(by_depth[2].summary.edges, 3);  // the farthest included
    EXPECT_TRUE(edges_by_depth({}, 3).empty());
    EXPECT_THROW(edges_by_depth(edges, 0), NumericalError);
}

CameraModel camera_of_board() {
    return test::camera_with(640, 480, {611.0, 603.0, 321.0, 236.0}, {.k1 = -0.15});
}

// A board of 7 x 5 squares of 20 mm seen from ten places: the edges across x and y of its squares,
// displaced on the board by `on_board_mm` (by the edge's number) and in the image by noise.
template <class Function>
std::vector<EdgesOfPhoto> seen(Function on_board_mm, double noise_px) {
    const Projector projector(camera_of_board());
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
    const auto shifts =
        board_shifts(seen([](int) { return 0.0; }, 0.1), Projector(camera_of_board()), area);
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
                     Projector(camera_of_board()), area);
    ASSERT_TRUE(shifts);
    EXPECT_TRUE(shifts->are_the_boards());
    EXPECT_NEAR(shifts->rms_mm, 0.05, 0.01);
    EXPECT_NEAR(shifts->share, 0.5, 0.15);
}

TEST(BoardShifts, NeedEightPhotographs) {
    std::vector<EdgesOfPhoto> photos = seen([](int) { return 0.1; }, 0.1);
    photos.resize(7);
    EXPECT_FALSE(board_shifts(photos, Projector(camera_of_board()), area));
}

}  // namespace
}  // namespace etalon
