// Truth: OpenCV's own drawing of a ChArUco board, Kalibr's published layout and codes, geometry.
#include "sim/marker/board_pattern.h"

#include <opencv2/core/version.hpp>
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 407
#include <opencv2/objdetect/aruco_board.hpp>
#else
#include <opencv2/aruco/charuco.hpp>
#endif
#include <opencv2/imgproc.hpp>

#include "tests/sim/marker/marker_checks.h"

namespace etalon {
namespace {

Marker board(const std::string& spec) {
    return parse_marker(spec, "--target");
}

cv::Mat drawn_by_opencv(int columns, int rows, float square, float marker, cv::Size size) {
    cv::Mat image;
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 407
    const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_50);
    cv::aruco::CharucoBoard({columns, rows}, square, marker, dictionary).generateImage(size, image);
#else
    const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_50);
    cv::aruco::CharucoBoard::create(columns, rows, square, marker, dictionary)->draw(size, image);
#endif
    return image;
}

// 28 mm squares with markers of 7 cells of 3 mm: a grid of 1-mm cells, four of OpenCV's pixels
// each.
TEST(CharucoBoard, IsWhatOpenCVDraws) {
    for (const auto& [columns, rows] : {std::pair(5, 7), {6, 4}, {7, 4}}) {
        const Marker marker = board(fmt::format("charuco:5X5_50:{}x{}@28mm/21mm", columns, rows));
        const cv::Mat image =
            drawn_by_opencv(columns, rows, 28, 21, {columns * 28 * 4, rows * 28 * 4});
        int differences = 0;
        for (int y = 0; y < rows * 28; ++y)
            for (int x = 0; x < columns * 28; ++x)
                differences += (image.at<uchar>(4 * y + 2, 4 * x + 2) > 127) !=
                               (radiance_at(marker, x + 0.5 - 28, y + 0.5 - 28) > 0.5f);
        EXPECT_EQ(differences, 0) << marker.spec;
    }
}

TEST(CharucoBoard, HasItsInnerCornersRowByRow) {
    const Marker marker = board("charuco:4X4_50:9x6@30mm/22mm");
    ASSERT_EQ(marker.points_mm.size(), 40u);
    EXPECT_EQ(marker.points_mm[0], Eigen::Vector3d(0, 0, 0));
    EXPECT_EQ(marker.points_mm[8], Eigen::Vector3d(0, 30, 0));
    EXPECT_EQ(marker.points_mm[39], Eigen::Vector3d(210, 120, 0));
    EXPECT_NEAR(marker.detail_mm, 22.0 / 6, 1e-12);
}

// 29.97 and 21.5 have no common measure of any use: edges inside a marker are rounded, the rest is
// exact.
TEST(CharucoBoard, OfAwkwardLengthsKeepsItsSquares) {
    const Marker marker = board("charuco:4X4_50:5x4@29.97mm/21.5mm");
    const double cell = marker.grid.cell_mm.x();
    EXPECT_NEAR(29.97 / cell, std::round(29.97 / cell), 1e-9);
    for (const double side : {-1e-6, 1e-6}) {
        EXPECT_EQ(radiance_at(marker, side, 29.97 / 2), side < 0 ? 1.0f : 0.0f) << "second row";
        EXPECT_EQ(radiance_at(marker, side, -29.97 / 20), side < 0 ? 0.0f : 1.0f) << "first row";
    }
    // The upper left marker's black border begins where it should, to a twentieth of its cell.
    const double margin = (29.97 - 21.5) / 2, allowed = 21.5 / 6 / 20;
    EXPECT_EQ(radiance_at(marker, margin - allowed, -15), 1.0f);
    EXPECT_EQ(radiance_at(marker, margin + allowed, -15), 0.0f);
}

// Codes 0 and 7 of the 36h11 table that Kalibr's target script prints, most significant bit at the
// upper left, row by row.
TEST(AprilGrid, IsKalibrsWithItsCodesAndCornerSquares) {
    const Marker marker = board("aprilgrid:36h11:4x3@40mm/12mm");
    constexpr std::uint64_t code_0 = 0xd5d628584;
    const double left = 0, top = 2 * 52;  // tag 0: bottom left
    for (int row = 0; row < 10; ++row)
        for (int column = 0; column < 10; ++column) {
            const bool inside = row >= 2 && row < 8 && column >= 2 && column < 8;
            const bool white = inside && ((code_0 >> (35 - 6 * (row - 2) - (column - 2))) & 1) != 0;
            EXPECT_EQ(radiance_at(marker, left + 4 * column + 2, top + 4 * row + 2), white ? 1 : 0)
                << row << ", " << column;
        }
    // Black squares in the crossings of the gaps, outside the outer tags too, white between.
    for (const double x : {-6.0, 46.0, 202.0})
        for (const double y : {-6.0, 46.0, 150.0}) {
            EXPECT_EQ(radiance_at(marker, x, y), 0.0f);
            EXPECT_EQ(radiance_at(marker, x + 5.9, y - 5.9), 0.0f);
            EXPECT_EQ(radiance_at(marker, x + 6.1, y), 1.0f) << "between two tags";
            EXPECT_EQ(radiance_at(marker, x, y - 6.1), 1.0f);
        }
}

