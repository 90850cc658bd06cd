#include "compare/detect/board/chessboard_corners.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "core/program/errors.h"

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
    cv::Mat image(size, CV_16UC1);
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
    for (int y = 0; y < size.height; ++y)
        for (int x = 0; x < size.width; ++x)
            image.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(400.5 + mean(x, y) * 3000);
    cv::GaussianBlur(image, image, {0, 0}, 0.7);
    return image;
}

// The board's middle at `centre`, turned by `angle`, squares of `square_px`, a little perspective.
Eigen::Matrix3d placed(double square_px, double angle, int columns, int rows,
                       const Eigen::Vector2d& centre) {
    Eigen::Matrix3d middle, turned, perspective;
    middle << 1, 0, -(columns - 1) / 2.0, 0, 1, -(rows - 1) / 2.0, 0, 0, 1;
    const double c = square_px * std::cos(angle), s = square_px * std::sin(angle);
    turned << c, -s, centre.x(), s, c, centre.y(), 0, 0, 1;
    perspective << 1, 0, 0, 0, 1, 0, 0.01, -0.007, 1;
    return turned * perspective * middle;
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

// The same of the order that was found or its reverse.
double largest_error_either_way(ChessboardCorners found, const Eigen::Matrix3d& pixel_from_board,
                                int columns) {
    const double as_found = largest_error(found, pixel_from_board, columns);
    std::ranges::reverse(found.pixels);
    return std::min(as_found, largest_error(found, pixel_from_board, columns));
}

// 0.06 px: the drawing blurs pixels that are sampled already, which moves edges by as much.
TEST(ChessboardCorners, AreInTheMarkersOrderHoweverTheBoardIsTurned) {
    for (const double degrees : {0.0, 77.0, 131.0, 180.0, 262.0, 311.0}) {
        const auto h = placed(23.0, degrees * 3.14159265358979 / 180, 7, 4, {203.3, 196.7});
        const auto found = find_chessboard_corners({drawn(h, 7, 4, {400, 400}), 12}, 7, 4);
        ASSERT_TRUE(found) << degrees;
        ASSERT_EQ(found->pixels.size(), 28u);
        EXPECT_LT(largest_error(*found, h, 7), 0.06) << degrees;
        EXPECT_EQ(std::count(found->refined.begin(), found->refined.end(), true), 28);
    }
}

TEST(ChessboardCorners, AreFoundWithSmallAndWithLargeSquares) {
    for (const double square_px : {9.0, 23.0, 82.0}) {
        const auto h = placed(square_px, 0.2, 7, 4, {403.3, 296.7});
        const auto found = find_chessboard_corners({drawn(h, 7, 4, {800, 600}), 12}, 7, 4);
        ASSERT_TRUE(found) << square_px;
        EXPECT_LT(largest_error(*found, h, 7), 0.06) << square_px;
    }
}

// A thumb, say: the corner under it stays where the finder put it and is said not to be refined.
TEST(ChessboardCorners, SayWhichOneCouldNotBeRefined) {
    const auto h = placed(41.0, 0.2, 7, 4, {403.3, 296.7});
    cv::Mat image = drawn(h, 7, 4, {800, 600});
    const Eigen::Vector2d hidden = (h * Eigen::Vector3d(3, 2, 1)).hnormalized();
    cv::circle(image, {cvRound(hidden.x()), cvRound(hidden.y())}, 8, cv::Scalar::all(1900), -1);
    const auto found = find_chessboard_corners({image, 12}, 7, 4);
    ASSERT_TRUE(found);
    for (std::size_t i = 0; i < found->refined.size(); ++i)
        EXPECT_EQ(found->refined[i], i != 2 * 7 + 3) << i;
}

// 8x4: turned by 180 degrees the board has the same colours. Either order is right-handed.
TEST(ChessboardCorners, OfAnEvenSumKeepOneOfTwoOrders) {
    const auto h = placed(31.0, 0.3, 8, 4, {203.3, 196.7});
    const auto found = find_chessboard_corners({drawn(h, 8, 4, {400, 400}), 12}, 8, 4);
    ASSERT_TRUE(found);
    EXPECT_LT(largest_error_either_way(*found, h, 8), 0.06);
}

// 9x5 and 5x9 have the same corners, and black where the other has white.
TEST(ChessboardCorners, TellABoardThatLiesOnItsSide) {
    for (const double degrees : {3.0, 95.0}) {
        const auto h = placed(29.0, degrees * 3.14159265358979 / 180, 9, 5, {203.3, 196.7});
        const CodeImage image{drawn(h, 9, 5, {400, 400}), 12};
        const auto found = find_chessboard_corners(image, 9, 5),
                   other = find_chessboard_corners(image, 5, 9);
        ASSERT_TRUE(found && other) << degrees;
        EXPECT_FALSE(found->lies_on_its_side);
        EXPECT_TRUE(other->lies_on_its_side);
    }
}

// Of a square board the colours tell two of the four orders that its outline allows.
TEST(ChessboardCorners, OfASquareBoardBeginAtABlackSquare) {
    for (const double degrees : {4.0, 49.0, 94.0, 139.0, 184.0}) {
        const auto h = placed(31.0, degrees * 3.14159265358979 / 180, 5, 5, {203.3, 196.7});
        const auto found = find_chessboard_corners({drawn(h, 5, 5, {400, 400}), 12}, 5, 5);
        ASSERT_TRUE(found) << degrees;
        EXPECT_LT(largest_error_either_way(*found, h, 5), 0.06) << degrees;
    }
}

// The image's border runs through the outer squares; all inner corners are in it.
TEST(ChessboardCorners, AreFoundWhereTheImageCutsTheOuterSquares) {
    const auto h = placed(40.0, 0.02, 7, 4, {150.0, 200.0});
    const auto found = find_chessboard_corners({drawn(h, 7, 4, {400, 400}), 12}, 7, 4);
    ASSERT_TRUE(found);
    EXPECT_LT(largest_error(*found, h, 7), 0.1);
}

TEST(ChessboardCorners, AreNotInventedWhereThereIsNoWholeBoard) {
    const auto cut = placed(40.0, 0.1, 7, 4, {60.0, 196.7});
    EXPECT_FALSE(find_chessboard_corners({drawn(cut, 7, 4, {400, 400}), 12}, 7, 4));
    EXPECT_FALSE(find_chessboard_corners({cv::Mat(200, 300, CV_8UC1, cv::Scalar(128)), 8}, 7, 4));
    EXPECT_FALSE(find_chessboard_corners({cv::Mat(1, 1, CV_8UC1, cv::Scalar(0)), 8}, 7, 4));
    EXPECT_FALSE(find_chessboard_corners({}, 7, 4));
}

TEST(ChessboardCorners, RefuseBoardsThatTheFinderCannotSee) {
    EXPECT_THROW(find_chessboard_corners({cv::Mat(200, 300, CV_8UC1), 8}, 2, 4), ConfigError);
}

}  // namespace
}  // namespace etalon
