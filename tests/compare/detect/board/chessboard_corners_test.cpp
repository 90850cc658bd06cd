#include "compare/detect/board/chessboard_corners.h"

#include <opencv2/imgproc.hpp>

#include "compare/detect/board/saddle_point.h"
#include "core/geometry/units.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Image of sim/marker/marker.h's board under a homography (board squares to pixels), each pixel the
// mean of 8x8 points: made here, so that the renderer's faults cannot hide the finder's.
cv::Mat drawn(const Eigen::Matrix3d& pixel_from_board, int columns, int rows, cv::Size size) {
    const Eigen::Matrix3d board_from_pixel = pixel_from_board.inverse();
    const auto radiance = [&](double x, double y) {
        const Eigen::Vector2d p = (board_from_pixel * Eigen::Vector3d(x, y, 1)).hnormalized();
        const double column = std::floor(p.x()),
                     row = std::floor(p.y());  // -1 before the first corner
        if (column < -1 || row < -1 || column >= columns || row >= rows)
            return 1.0;
        return static_cast<int>(column + row + 2) % 2 == 0 ? 0.0 : 1.0;
    };
    const auto mean = [&](double x, double y) {
        const double corners = radiance(x - 0.5, y - 0.5) + radiance(x + 0.5, y - 0.5) +
                               radiance(x - 0.5, y + 0.5) + radiance(x + 0.5, y + 0.5);
        if (corners == 0.0 || corners == 4.0)
            return corners / 4;
        double sum = 0;
        for (int i = 0; i < 233; ++i)  // a Fibonacci lattice: 1/233 px fine along every direction
            sum += radiance(x + (i + 0.5) / 233 - 0.5, y + (i * 144 % 233 + 0.5) / 233 - 0.5);
        return sum / 233;
    };
    cv::Mat image =
        image_of(size, [&](int x, int y) { return std::floor(400.5 + mean(x, y) * 3000); });
    image.convertTo(image, CV_16U);
    cv::GaussianBlur(image, image, {0, 0}, 0.7);
    return image;
}

// Largest distance of any corner from where it was drawn, in the order of sim/marker/marker.h.
double largest_error(const ChessboardCorners& found, const Eigen::Matrix3d& pixel_from_board,
                     int columns) {
    double largest = 0;
    for (std::size_t i = 0; i < found.pixels.size(); ++i) {
        const Eigen::Vector3d corner(static_cast<double>(i % columns),
                                     static_cast<double>(i / columns), 1);
        largest =
            std::max(largest, ((pixel_from_board * corner).hnormalized() - found.pixels[i]).norm());
    }
    return largest;
}

struct Board {
    int columns, rows;
    double square_px, angle;
    Eigen::Vector2d centre{203.3, 196.7};
    cv::Size size{400, 400};
    double largest_px = 0.06;  // the drawing blurs sampled pixels, which moves edges by as much
    bool either_way = false;   // the reverse order is right, too

    // The board's middle at `centre`, turned by `angle`, a little perspective.
    Eigen::Matrix3d pixel_from_board() const {
        Eigen::Matrix3d middle, turned, perspective;
        middle << 1, 0, -(columns - 1) / 2.0, 0, 1, -(rows - 1) / 2.0, 0, 0, 1;
        const double c = square_px * std::cos(angle), s = square_px * std::sin(angle);
        turned << c, -s, centre.x(), s, c, centre.y(), 0, 0, 1;
        perspective << 1, 0, 0, 0, 1, 0, 0.01, -0.007, 1;
        return turned * perspective * middle;
    }
    CodeImage image() const { return {drawn(pixel_from_board(), columns, rows, size), 12}; }
};

