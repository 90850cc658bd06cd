#include "compare/detect/board/chessboard_corners.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "compare/detect/board/saddle_point.h"
#include "compare/detect/detector_adaptors.h"
#include "core/file/text.h"

namespace etalon {
namespace {

struct Board {
    std::vector<cv::Point2f> corners;  // row by row
    int columns, rows;

    const cv::Point2f& at(int row, int column) const { return corners[row * columns + column]; }
};

Eigen::Vector2d to_eigen(const cv::Point2f& p) {
    return {p.x, p.y};
}

// Pixels to the next corner along a row (1, 0) or a column (0, 1): the mean of both sides.
Eigen::Vector2d step_at(const Board& board, int row, int column, int along, int down) {
    const int last_column = board.columns - 1, last_row = board.rows - 1;
    const int before_column = std::max(column - along, 0), before_row = std::max(row - down, 0);
    const int after_column = std::min(column + along, last_column),
              after_row = std::min(row + down, last_row);
    const int steps = after_column - before_column + after_row - before_row;
    return to_eigen(board.at(after_row, after_column) - board.at(before_row, before_column)) /
           steps;
}

// Room is what is left to the sides of the four squares that do not meet in the corner.
SaddleGuess guess_of(const Board& board, int row, int column, bool lower_right_is_black) {
    const Eigen::Vector2d along = step_at(board, row, column, 1, 0),
                          down = step_at(board, row, column, 0, 1);
    const double area = std::abs(cross(along, down));
    return {to_eigen(board.at(row, column)),
            {along, lower_right_is_black ? down : Eigen::Vector2d(-down)},
            area / std::max(along.norm(), down.norm())};
}

// A mirrored order means rows that are counted from the wrong side.
void make_right_handed(Board& board) {
    const cv::Point2f origin = board.at(0, 0);
    const cv::Point2f along_row = board.at(0, board.columns - 1) - origin;
    const cv::Point2f down = board.at(board.rows - 1, 0) - origin;
    if (along_row.cross(down) >= 0.0)
        return;
    for (int row = 0; row < board.rows / 2; ++row)
        std::swap_ranges(board.corners.begin() + row * board.columns,
                         board.corners.begin() + (row + 1) * board.columns,
                         board.corners.begin() + (board.rows - 1 - row) * board.columns);
}

// How much brighter the squares between inner corners are whose row and column add to an even
// number: black ones in sim/marker/marker.h.
double even_minus_odd(const Board& board, const cv::Mat& pixels) {
    double sum[2] = {0, 0};
    int count[2] = {0, 0};
    for (int row = 0; row + 1 < board.rows; ++row)
        for (int column = 0; column + 1 < board.columns; ++column) {
            const cv::Point2f centre =
                0.25f * (board.at(row, column) + board.at(row, column + 1) +
                         board.at(row + 1, column) + board.at(row + 1, column + 1));
            const cv::Point pixel(cvRound(centre.x), cvRound(centre.y));
            if (!cv::Rect(0, 0, pixels.cols, pixels.rows).contains(pixel))
                continue;
            sum[(row + column) % 2] += pixels.at<float>(pixel);
            ++count[(row + column) % 2];
        }
    return sum[0] / std::max(count[0], 1) - sum[1] / std::max(count[1], 1);
}

// With the histogram spread over all levels, for dark photos, and without, for bright ones; then
// from saddles, for boards whose outer squares the image cuts.
bool find_board_at_scale(const cv::Mat& image, Board& board) {
    const cv::Size size(board.columns, board.rows);
    for (const int flags : {cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE,
                            static_cast<int>(cv::CALIB_CB_ADAPTIVE_THRESH)})
        if (cv::findChessboardCorners(image, size, board.corners, flags))
            return true;
    return cv::findChessboardCornersSB(image, size, board.corners,
                                       cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE);
}

// Large images are halved first, where the finder is quick.
bool find_whole_board(const cv::Mat& image, Board& board) {
    constexpr double enough_pixels = 1.5e6;
    cv::Mat halved = image;
    float factor = 1.0f;
    for (; static_cast<double>(halved.total()) > enough_pixels; factor *= 2.0f)
        cv::resize(halved, halved, {}, 0.5, 0.5, cv::INTER_AREA);
    if (factor > 1.0f && find_board_at_scale(halved, board)) {
        for (cv::Point2f& corner : board.corners)
            corner = factor * (corner + cv::Point2f(0.5f, 0.5f)) - cv::Point2f(0.5f, 0.5f);
        return true;
    }
    return find_board_at_scale(image, board);
}

ChessboardCorners refined(const Board& board, const cv::Mat& pixels) {
    ChessboardCorners found;
    const bool even_is_black = even_minus_odd(board, pixels) <= 0.0;
    for (int row = 0; row < board.rows; ++row)
        for (int column = 0; column < board.columns; ++column) {
            const SaddleGuess guess =
                guess_of(board, row, column, ((row + column) % 2 == 0) == even_is_black);
            const auto corner = refine_saddle(pixels, guess);
            found.pixels.push_back(corner.value_or(guess.pixel));
            found.refined.push_back(corner.has_value());
        }
    return found;
}

}  // namespace

std::optional<ChessboardCorners> find_chessboard_corners(const CodeImage& image, int columns,
                                                         int rows) {
    if (columns < 3 || rows < 3)
        throw ConfigError({}, fmt::format("a board of {}x{} inner corners cannot be found: 3x3 at "
                                          "least",
                                          columns, rows));
    // Below two pixels a square nothing is seen, and OpenCV would throw.
    if (std::min(image.pixels.cols, image.pixels.rows) < 2 * (std::min(columns, rows) + 1))
        return std::nullopt;
    Board board{{}, columns, rows};
    if (!find_whole_board(as_8_bit(image), board))
        return std::nullopt;
    make_right_handed(board);
    const cv::Mat pixels = as_float(image);
    const bool exchanged = even_minus_odd(board, pixels) > 0.0;
    if (exchanged && (columns + rows) % 2 == 1)
        std::reverse(board.corners.begin(), board.corners.end());
    else if (exchanged && columns == rows) {  // a quarter turn clockwise
        const Board seen = board;
        for (int i = 0; i < columns * rows; ++i)
            board.corners[static_cast<std::size_t>(i)] = seen.at(rows - 1 - i % rows, i / rows);
    }
    ChessboardCorners found = refined(board, pixels);
    found.lies_on_its_side = exchanged && (columns + rows) % 2 == 0 && columns != rows;
    return found;
}

std::unique_ptr<Detector> make_chessboard_detector(const Marker& board) {
    const auto detect = [columns = board.columns, rows = board.rows,
                         size_mm = board.size_mm](const CodeImage& image) -> Detection {
        const auto found = find_chessboard_corners(image, columns, rows);
        if (!found)
            return only_one(0, {});
        Detection detection{DetectedCorners{0, found->pixels}};
        if (found->lies_on_its_side)
            detection.shown_as =
                fmt::format("chessboard:{}x{}@{}mm", rows, columns, exact(size_mm));
        return detection;
    };
    return std::make_unique<Detector>("chessboard", detect);
}

}  // namespace etalon
