// Truth: targets rendered exactly at known poses; points where the projector puts them. Prints the
// table of docs/calibration.md, "Targets".
#include "compare/detect/board/calibration_target.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "sim/marker/marker_print.h"
#include "tests/compare/rendered_tags.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon {
namespace {

struct Case {
    const char* spec;
    bool half_turn;  // looks the same after half a turn
    double distance_mm;
    double largest_rms_px;  // with the blur of a lens; a third of it or less was measured
    double largest_noisy_rms_px = 0.025;
};

void PrintTo(const Case& target, std::ostream* out) {
    *out << target.spec;
}

const Case chessboard{"chessboard:9x6@12mm", false, 220, 0.005};
const Case charuco{"charuco:4X4_50:9x6@12mm/8.8mm", false, 200, 0.006};
const Case legacy{"charuco-legacy:4X4_50:9x6@12mm/8.8mm", false, 200, 0.006};
const Case later_ids{"charuco:5X5_250:8x6:170@13mm/9mm", false, 200, 0.006};
const Case aprilgrid{"aprilgrid:36h11:4x3@25mm/7.5mm", false, 200, 0.005};
const Case circles{"circles:8x5@14mm/8mm", true, 200, 0.002};
const Case acircles{"acircles:4x9@13mm/10mm", false, 220, 0.002};
const Case hexcircles{"hexcircles:13x9@15mm/12mm", true, 220, 0.002};
// A lone corner has half the edge, and on one side of it only: 2 sqrt(2) times a crossing's noise.
const Case squares{"squares:6x4@12mm/9mm", true, 220, 0.006, 0.04};

CameraModel distorted_camera() {
    CameraModel camera = blurred_camera(0.6);
    camera.distortion = {.k1 = -0.3, .k2 = 0.1, .p1 = 0.001};
    return camera;
}

CodeImage photo_of(const Renderer& renderer, const Marker& board, const Rigid& pose) {
    return SensorModel(renderer.camera())
        .expose(renderer.render({{{board.grid, pose}}, 1.0}).radiance);
}

// Gaussian noise of `sigma` code values.
void add_noise(CodeImage& image, double sigma, int n) {
    RandomStream random(17, 3, static_cast<std::uint64_t>(n));
    cv::add(image.pixels, normal_noise(image.pixels.size(), sigma, random), image.pixels,
            cv::noArray(), CV_8U);
}

struct Measured {
    PointErrors corrected, raw;
};

Measured measure(const Case& of, const CameraModel& camera, double noise_dn, int poses) {
    const CalibrationTarget target = parse_calibration_target(of.spec, "test");
    const Renderer renderer(camera);
    const Projector projector(camera);
    Measured measured;
    for (int n = 0; n < poses; ++n) {
        const Rigid pose = random_board_pose(target.board, n, 0.785, of.distance_mm);
        CodeImage photo = photo_of(renderer, target.board, pose);
        if (noise_dn > 0.0)
            add_noise(photo, noise_dn, n);
        const auto view = observe(target, photo).view;
        if (!view)
            continue;
        add_errors(target.board, *view, projector, pose, of.half_turn, measured.raw);
        add_errors(target.board, with_circle_centres(target, *view, camera, pose), projector, pose,
                   of.half_turn, measured.corrected);
    }
    return measured;
}

void print(const char* camera, const Case& of, const Measured& measured) {
    const PointErrors& e = measured.corrected;
    std::printf(
        "%-9s %-32s %d boards, %zu of %zu points, rms %.4f px, largest %.4f px, mean "
        "%+.4f %+.4f px; as found rms %.4f px\n",
        camera, of.spec, e.found, e.seen, e.points, e.rms(), e.largest,
        e.sum.x() / static_cast<double>(e.seen), e.sum.y() / static_cast<double>(e.seen),
        measured.raw.rms());
}

// A board in a photograph without noise.
struct Shown {
    explicit Shown(const std::string& spec)
        : target(parse_calibration_target(spec, "test")), renderer(blurred_camera(0.7)) {}

