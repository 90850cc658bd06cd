// Edge profiles, edges of a target and what is fitted to them, without noise.
#include "compare/edges/edge_fit.h"

#include <opencv2/imgproc.hpp>

#include "compare/characterise/blur_estimate.h"
#include "compare/edges/edge_summary.h"
#include "core/statistics/random.h"
#include "tests/compare/edges/edge_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(EdgeResponse, IsThatOfAPixelBehindAGaussian) {
    const EdgeResponse response(6.0);
    for (const double degrees : {0.0, 7.0, 33.0, 45.0})
        for (const double sigma : {0.25, 0.6, 1.4}) {
            const double angle = degrees * std::numbers::pi / 180.0;
            const Eigen::Vector2d normal(std::cos(angle), std::sin(angle));
            Eigen::ArrayXd transfer = pixel_transfer(response.frequencies(), normal);
            for (Eigen::Index i = 0; i < transfer.size(); ++i)
                transfer[i] *= gaussian_transfer(sigma, response.frequencies()[i]);
            const Eigen::ArrayXd odd = response.odd_table(transfer);
            const Eigen::ArrayXd even = response.even_table(transfer);
            for (double d = -5.3; d < 5.5; d += 0.37)
                EXPECT_NEAR(edge_value(odd, even, d).response, gaussian_edge(d, normal, sigma),
                            2e-5)
                    << degrees << " " << sigma << " " << d;
        }
}

TEST(EdgeResponse, RefusesAReachThatIsNone) {
    for (const double reach : {0.0, -1.0, 101.0, std::numeric_limits<double>::quiet_NaN()})
        EXPECT_THROW(EdgeResponse{reach}, NumericalError);
}

// A disk's transfer against its definition, the mean of cos(2 pi f x) over the disk.
TEST(EdgeResponse, DiskTransferIsTheMeanOverTheDisk) {
    for (const double radius : {1e-4, 0.3, 1.7, 5.0})
        for (const double f : {0.02, 0.4, 1.9}) {
            double sum = 0.0;
            constexpr int steps = 4000;
            for (int i = 0; i < steps; ++i) {  // chords, x = radius sin t
                const double t = std::numbers::pi * ((i + 0.5) / steps - 0.5);
                const double c = std::cos(t);
                sum += c * c * std::cos(2.0 * std::numbers::pi * f * radius * std::sin(t));
            }
            EXPECT_NEAR(disk_transfer(f, radius).value, 2.0 * sum / steps, 1e-6);
            const double h = 1e-4 * radius * radius + 1e-12;
            const double slope =
                (disk_transfer(f, std::sqrt(radius * radius + h)).value -
                 disk_transfer(f, std::sqrt(radius * radius - h * (radius > 1e-3))).value) /
                (radius > 1e-3 ? 2.0 * h : h);
            EXPECT_NEAR(disk_transfer(f, radius).by_radius_squared, slope,
                        1e-3 * std::abs(slope) + (radius > 1e-3 ? 1e-5 : 1.0));
        }
}

// A sharp pinhole sees a vertical grid line at cx + fx x: the distances are the pixels' own.
TEST(TargetEdges, DistancesAreThoseFromTheProjectedLines) {
    EdgeScene scene{edge_camera(190, 150), gray_board("chessboard:5x4@15mm"),
                    pose_of(0.0, 0.0, 0.0, -30.0, -22.0, 500.0)};
    scene.camera.distortion = {};
    set_gaussian(scene.camera, 0.5);
    const CodeImage photo = SensorModel(scene.camera).expose(scene.rendered());
    const std::vector<StraightEdge> found = scene.edges(photo);
    // Between 5 x 4 inner corners: 5 lines of 3 edges and 4 lines of 4.
    int vertical = 0, horizontal = 0;
    for (const StraightEdge& edge : found) {
        if (edge.length_px < 15.0)  // pieces towards the margin are shorter
            continue;
        const bool is_vertical = std::abs(edge.normal.x()) > 0.5;
        ++(is_vertical ? vertical : horizontal);
        EXPECT_NEAR(edge.px_per_unit, is_vertical ? 900.0 : 905.0, 1e-6);
        EXPECT_NEAR(edge.px_per_pitch, is_vertical ? 1.0 : 905.0 / 900.0, 1e-9);
        EXPECT_NEAR(edge.depth_term, 1.0 / 500.0, 1e-12);
        EXPECT_NEAR(edge.depth_term_variance, 0.0, 1e-15);
        for (const EdgePixel& pixel : edge.pixels) {
            const double level = pixel.distance_px > 2.5    ? 0.81
                                 : pixel.distance_px < -2.5 ? 0.06
                                                            : -1.0;
            if (level > 0.0) {
                EXPECT_NEAR(pixel.radiance, level, 2e-3);
            }
        }
    }
    EXPECT_GE(vertical, 15);
    EXPECT_GE(horizontal, 16);
}

