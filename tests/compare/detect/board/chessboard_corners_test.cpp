#include "compare/detect/board/chessboard_corners.h"

#include <opencv2/imgproc.hpp>

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
        test::image_of(size, [&](int x, int y) { return std::floor(400.5 + mean(x, y) * 3000); });
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

}  // namespace
}  // namespace etalon