    CodeImage at(const Rigid& where) {
        pose = where;
        return photo_of(renderer, target.board, pose);
    }
    CodeImage at_random(int n, double largest_tilt, double distance_mm) {
        return at(random_board_pose(target.board, n, largest_tilt, distance_mm));
    }
    // Circles' centres where the board has circles.
    PointErrors errors(const CalibrationView& view, bool half_turn = false) const {
        PointErrors result;
        add_errors(target.board, with_circle_centres(target, view, renderer.camera(), pose),
                   Projector(renderer.camera()), pose, half_turn, result);
        return result;
    }

    CalibrationTarget target;
    Renderer renderer;
    Rigid pose;
};

class EveryTarget : public testing::TestWithParam<Case> {};

// Tilts to 45 degrees. With a blur as of a lens; without any, the hardest for sub-pixel work, as
// an edge then lies in a single row of pixels.
TEST_P(EveryTarget, IsFoundWhereTheProjectorPutsItsPoints) {
    constexpr int poses = 6;
    const Measured blurred = measure(GetParam(), blurred_camera(0.6), 0.0, poses);
    print("blurred", GetParam(), blurred);
    EXPECT_GE(blurred.corrected.found, poses - 1);
    EXPECT_GE(blurred.corrected.seen, blurred.corrected.points * 95 / 100);
    EXPECT_LT(blurred.corrected.rms(), GetParam().largest_rms_px);
    EXPECT_LT(blurred.corrected.largest, 10 * GetParam().largest_rms_px);

    const Measured sharp = measure(GetParam(), sharp_camera(), 0.0, poses);
    print("sharp", GetParam(), sharp);
    EXPECT_GE(sharp.corrected.found, poses - 1);
    EXPECT_LT(sharp.corrected.rms(), 2 * GetParam().largest_rms_px);
}

TEST_P(EveryTarget, IsFoundUnderDistortion) {
    const Measured measured = measure(GetParam(), distorted_camera(), 0.0, 5);
    print("distorted", GetParam(), measured);
    EXPECT_GE(measured.corrected.found, 4);
    EXPECT_LT(measured.corrected.rms(), GetParam().largest_rms_px);
}

// 2 code values of noise, 0.8 % of full scale. Of a crossing 0.01 px are left then (see
// tests/compare/detect/board/chessboard_corners_test.cpp), in the smaller windows of a ChArUco
// board half as much again.
TEST_P(EveryTarget, IsFoundInNoise) {
    const Measured measured = measure(GetParam(), blurred_camera(0.9), 2.0, 4);
    print("noisy", GetParam(), measured);
    EXPECT_GE(measured.corrected.found, 3);
    EXPECT_LT(measured.corrected.rms(), GetParam().largest_noisy_rms_px);
    EXPECT_GT(measured.corrected.rms(), 0.001);
}

TEST_P(EveryTarget, IsFoundInSixteenBitsAndTheSameTwice) {
    Shown shown(GetParam().spec);
    const CalibrationTarget& target = shown.target;
    const CodeImage photo = shown.at_random(3, 0.5, GetParam().distance_mm);
    const cv::Mat untouched = photo.pixels.clone();
    CodeImage deep{{}, 12};
    photo.pixels.convertTo(deep.pixels, CV_16U, 4095.0 / 255.0);
    const auto first = observe(target, photo).view, second = observe(target, photo).view,
               third = observe(target, deep).view;
    ASSERT_TRUE(first && second && third);
    EXPECT_EQ(cv::countNonZero(photo.pixels != untouched), 0);
    EXPECT_EQ(first->pixels, second->pixels);
    EXPECT_EQ(first->ids, third->ids);
    for (std::size_t i = 0; i < first->pixels.size(); ++i)
        EXPECT_LT((first->pixels[i] - third->pixels[i]).norm(), 1e-3);
}

// The sheet that `etalon marker` prints, taken for a photograph: every point is where the page has
// it, to the half dot that edges are rounded by.
TEST_P(EveryTarget, IsFoundOnItsOwnPrint) {
    const CalibrationTarget target = parse_calibration_target(GetParam().spec, "test");
    const Marker& board = target.board;
    const PrintPage page = lay_out_page(board, true);
    const double dots_per_mm = 8.0;
    const CodeImage sheet{cv::imdecode(marker_png(board, page, dots_per_mm), cv::IMREAD_GRAYSCALE),
                          8};
    const auto view = observe(target, sheet).view;
    ASSERT_TRUE(view);
    EXPECT_EQ(view->ids.size(), board.points_mm.size());
    const Eigen::Vector2d corner(page.grid_mm.x, page.grid_mm.y);
    for (std::size_t i = 0; i < view->ids.size(); ++i) {
        const auto id = static_cast<std::size_t>(view->ids[i]);
        const Eigen::Vector2d on_page =
            board.points_mm[id].head<2>() - board.grid.corner_mm + corner;
        EXPECT_LT((view->pixels[i] - (on_page * dots_per_mm - Eigen::Vector2d(0.5, 0.5))).norm(),
                  0.72)
            << id;
    }
}

// Another kind of board is in the picture. The other layout of a ChArUco board is named.
TEST_P(EveryTarget, IsNotTakenForAnother) {
    const CalibrationTarget target = parse_calibration_target(GetParam().spec, "test");
    for (const Case& other : {chessboard, charuco, aprilgrid, circles, acircles}) {
        if (std::string(other.spec) == GetParam().spec)
            continue;
        Shown shown(other.spec);
        const Marker& board = shown.target.board;
        const ObservedTarget seen = observe(target, shown.at_random(2, 0.4, other.distance_mm));
        const bool is_other_layout =
            target.board.kind == board.kind && target.board.family == board.family;
        EXPECT_EQ(seen.view.has_value(), is_other_layout) << other.spec;
        EXPECT_EQ(seen.shown_as, is_other_layout ? other.spec : "");
    }
}

INSTANTIATE_TEST_SUITE_P(Kinds, EveryTarget,
                         testing::Values(chessboard, charuco, legacy, later_ids, aprilgrid, circles,
                                         acircles, hexcircles, squares));

// Boards with tags: half of them behind a hand. What is found keeps its index and place.
TEST(CalibrationTarget, WithTagsMayBeSeenInPart) {
    for (const Case& of : {charuco, legacy, aprilgrid}) {
        Shown shown(of.spec);
        const Marker& board = shown.target.board;
        CodeImage photo = shown.at_random(4, 0.4, of.distance_mm);
        const double edge =
            Projector(shown.renderer.camera()).project(shown.pose * middle_of(board))->x();
        photo.pixels(cv::Rect(0, 0, static_cast<int>(edge), photo.pixels.rows)).setTo(90);
        const auto view = observe(shown.target, photo).view;
        ASSERT_TRUE(view) << of.spec;
        EXPECT_LT(view->ids.size(), board.points_mm.size() * 6 / 10);
        EXPECT_GT(view->ids.size(), board.points_mm.size() / 4);
        EXPECT_LT(shown.errors(*view).largest, 0.05) << of.spec;
    }
}

TEST(CalibrationTarget, HangingUpsideDownKeepsItsIndices) {
    for (const Case& of : {chessboard, charuco, legacy, aprilgrid, acircles}) {
        Shown shown(of.spec);
        const CodeImage photo = shown.at(
            board_pose(shown.target.board, {0.1, 0.05, 3.0}, {2, 1, of.distance_mm * 1.1}));
        const auto view = observe(shown.target, photo).view;
        ASSERT_TRUE(view) << of.spec;
        EXPECT_LT(shown.errors(*view).largest, 0.05) << of.spec;
    }
}

// White on black: a negative, or the board's back lit through. Tags and circles are not there; a
// chessboard's crossings are, and a negative board of odd sum is its own half turn.
TEST(CalibrationTarget, InNegativeIsNotSeenOrSeenRight) {
    for (const Case& of : {charuco, aprilgrid, circles, acircles, hexcircles, squares}) {
        Shown shown(of.spec);
        CodeImage photo = shown.at_random(3, 0.4, of.distance_mm);
        cv::bitwise_not(photo.pixels, photo.pixels);
        EXPECT_FALSE(observe(shown.target, photo).view) << of.spec;
    }
}

// OpenCV's two layouts, which differ by a square: the one that is seen is named, whichever was
// asked for, and its points are in the right places.
TEST(CalibrationTarget, TellsTheLayoutsOfCharucoApart) {
    for (const char* size : {"9x6", "8x6", "7x8"})
        for (const bool legacy : {false, true}) {
            const auto name = [&](bool old) {
                return fmt::format("charuco{}:4X4_50:{}@12mm/8.8mm", old ? "-legacy" : "", size);
            };
            Shown drawn(name(legacy));
            const CodeImage photo = drawn.at_random(3, 0.4, 230);
            EXPECT_EQ(observe(drawn.target, photo).shown_as, "");
            const ObservedTarget seen =
                observe(parse_calibration_target(name(!legacy), "test"), photo);
            ASSERT_TRUE(seen.view) << name(legacy) << seen.reason;
            EXPECT_EQ(seen.shown_as, name(legacy));
            EXPECT_LT(drawn.errors(*seen.view).largest, 0.05) << name(legacy);
        }
}

// Markers of the same dictionary at other places are no board, and what is seen is said.
TEST(CalibrationTarget, WithTagsOfAnotherLayoutIsNotTakenForTheBoard) {
    const auto seen = [&](const char* drawn, const char* asked) {
        return observe(parse_calibration_target(asked, "test"),
                       Shown(drawn).at_random(2, 0.3, 200));
    };
    const ObservedTarget other =
        seen("charuco:4X4_50:7x6@12mm/8.8mm", "charuco:4X4_50:9x6@12mm/8.8mm");
    EXPECT_FALSE(other.view);
    EXPECT_THAT(other.reason, HasSubstr("21 markers of 4X4_50 are seen, ids 0 to 20"));
    EXPECT_EQ(
        seen("charuco-legacy:4X4_250:8x6:30@12mm/8.8mm", "charuco:4X4_250:8x6@12mm/8.8mm").reason,
        "the board that is seen is charuco-legacy:4X4_250:8x6:30@12mm/8.8mm");
    EXPECT_EQ(seen("charuco:4X4_50:8x6@12mm/8.8mm", "charuco:5X5_50:8x6@12mm/8.8mm").reason,
              "no marker of 5X5_50 is seen");
}

TEST(CalibrationTarget, CirclesAreCorrectedByMoreThanTheyAreOff) {
    for (const Case& of : {circles, acircles}) {
        const Measured measured = measure(of, distorted_camera(), 0.0, 3);
        EXPECT_GT(measured.raw.rms(), 20 * measured.corrected.rms()) << of.spec;
    }
    const CalibrationTarget board = parse_calibration_target(chessboard.spec, "test");
    CalibrationView view{{{0, 0, 0}}, {{100, 100}}, {0}};
    EXPECT_EQ(with_circle_centres(board, view, sharp_camera(), {}).pixels, view.pixels);
    EXPECT_FALSE(has_circles(board));
}

// Against another way to the same number: the mean of many projected points of the disk.
TEST(CalibrationTarget, CentroidOfADiskIsTheMeanOfItsPixelsArea) {
    const CalibrationTarget target = parse_calibration_target(acircles.spec, "test");
    const CameraModel camera = distorted_camera();
    const Projector projector(camera);
    const Rigid pose = board_pose(target.board, {0.5, -0.4, 0.3}, {10, -5, 220});
    const Eigen::Vector3d centre = target.board.points_mm[7];
    const double radius = target.board.part_mm / 2;
    double area = 0;
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    constexpr int rings = 400, spokes = 64;
    for (int ring = 0; ring < rings; ++ring)
        for (int spoke = 0; spoke < spokes; ++spoke) {
            const double r = radius * (ring + 0.5) / rings,
                         angle = 6.283185307179586 * spoke / spokes;
            const Eigen::Vector3d point =
                centre + r * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0);
            const auto seen = projector.project_with_jacobian(pose * point);
            ASSERT_TRUE(seen);
            const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
            const double weight = r * (seen->jacobian * rotation.leftCols<2>()).determinant();
            area += weight;
            moment += weight * seen->pixel;
        }
    const CalibrationView view{{centre}, {moment / area}, {7}};
    const CalibrationView corrected = with_circle_centres(target, view, camera, pose);
    EXPECT_LT((corrected.pixels[0] - *projector.project(pose * centre)).norm(), 1e-5);
    EXPECT_GT((view.pixels[0] - corrected.pixels[0]).norm(), 0.05);
}