TEST(TargetEdges, LeavesOutWhatIsClippedFaintOrTooSmall) {
    const EdgeScene scene = small_board(0.5);
    CodeImage photo = SensorModel(scene.camera).expose(scene.rendered());
    const std::vector<StraightEdge> all = scene.edges(photo);
    ASSERT_GT(all.size(), 20u);
    EXPECT_EQ(scene.edges(photo, {.least_contrast = 0.9}).size(), 0u);
    EXPECT_EQ(scene.edges(photo, {.clearance_px = 14.0}).size(), 0u);
    photo.pixels.at<std::uint16_t>(cv::Point(static_cast<int>(all[0].centre_px.x()),
                                             static_cast<int>(all[0].centre_px.y()))) = 4095;
    const std::vector<StraightEdge> fewer = scene.edges(photo);
    EXPECT_LT(fewer.size(), all.size());
    EXPECT_GE(fewer.size() + 4, all.size());  // that meet there
}

TEST(TargetEdges, RefusesWhatIsNotAPhotographOfTheCamera) {
    const EdgeScene scene = small_board(0.5);
    const CodeImage small{cv::Mat(10, 10, CV_16UC1, cv::Scalar(100)), 12};
    EXPECT_THROW(scene.edges(small), NumericalError);
    const CodeImage photo{cv::Mat(150, 190, CV_16UC1, cv::Scalar(100)), 12};
    EXPECT_THROW(scene.edges(photo, {.half_width_px = std::numeric_limits<double>::quiet_NaN()}),
                 NumericalError);
    EXPECT_TRUE(scene.edges(photo).empty());
}

// Without noise unless a seed is given.
std::vector<StraightEdge> edges_of(const EdgeScene& scene, int seed = 0) {
    const SensorModel sensor(scene.camera);
    return scene.edges(
        seed == 0 ? sensor.expose(scene.rendered())
                  : sensor.expose(scene.rendered(), NoiseKey{3, static_cast<std::uint32_t>(seed)}));
}

// The renderer's error is 0.1 gray of 190 at most; sigma moves by no more than a few 1e-3 px.
TEST(PointSpreadEstimate, FindsTheRenderedWidth) {
    for (const double sigma : {0.2, 0.55, 1.1}) {
        const EdgeScene scene = small_board(sigma);
        const auto estimate = estimate_point_spread(edges_of(scene), scene.camera);
        EXPECT_NEAR(estimate.gaussian.sigma_px, sigma, 0.005);
        EXPECT_FALSE(estimate.sharpening.is_detected);
        for (const double f : {0.1, 0.25, 0.5})
            EXPECT_NEAR(estimate.measured->modulation(f).first, gaussian_transfer(sigma, f), 0.01);
    }
}