TEST(AprilGrid, CountsTagsFromTheBottomLeftAndPointsFromTheTopLeft) {
    const Marker marker = board("aprilgrid:36h11:4x3@40mm/12mm");
    ASSERT_EQ(marker.points_mm.size(), 48u);
    EXPECT_EQ(marker.points_mm[0], Eigen::Vector3d(0, 0, 0));
    EXPECT_EQ(marker.points_mm[3], Eigen::Vector3d(92, 0, 0));
    EXPECT_EQ(marker.points_mm[8 * 2 + 1], Eigen::Vector3d(40, 52, 0));
    const auto tags = aprilgrid_tags(4, 3, 40, 12);
    EXPECT_EQ(tags[0].corners_mm[0], Eigen::Vector2d(0, 104));
    EXPECT_EQ(tags[11].corners_mm[2], Eigen::Vector2d(3 * 52 + 40, 40));
}

TEST(CirclesBoard, HasDisksOfItsDiameterAtItsPoints) {
    for (const char* spec : {"circles:7x5@20mm/12mm", "acircles:4x5@17mm/13mm"}) {
        const Marker marker = board(spec);
        ASSERT_EQ(marker.points_mm.size(), spec[0] == 'c' ? 35u : 20u);
        const double cell = marker.grid.cell_mm.x();
        const cv::Mat black = marker.grid.cells < 0.5f;
        cv::Mat labels, stats, centres;
        const int disks = cv::connectedComponentsWithStats(black, labels, stats, centres) - 1;
        EXPECT_EQ(disks, static_cast<int>(marker.points_mm.size()));
        for (int i = 1; i <= disks; ++i) {
            const double area = stats.at<int>(i, cv::CC_STAT_AREA) * cell * cell;
            EXPECT_NEAR(std::sqrt(4 * area / 3.14159265358979), marker.part_mm,
                        2e-3 * marker.part_mm);
            const Eigen::Vector2d centre =
                marker.grid.corner_mm +
                Eigen::Vector2d(centres.at<double>(i, 0) + 0.5, centres.at<double>(i, 1) + 0.5) *
                    cell;
            double nearest = 1e9;
            for (const Eigen::Vector3d& point : marker.points_mm)
                nearest = std::min(nearest, (point.head<2>() - centre).norm());
            EXPECT_LT(nearest, 1e-6);
        }
    }
}

// x = (2 column + row mod 2) spacing, y = row spacing: calib3d's samples.
TEST(CirclesBoard, OfTheAsymmetricKindShiftsEverySecondRow) {
    const Marker marker = board("acircles:4x11@20mm/12mm");
    ASSERT_EQ(marker.points_mm.size(), 44u);
    EXPECT_EQ(marker.points_mm[3], Eigen::Vector3d(120, 0, 0));
    EXPECT_EQ(marker.points_mm[4], Eigen::Vector3d(20, 20, 0));
    EXPECT_EQ(marker.points_mm[43], Eigen::Vector3d(120, 200, 0));
}

TEST(Boards, ThatCannotBeAreRefusedWithTheReason) {
    const std::pair<const char*, const char*> wrong[] = {
        {"charuco:4X4_50:9x6@30mm/30mm", "smaller than the squares"},
        {"charuco:4X4_50:9x6@30mm", "two lengths"},
        {"charuco:4X4_50:9x6@30/22mm", "two lengths"},
        {"charuco:4X4_50:9x6@30mm/22", "must end in mm"},
        {"charuco:4X4_50:30x6@30mm/22mm", "90 tags are needed, but there are 50"},
        {"charuco:4X4_51:9x6@30mm/22mm", "did you mean '4X4_50'"},
        {"charuco:9x6@30mm/22mm", "charuco:DICTIONARY:COLUMNSxROWS"},
        {"charuco:4X4_1000:40x40@30mm/0.003mm", "simple ratio"},
        {"aprilgrid:36h11:0x5@40mm/12mm", "not a number of tags"},
        {"aprilgrid:16h5:6x6@40mm/12mm", "36 tags are needed, but there are 30"},
        {"aprilgrid:Standard41h12:6x6@40mm/12mm", "outside their square"},
        {"circles:7x6@20mm/20mm", "the circles touch"},
        {"acircles:4x11@20mm/28.3mm", "the circles touch"},
        {"circles:7x6@20mm/-12mm", "not a length"},
        {"circles:400x400@20mm/1mm", "too many circles"},
        {"circels:7x6@20mm/12mm", "did you mean 'circles'"},
    };
    for (const auto& [spec, reason] : wrong)
        expect_refused(spec, reason);
}

}  // namespace
}  // namespace etalon