TEST(CalibrationTarget, RefusesWhatIsNoBoard) {
    for (const char* spec : {"apriltag:36h11:5@50mm", "aruco:4X4_50:7@50mm", "chessboard:2x5@25mm",
                             "chessboard:9x6@0mm", "board:9x6@25mm", "",
                             "aprilgrid:36h11:1x5@40mm/12mm", "circles:2x6@20mm/12mm"})
        EXPECT_THROW(parse_calibration_target(spec, "--target"), ConfigError) << spec;
}

// Of a grid of dots or squares, from far and near, tilted by 60 degrees, under light that falls off
// to a third, and with some of it hidden: every one is found.
TEST(CalibrationTarget, OfDotsOrSquaresIsFoundFromFarAndNearAndTilted) {
    struct View {
        const char* spec;
        double tilt, distance_mm;
    };
    for (const View& of : {View{"circles:8x6@10mm/3mm", 0.0, 340},
                           {"circles:8x6@10mm/8.5mm", 1.05, 150},
                           {"circles:4x3@40mm/24mm", 0.4, 220},
                           {"acircles:4x10@9mm/4mm", 1.05, 200},
                           {"hexcircles:20x14@8mm/6.6mm", 1.0, 190},
                           {"hexcircles:9x7@20mm/8mm", 0.3, 250},
                           {"squares:7x5@6mm/6mm", 1.0, 170},
                           {"squares:3x2@40mm/20mm", 0.2, 220}}) {
        Shown shown(of.spec);
        const Marker& board = shown.target.board;
        for (const double way : {0.0, 0.8, 1.57, 2.5, -2.0}) {
            const Eigen::Vector3d tilt =
                of.tilt * Eigen::Vector3d(std::cos(way), std::sin(way), 0.0);
            CodeImage photo = shown.at(board_pose(board, tilt, {1, -2, of.distance_mm}));
            for (int x = 0; x < photo.pixels.cols; ++x)
                photo.pixels.col(x) *= 1.0 - 0.67 * x / photo.pixels.cols;
            add_noise(photo, 1.5, 3);
            const ObservedTarget seen = observe(shown.target, photo);
            ASSERT_TRUE(seen.view) << of.spec << " " << way << " " << seen.reason;
            EXPECT_GE(seen.view->ids.size(), board.points_mm.size() * 9 / 10) << of.spec;
            EXPECT_LT(shown.errors(*seen.view, true).rms(), 0.15) << of.spec << " " << way;
        }
    }
}

TEST(CalibrationTarget, OfDotsNamesADiameterThatIsWrong) {
    const CodeImage photo = Shown("circles:8x5@14mm/8mm").at_random(1, 0.4, 200);
    const auto reason = [&](const char* spec) {
        return observe(parse_calibration_target(spec, "test"), photo).reason;
    };
    EXPECT_THAT(
        reason("circles:8x5@14mm/11mm"),
        testing::ContainsRegex("the circles are about (7.9|8|8.0[0-9]|8.1) mm wide .*not 11"));
    EXPECT_THAT(reason("circles:7x5@14mm/8mm"), HasSubstr("has several places"));
    EXPECT_THAT(reason("circles:10x9@14mm/8mm"), HasSubstr("not the board's 90"));
}

}  // namespace
}  // namespace etalon