// Pose and print never say where an edge is to a hundredth of a pixel.
TEST(PointSpreadEstimate, DoesNotMindAPoseThatIsOffByPartsOfAPixel) {
    EdgeScene scene = small_board(0.55);
    const CodeImage photo = SensorModel(scene.camera).expose(scene.rendered());
    scene.pose.translation += Eigen::Vector3d(0.2, -0.15, 0.0);  // 0.36 and 0.27 px
    const auto estimate = estimate_point_spread(scene.edges(photo), scene.camera);
    EXPECT_NEAR(estimate.gaussian.sigma_px, 0.55, 0.005);
}

// Unsharp masking with 60 % of a 3 x 3 neighbourhood. One pixel from the edge the profile is about
// 0.97, its mean over three pixels (0.5 + 0.97 + 1) / 3: an overshoot of 0.06, the mean of half a
// pixel some of that.
TEST(PointSpreadEstimate, DetectsSharpeningInTheCamera) {
    const EdgeScene scene = small_board(0.5);
    const SensorModel sensor(scene.camera);
    Radiance radiance = scene.rendered();
    EXPECT_FALSE(estimate_point_spread(edges_of(scene, 1), scene.camera).sharpening.is_detected);
    cv::Mat mean;
    cv::blur(radiance, mean, {3, 3});
    const Radiance sharpened = radiance + 0.6 * (radiance - mean);
    const Sharpening sharpening =
        estimate_point_spread(scene.edges(sensor.expose(sharpened, NoiseKey{3, 2})), scene.camera)
            .sharpening;
    EXPECT_TRUE(sharpening.is_detected);
    EXPECT_GT(sharpening.overshoot, 0.02);
    EXPECT_GT(sharpening.undershoot, 0.02);
}

// A disk of light is no Gaussian, and the measured pattern holds it; its transfer is 2 J1(q)/q.
TEST(PointSpreadEstimate, MeasuresAPatternThatIsNoGaussian) {
    EdgeScene scene = small_board(0.2);
    scene.camera.lens->psf.kind = PointSpread::Kind::measured;
    scene.camera.lens->psf.profile = {{0.0, 1.0}, {1.6, 1.0}, {1.8, 0.0}, {2.0, 0.0}};
    const auto edges = edges_of(scene, 1);
    const auto estimate = estimate_point_spread(edges, scene.camera);
    EXPECT_FALSE(estimate.gaussian_suffices);
    ASSERT_TRUE(estimate.measured.has_value());
    EXPECT_LT(estimate.measured->residual_rms, estimate.gaussian.residual_rms);
    // The sloping rim between 1.6 and 1.8 px: nearly a disk of 1.703 px with the same r^2.
    for (const double f : {0.1, 0.2}) {
        const auto [value, u] = estimate.measured->modulation(f);
        EXPECT_NEAR(value, disk_transfer(f, 1.703).value, 3.0 * u + 0.005);
    }
}

// A flat board 23 mm before the plane of focus: disks of 1.3 px. Known, they are left out of sigma;
// unknown, they are in it (a disk has the variance R^2/4).
TEST(PointSpreadEstimate, LeavesOutTheDefocusThatTheCameraKnows) {
    EdgeScene scene = defocused_board();
    scene.pose = pose_of(0.0, 0.0, 0.12, -26.0, -22.0, 280.0);
    const auto edges = edges_of(scene);
    EXPECT_NEAR(estimate_point_spread(edges, scene.camera).gaussian.sigma_px, 0.5, 0.01);
    CameraModel unknown = scene.camera;
    unknown.lens.reset();
    const double blur = blur_radius_px(scene.camera, 280.0);
    EXPECT_NEAR(estimate_point_spread(edges, unknown).gaussian.sigma_px,
                std::sqrt(0.25 + 0.25 * blur * blur), 0.06);
}

TEST(PointSpreadEstimate, RefusesTooFewEdges) {
    const EdgeScene scene = small_board(0.5);
    const auto edges = edges_of(scene);
    EXPECT_THROW(estimate_point_spread(std::span(edges).first(3), scene.camera), NumericalError);
}