ChessboardCorners expect_found(const Board& board) {
    SCOPED_TRACE(board.angle);
    auto found = find_chessboard_corners(board.image(), board.columns, board.rows).value();
    EXPECT_EQ(found.pixels.size(), static_cast<std::size_t>(board.columns * board.rows));
    double error = largest_error(found, board.pixel_from_board(), board.columns);
    if (board.either_way) {
        std::ranges::reverse(found.pixels);
        error = std::min(error, largest_error(found, board.pixel_from_board(), board.columns));
    }
    EXPECT_LT(error, board.largest_px) << board.square_px;
    return found;
}

TEST(ChessboardCorners, AreInTheMarkersOrderHoweverTheBoardIsTurned) {
    for (const double degrees : {0.0, 77.0, 131.0, 180.0, 262.0, 311.0})
        EXPECT_THAT(expect_found({7, 4, 23.0, degrees * rad_per_deg}).refined, Each(true));
}

TEST(ChessboardCorners, AreFoundWithSmallAndWithLargeSquares) {
    for (const double square_px : {9.0, 23.0, 82.0})
        expect_found({7, 4, square_px, 0.2, {403.3, 296.7}, {800, 600}});
}

// A thumb, say: the corner under it stays where the finder put it and is said not to be refined.
TEST(ChessboardCorners, SayWhichOneCouldNotBeRefined) {
    const Board board{7, 4, 41.0, 0.2, {403.3, 296.7}, {800, 600}};
    const CodeImage image = board.image();
    const Eigen::Vector2d hidden =
        (board.pixel_from_board() * Eigen::Vector3d(3, 2, 1)).hnormalized();
    cv::circle(image.pixels, {cvRound(hidden.x()), cvRound(hidden.y())}, 8, cv::Scalar::all(1900),
               -1);
    const auto found = find_chessboard_corners(image, 7, 4);
    ASSERT_TRUE(found);
    for (std::size_t i = 0; i < found->refined.size(); ++i)
        EXPECT_EQ(found->refined[i], i != 2 * 7 + 3) << i;
}

// 8x4: turned by 180 degrees the board has the same colours. Either order is right-handed.
TEST(ChessboardCorners, OfAnEvenSumKeepOneOfTwoOrders) {
    expect_found({.columns = 8, .rows = 4, .square_px = 31.0, .angle = 0.3, .either_way = true});
}

// 9x5 and 5x9 have the same corners, and black where the other has white.
TEST(ChessboardCorners, TellABoardThatLiesOnItsSide) {
    for (const double degrees : {3.0, 95.0}) {
        const CodeImage image = Board{9, 5, 29.0, degrees * rad_per_deg}.image();
        const auto found = find_chessboard_corners(image, 9, 5),
                   other = find_chessboard_corners(image, 5, 9);
        ASSERT_TRUE(found && other) << degrees;
        EXPECT_FALSE(found->lies_on_its_side);
        EXPECT_TRUE(other->lies_on_its_side);
    }
}

// Of a square board the colours tell two of the four orders that its outline allows.
TEST(ChessboardCorners, OfASquareBoardBeginAtABlackSquare) {
    for (const double degrees : {4.0, 49.0, 94.0, 139.0, 184.0})
        expect_found({.columns = 5,
                      .rows = 5,
                      .square_px = 31.0,
                      .angle = degrees * rad_per_deg,
                      .either_way = true});
}

// The image's border runs through the outer squares; all inner corners are in it.
TEST(ChessboardCorners, AreFoundWhereTheImageCutsTheOuterSquares) {
    expect_found({7, 4, 40.0, 0.02, {150.0, 200.0}, {400, 400}, 0.1});
}

TEST(ChessboardCorners, AreNotInventedWhereThereIsNoWholeBoard) {
    EXPECT_FALSE(find_chessboard_corners(Board{7, 4, 40.0, 0.1, {60.0, 196.7}}.image(), 7, 4));
    EXPECT_FALSE(find_chessboard_corners({cv::Mat(200, 300, CV_8UC1, cv::Scalar(128)), 8}, 7, 4));
    EXPECT_FALSE(find_chessboard_corners({cv::Mat(1, 1, CV_8UC1, cv::Scalar(0)), 8}, 7, 4));
    EXPECT_FALSE(find_chessboard_corners({}, 7, 4));
}

