// Two sets of 13 real photographs of a board, "left" and "right": OpenCV's samples, JPEG at quality
// 50, with the corners that are found in them and the camera that fits these.
#pragma once

#include <fmt/format.h>

#include "calib/intrinsics/camera_fit.h"
#include "compare/detect/board/chessboard_corners.h"
#include "tests/paths.h"

namespace etalon::test {

// Whether the photographs of Debian's opencv-doc are there: ./test.sh puts them into build/photos.
inline bool photos_are_there() {
    return std::filesystem::exists(std::filesystem::path(ETALON_PHOTO_DIR) / "left01.jpg");
}

struct BoardPhotos {
    Marker board = parse_marker("chessboard:9x6@25mm", "test");
    std::vector<std::string> names;
    std::vector<CodeImage> images;
    std::vector<CalibrationView> views;
    CameraFit fit;

    explicit BoardPhotos(const std::string& side,
                         const std::filesystem::path& folder = ETALON_PHOTO_DIR) {
        for (int n = 1; n <= 14; ++n) {
            if (n == 10)
                continue;  // the sets have none
            names.push_back(fmt::format("{}{:02}.jpg", side, n));
            images.push_back(read_image(folder / names.back()));
            const auto corners = find_chessboard_corners(images.back(), board.columns, board.rows);
            views.push_back({board.points_mm, corners.value().pixels});
        }
        fit = fit_camera(views, {640, 480}, calibration_model("standard"));
    }
};

}  // namespace etalon::test