// What the scene's lens has, f/1.4 and 0.5 px.
void expect_found(const EdgeScene& scene) {
    const auto estimate = estimate_defocus(edges_of(scene), scene.camera);
    ASSERT_TRUE(estimate.is_determined) << estimate.undetermined;
    EXPECT_NEAR(estimate.focus_distance_mm, scene.camera.lens->focus_distance_mm, 0.5);
    EXPECT_NEAR(estimate.f_number, 1.4, 0.02);
    EXPECT_NEAR(estimate.sigma_px, 0.5, 0.01);
}

TEST(DefocusEstimate, FindsFocusAndFNumber) {
    expect_found(defocused_board());
}

// A lens of 200 degrees that sees the board 60 degrees from its axis: the thin lens near the axis,
// its pupil turned to the board, its focus a sphere.
TEST(DefocusEstimate, FindsTheFocusSphereOfAWideLens) {
    EdgeScene scene = defocused_board();
    scene.camera = camera_with(640, 520, {700.0, 704.0, 20.0, 11.0}, {.k1 = 0.01},
                               scene.camera.sensor, scene.camera.lens);
    scene.camera.projection.kind = Projection::equidistant;
    scene.camera.lens->focus_distance_mm = 240.0;
    const Rigid to_the_side{rotation_from_vector({-0.35, 0.55, 0.0}), Eigen::Vector3d::Zero()};
    scene.pose = to_the_side * pose_of(0.25, -0.8, 0.12, -26.0, -22.0, 220.0);
    expect_found(scene);
}

// f/0.6: disks of up to 4 px reach the next edge. With those left out the result is right.
TEST(DefocusEstimate, LeavesOutEdgesWhoseBlurReachesTheNext) {
    EdgeScene scene = defocused_board();
    scene.camera.lens->f_number = 0.6;
    const auto estimate = estimate_defocus(edges_of(scene), scene.camera);
    ASSERT_TRUE(estimate.is_determined) << estimate.undetermined;
    EXPECT_LT(estimate.largest_blur_px, 4.0);
    EXPECT_NEAR(estimate.focus_distance_mm, 303.0, 0.5);
    EXPECT_NEAR(estimate.f_number, 0.6, 0.01);
}

// The same board wholly nearer than focus: nothing is guessed.
TEST(DefocusEstimate, SaysWhatOneSideOfFocusLeavesOpen) {
    EdgeScene scene = defocused_board();
    scene.camera.lens->focus_distance_mm = 360.0;
    const auto estimate = estimate_defocus(edges_of(scene), scene.camera);
    EXPECT_FALSE(estimate.is_determined);
    EXPECT_NE(estimate.undetermined.find("focus distance"), std::string::npos);
    EXPECT_EQ(estimate.focus_distance_mm, 0.0);
    EXPECT_EQ(estimate.f_number, 0.0);
}

// No tilt, no change of blur.
TEST(DefocusEstimate, SaysThatAFlatTargetTellsNothing) {
    EdgeScene scene = small_board(0.5);
    scene.pose = pose_of(0.0, 0.0, 0.09, -30.0, -22.0, 500.0);
    const auto estimate = estimate_defocus(edges_of(scene, 1), scene.camera);
    EXPECT_FALSE(estimate.is_determined);
    EXPECT_FALSE(estimate.undetermined.empty());
}

TEST(DefocusEstimate, RefusesCamerasThatItCannotBeOf) {
    const EdgeScene scene = small_board(0.5);
    const auto edges = edges_of(scene);
    CameraModel telecentric = scene.camera;
    telecentric.projection.kind = Projection::telecentric;
    EXPECT_THROW(estimate_defocus(edges, telecentric), NumericalError);
    CameraModel bare = scene.camera;
    bare.sensor.reset();
    EXPECT_THROW(estimate_defocus(edges, bare), NumericalError);
    EXPECT_THROW(estimate_defocus(std::span(edges).first(11), scene.camera), NumericalError);
}

// ---- edge summary

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
    return camera_with(640, 480, {611.0, 603.0, 321.0, 236.0}, {.k1 = -0.15});
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