TEST(ChessboardCorners, RefuseBoardsThatTheFinderCannotSee) {
    EXPECT_THROW(find_chessboard_corners({cv::Mat(200, 300, CV_8UC1), 8}, 2, 4), ConfigError);
}

// ---- saddle point

// Truth: geometry. Two straight edges cross at a known point of a drawing finer than the pixels.

struct Crossing {
    Eigen::Vector2d centre{20.3125, 19.5625};  // a corner of the drawing's cells
    double angle_1 = 0.3, angle_2 = 1.7;       // of the edges
    double dark = 0.1, bright = 0.8;

    Eigen::Vector2d edge(int i) const {
        const double angle = i == 0 ? angle_1 : angle_2;
        return {std::cos(angle), std::sin(angle)};
    }
    SaddleGuess guess(double room_px) const {
        return {centre + Eigen::Vector2d(0.7, -0.6), {edge(0), edge(1)}, room_px};
    }
};

bool is_dark(const Crossing& crossing, const Eigen::Vector2d& place) {
    const Eigen::Vector2d p = place - crossing.centre;
    const auto side = [&](int i) {
        const Eigen::Vector2d e = crossing.edge(i);
        return e.x() * p.y() - e.y() * p.x() > 0;
    };
    return side(0) != side(1);  // left of one edge, right of the other
}

// Drawn, blurred and integrated over each pixel's square on a grid 16 times finer: blurring the
// pixels themselves would blur what their sampling has already distorted.
cv::Mat drawn(const Crossing& crossing, double sigma_px) {
    constexpr int finer = 16, size = 41;
    cv::Mat fine = image_of({size * finer, size * finer}, [&](int x, int y) {
        const Eigen::Vector2d place((x + 0.5) / finer - 0.5, (y + 0.5) / finer - 0.5);
        return is_dark(crossing, place) ? crossing.dark : crossing.bright;
    });
    cv::Mat image;
    if (sigma_px > 0)
        cv::GaussianBlur(fine, fine, {0, 0}, finer * sigma_px);
    cv::resize(fine, image, {size, size}, 0, 0, cv::INTER_AREA);
    return image;
}

double error_of(const cv::Mat& image, const Crossing& crossing, double room_px = 18) {
    const auto found = refine_saddle(image, crossing.guess(room_px));
    return found ? (*found - crossing.centre).norm() : 1e9;
}

// The largest over phases and directions: without any blur, where the pixels' own squares are all
// there is, and with some.
TEST(SaddlePoint, IsRightToThousandthsOfAPixel) {
    double sharp = 0, blurred = 0;
    for (int i = 0; i < 24; ++i) {
        RandomStream random(3, 1, static_cast<std::uint64_t>(i));
        Crossing crossing;
        crossing.centre = {19.5 + std::floor(16 * random.uniform()) / 16,
                           19.5 + std::floor(16 * random.uniform()) / 16};
        crossing.angle_1 = i < 4 ? 0.0 : 3.0 * random.uniform();
        crossing.angle_2 = crossing.angle_1 + 1.57 + (random.uniform() - 0.5);
        sharp = std::max(sharp, error_of(drawn(crossing, 0), crossing));
        blurred = std::max(blurred, error_of(drawn(crossing, 0.7), crossing));
    }
    EXPECT_LT(sharp, 0.02);
    EXPECT_LT(blurred, 0.005);
}

// What moves dark and bright alike about the centre must not move the centre.
TEST(SaddlePoint, IsNotMovedByToneCurveOrShading) {
    Crossing crossing;
    const cv::Mat linear = drawn(crossing, 0.9);
    cv::Mat toned;
    cv::pow(linear, 0.45, toned);
    const cv::Mat shaded = linear.mul(image_of(
        linear.size(), [](int x, int y) { return 1.0 + 0.01 * (x - 20) - 0.006 * (y - 20); }));
    EXPECT_LT(error_of(toned, crossing), 0.005);
    EXPECT_LT(error_of(shaded, crossing), 0.01);  // 1 % a pixel is ten times a strong vignette
}

