#include "compare/calibration_target.h"

#include <fmt/format.h>

#include <algorithm>

#include "compare/chessboard_corners.h"
#include "core/errors.h"

namespace etalon {
namespace {

constexpr int least_points_a_side = 3;

std::optional<CalibrationView> observe_chessboard(const Marker& board, const CodeImage& image) {
    const auto corners = find_chessboard_corners(image, board.columns, board.rows);
    if (!corners)
        return std::nullopt;
    return CalibrationView{board.points_mm, corners->pixels};
}

}  // namespace

CalibrationTarget parse_calibration_target(const std::string& spec, const std::string& place) {
    CalibrationTarget target{parse_marker(spec, place)};
    const Marker& board = target.board;
    if (board.kind != Marker::Kind::chessboard)
        throw ConfigError({place, 0, spec},
                          "a camera is calibrated with a board, for instance "
                          "chessboard:9x6@25mm");
    if (std::min(board.columns, board.rows) < least_points_a_side)
        throw ConfigError(
            {place, 0, spec},
            fmt::format("a board of {}x{} inner corners cannot be found: {}x{} at "
                        "least",
                        board.columns, board.rows, least_points_a_side, least_points_a_side));
    return target;
}

std::optional<CalibrationView> observe(const CalibrationTarget& target, const CodeImage& image) {
    return observe_chessboard(target.board, image);
}

}  // namespace etalon