// Noise n = 1 % of full scale, steps h = 70 %, window 5.5 px. A pixel's length of an edge blurred
// by s = 0.945 px (0.9 px and the pixel's own square) tells its place to n / h * sqrt(2 sqrt(pi) s)
// = 0.026 px; some 8 of the 11 px are of use (the crossing itself and the fading border tell less):
// 0.0092 px is the least that is possible, and what the other parameters cost comes on top.
TEST(SaddlePoint, TakesWhatNoiseLeaves) {
    const Crossing crossing;
    const cv::Mat clean = drawn(crossing, 0.9);
    double sum = 0;
    constexpr int trials = 200;
    for (int trial = 0; trial < trials; ++trial) {
        RandomStream random(11, 2, static_cast<std::uint64_t>(trial));
        const double error = error_of(clean + normal_noise(clean.size(), 0.01, random), crossing);
        sum += error * error;
    }
    const double rms = std::sqrt(sum / trials / 2);
    EXPECT_GT(rms, 0.008);
    EXPECT_LT(rms, 0.014);
}

TEST(SaddlePoint, IsReachedFromAGuessThreePixelsOff) {
    const Crossing crossing;
    const cv::Mat image = drawn(crossing, 0.7);
    for (int degrees = 0; degrees < 360; degrees += 30) {
        SaddleGuess guess = crossing.guess(18);
        guess.pixel = crossing.centre +
                      3 * Eigen::Vector2d(std::cos(degrees / 57.3), std::sin(degrees / 57.3));
        const auto found = refine_saddle(image, guess);
        ASSERT_TRUE(found) << degrees;
        EXPECT_LT((*found - crossing.centre).norm(), 0.005) << degrees;
    }
}

TEST(SaddlePoint, IsNotSeenWhereThereIsNone) {
    const Crossing crossing;
    const cv::Mat image = drawn(crossing, 0.7);
    SaddleGuess negative = crossing.guess(18);
    negative.edges[1] = -negative.edges[1];
    EXPECT_FALSE(refine_saddle(image, negative)) << "dark and bright exchanged";
    EXPECT_FALSE(refine_saddle(image, crossing.guess(2.0))) << "no room for a window";
    for (const double level : {0.5, 0.0})
        EXPECT_FALSE(
            refine_saddle(cv::Mat(41, 41, CV_32FC1, cv::Scalar(level)), crossing.guess(18)));
    SaddleGuess turned = crossing.guess(18);
    for (Eigen::Vector2d& edge : turned.edges)
        edge = Eigen::Rotation2Dd(0.78) * edge;
    EXPECT_FALSE(refine_saddle(image, turned)) << "edges where none are";
    SaddleGuess outside = crossing.guess(18);
    outside.pixel = {3, 20};
    EXPECT_FALSE(refine_saddle(image, outside)) << "the window leaves the image";
    outside.pixel.x() = std::nan("");
    EXPECT_FALSE(refine_saddle(image, outside));
    // A plain corner, as of a tag on white: one dark quadrant and three bright ones.
    cv::Mat corner(41, 41, CV_32FC1, cv::Scalar(0.8));
    corner(cv::Rect(20, 20, 21, 21)).setTo(0.1);
    EXPECT_FALSE(refine_saddle(corner, {{19.5, 19.5}, {{1, 0}, {0, 1}}, 18}));
}

TEST(SaddleWindow, NeverReachesTheNextEdge) {
    EXPECT_EQ(saddle_window_px(2.4), 0.0);
    EXPECT_DOUBLE_EQ(saddle_window_px(5.0), 4.0);
    EXPECT_DOUBLE_EQ(saddle_window_px(25.0), 5.5);
    EXPECT_DOUBLE_EQ(saddle_window_px(90.0), 15.0);
}

}  // namespace
}  // namespace etalon
