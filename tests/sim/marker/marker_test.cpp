#include "sim/marker/marker.h"

#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>

#include <opencv2/core/version.hpp>
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 407
#include <opencv2/objdetect/aruco_detector.hpp>
#else
#include <opencv2/aruco.hpp>
#endif
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "core/image/image.h"
#include "sim/marker/tag_pattern.h"
#include "tests/sim/marker/marker_checks.h"

namespace etalon {
namespace {

constexpr int px_per_cell = 20;
constexpr int surround_px = 60;

// The cells magnified on a white page, and where the marker's points then are: pixel centres at
// integers, so that the page's edge is at -0.5.
struct Enlarged {
    cv::Mat image;
    std::vector<cv::Point2d> points;
};

Enlarged enlarge(const Marker& marker) {
    Enlarged enlarged;
    cv::Mat cells;
    marker.grid.cells.convertTo(cells, CV_8U, 255.0);
    cv::resize(cells, cells, {}, px_per_cell, px_per_cell, cv::INTER_NEAREST);
    cv::copyMakeBorder(cells, enlarged.image, surround_px, surround_px, surround_px, surround_px,
                       cv::BORDER_CONSTANT, cv::Scalar::all(255));
    for (const Eigen::Vector3d& point : marker.points_mm) {
        const double u = (point.x() - marker.grid.corner_mm.x()) / marker.grid.cell_mm.x();
        const double v = (point.y() - marker.grid.corner_mm.y()) / marker.grid.cell_mm.y();
        enlarged.points.emplace_back(surround_px - 0.5 + px_per_cell * u,
                                     surround_px - 0.5 + px_per_cell * v);
    }
    return enlarged;
}

// A quarter turn clockwise of the page takes (x, y) to (height - 1 - y, x).
Enlarged quarter_turned(const Enlarged& upright) {
    Enlarged turned;
    cv::rotate(upright.image, turned.image, cv::ROTATE_90_CLOCKWISE);
    for (const cv::Point2d& p : upright.points)
        turned.points.emplace_back(upright.image.rows - 1 - p.y, p.x);
    return turned;
}

void expect_points(const std::vector<cv::Point2d>& found, const std::vector<cv::Point2d>& expected,
                   double tolerance_px) {
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i)
        EXPECT_LT(cv::norm(found[i] - expected[i]), tolerance_px)
            << "point " << i << ": found " << found[i] << ", expected " << expected[i];
}

// Upright and turned by a quarter, alone and with its points as corners.
template <class Detect>
void expect_seen(const Marker& marker, Detect detect, double tolerance_px) {
    const Enlarged upright = enlarge(marker);
    for (const Enlarged& page : {upright, quarter_turned(upright)}) {
        const std::vector<SeenTag> found = detect(page.image);
        ASSERT_EQ(found.size(), 1u) << marker.spec;
        EXPECT_EQ(found[0].id, marker.id) << marker.spec;
        expect_points(found[0].corners, page.points, tolerance_px);
    }
}

struct Family {
    const char* name;
    apriltag_family_t* (*create)();
    void (*destroy)(apriltag_family_t*);
};

void PrintTo(const Family& family, std::ostream* out) {
    *out << family.name;
}

class AprilTagFamily : public testing::TestWithParam<Family> {};

TEST_P(AprilTagFamily, IsFoundByItsLibraryWithTheCornersWhereItsPointsAre) {
    const int last = apriltag_count(GetParam().name) - 1;
    apriltag_family_t* family = GetParam().create();
    for (const int id : {0, 7, last}) {
        const Marker marker =
            parse_marker(fmt::format("apriltag:{}:{}@52.5mm", GetParam().name, id), "--marker");
        expect_seen(
            marker, [&](const cv::Mat& image) { return seen_apriltags(family, image); }, 0.5);
    }
    GetParam().destroy(family);
}

TEST_P(AprilTagFamily, HasTheCellsThatItsLibraryDraws) {
    apriltag_family_t* table = GetParam().create();
    const int id = 5;
    image_u8_t* drawn = apriltag_to_image(table, id);
    const TagPattern pattern = apriltag_pattern(GetParam().name, id);
    const int frame = (pattern.cells.cols - drawn->width) / 2;
    int differences = 0;
    for (int y = 0; y < drawn->height; ++y) {
        for (int x = 0; x < drawn->width; ++x)
            differences += (drawn->buf[y * drawn->stride + x] != 0) !=
                           (pattern.cells.at<float>(y + frame, x + frame) == 1.0f);
    }
    // What a family leaves open is black in the library's drawing and white here.
    const int ring = 4 * (table->width_at_border - 1) + 4 * (table->width_at_border + 1);
    const int open = drawn->width * drawn->height - ring - static_cast<int>(table->nbits);
    EXPECT_EQ(differences, open);
    std::free(drawn->buf);  // image_u8_destroy() is declared, but Debian does not export it
    std::free(drawn);
    GetParam().destroy(table);
}

INSTANTIATE_TEST_SUITE_P(
    Every, AprilTagFamily,
    testing::Values(Family{"16h5", tag16h5_create, tag16h5_destroy},
                    Family{"25h9", tag25h9_create, tag25h9_destroy},
                    Family{"36h10", tag36h10_create, tag36h10_destroy},
                    Family{"36h11", tag36h11_create, tag36h11_destroy},
                    Family{"Circle21h7", tagCircle21h7_create, tagCircle21h7_destroy},
                    Family{"Circle49h12", tagCircle49h12_create, tagCircle49h12_destroy},
                    Family{"Custom48h12", tagCustom48h12_create, tagCustom48h12_destroy},
                    Family{"Standard41h12", tagStandard41h12_create, tagStandard41h12_destroy},
                    Family{"Standard52h13", tagStandard52h13_create, tagStandard52h13_destroy}),
    [](const auto& chosen) { return std::string(chosen.param.name); });

std::vector<SeenTag> detect_aruco(int dictionary_number, const cv::Mat& image) {
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 407
    cv::aruco::DetectorParameters parameters;
    parameters.cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
    const cv::aruco::ArucoDetector detector(cv::aruco::getPredefinedDictionary(dictionary_number),
                                            parameters);
    detector.detectMarkers(image, corners, ids);
#else
    const auto parameters = cv::aruco::DetectorParameters::create();
    parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
    cv::aruco::detectMarkers(image, cv::aruco::getPredefinedDictionary(dictionary_number), corners,
                             ids, parameters);
#endif
    std::vector<SeenTag> detections;
    for (std::size_t i = 0; i < ids.size(); ++i)
        detections.push_back({ids[i], {corners[i].begin(), corners[i].end()}});
    return detections;
}

class ArucoDictionary : public testing::TestWithParam<int> {};

TEST_P(ArucoDictionary, IsFoundByOpenCvWithTheCornersWhereItsPointsAre) {
    const std::string dictionary = aruco_dictionaries()[GetParam()];
    const int last = aruco_count(dictionary) - 1;
    // The last code of the original set is its own half turn: see the test below.
    for (const int id : {1, 7, dictionary == "ARUCO_ORIGINAL" ? last - 1 : last}) {
        const Marker marker =
            parse_marker(fmt::format("aruco:{}:{}@31mm", dictionary, id), "--marker");
        expect_seen(
            marker, [](const cv::Mat& image) { return detect_aruco(GetParam(), image); }, 1.0);
    }
}

INSTANTIATE_TEST_SUITE_P(Every, ArucoDictionary,
                         testing::Range(0, static_cast<int>(aruco_dictionaries().size())),
                         [](const auto& chosen) { return aruco_dictionaries()[chosen.param]; });

TEST(ArucoOriginal, HasOneCodeThatLooksTheSameAfterHalfATurnAndIsRefused) {
    const cv::Mat cells = aruco_pattern("ARUCO_ORIGINAL", 1023).cells;
    cv::Mat turned;
    cv::rotate(cells, turned, cv::ROTATE_180);
    EXPECT_EQ(cv::countNonZero(cells != turned), 0);
    expect_refused("aruco:ARUCO_ORIGINAL:1023@31mm", "after half a turn");
}

TEST(Chessboard, IsFoundByOpenCvWithItsCornersRowByRowFromTheOrigin) {
    const Marker marker = parse_marker("chessboard:9x6@25mm", "--marker");
    EXPECT_EQ(marker.columns, 9);
    EXPECT_EQ(marker.rows, 6);
    EXPECT_EQ(marker.points_mm[0], Eigen::Vector3d(0, 0, 0));
    EXPECT_EQ(marker.points_mm[1], Eigen::Vector3d(25, 0, 0));
    EXPECT_EQ(marker.points_mm[9], Eigen::Vector3d(0, 25, 0));
    const Enlarged upright = enlarge(marker);
    for (const Enlarged& page : {upright, quarter_turned(upright)}) {
        std::vector<cv::Point2f> corners;
        ASSERT_TRUE(cv::findChessboardCorners(page.image, {9, 6}, corners));
        expect_points({corners.begin(), corners.end()}, page.points, 1.0);
    }
}

TEST(Chessboard, HasABlackSquareBeforeItsFirstCornerAndAMarginOfOneSquare) {
    const CellGrid grid = parse_marker("chessboard:7x5@20mm", "--marker").grid;
    EXPECT_EQ(grid.columns(), 10);
    EXPECT_EQ(grid.rows(), 8);
    EXPECT_EQ(grid.corner_mm, Eigen::Vector2d(-40, -40));
    EXPECT_EQ(grid.cells.at<float>(1, 1), 0.0f);
    EXPECT_EQ(grid.cells.at<float>(1, 2), 1.0f);
    EXPECT_EQ(grid.cells.at<float>(2, 1), 1.0f);
    EXPECT_EQ(grid.cells.at<float>(2, 2), 0.0f);
    EXPECT_EQ(cv::countNonZero(1.0 - grid.cells), 8 * 6 / 2);
}

TEST(Marker, MeasuresATagByItsReferenceSquare) {
    const Marker classic = parse_marker("apriltag:36h11:5@50mm", "--marker");
    EXPECT_EQ(classic.grid.columns(), 10);
    EXPECT_DOUBLE_EQ(classic.grid.corner_mm.x(), -31.25);
    EXPECT_EQ(classic.points_mm[1], Eigen::Vector3d(25, -25, 0));
    EXPECT_EQ(classic.family, "36h11");
    EXPECT_EQ(classic.id, 5);
    // 9 cells with 5 inside the reported square, and the white frame: 11 cells of 10 mm.
    const Marker standard = parse_marker("apriltag:Standard41h12:5@50mm", "--marker");
    EXPECT_EQ(standard.grid.columns(), 11);
    EXPECT_DOUBLE_EQ(standard.grid.corner_mm.y(), -55.0);
}

TEST(Bitmap, TakesItsPixelsAsCellsOfLinearRadiance) {
    const TemporaryFolder folder;
    const auto path = folder / "marker@cells.png";
    write_image(path, {(cv::Mat_<std::uint8_t>(2, 3) << 0, 51, 255, 102, 153, 204), 8});
    const Marker marker = parse_marker("bitmap:" + path.string() + "@60x50mm", "--marker");
    EXPECT_EQ(marker.grid.corner_mm, Eigen::Vector2d(-30, -25));
    EXPECT_EQ(marker.grid.cell_mm, Eigen::Vector2d(20, 25));
    EXPECT_FLOAT_EQ(marker.grid.cells.at<float>(0, 1), 0.2f);
    EXPECT_FLOAT_EQ(marker.grid.cells.at<float>(1, 0), 0.4f);
    EXPECT_TRUE(marker.points_mm.empty());
    write_image(path, {(cv::Mat_<std::uint16_t>(1, 2) << 65535, 13107), 16});
    const Marker deep = parse_marker("bitmap:" + path.string() + "@60x50mm", "--marker");
    EXPECT_FLOAT_EQ(deep.grid.cells.at<float>(0, 1), 0.2f);
}

TEST(Marker, NamesTheFileThatItIsMadeFrom) {
    const TemporaryFolder folder;
    const auto path = folder / "marker@cells.png";
    write_image(path, {(cv::Mat_<std::uint8_t>(1, 2) << 0, 255), 8});
    EXPECT_EQ(marker_file(parse_marker("bitmap:" + path.string() + "@60x50mm", "")), path);
    EXPECT_EQ(marker_file(parse_marker("apriltag:36h11:5@50mm", "")), "");
    EXPECT_EQ(marker_file(parse_marker("stag:HD23:0@50mm", "")), "");
}

TEST(Marker, RefusesWhatItCannotDrawAndSaysWhy) {
    expect_refused("apriltag:36h111:5@50mm", "did you mean '36h11'");
    expect_refused("apriltag:36h11:587@50mm", "those are 0 to 586");
    expect_refused("apriltag:36h11:-1@50mm", "those are 0 to 586");
    expect_refused("apriltag:36h11:5x@50mm", "'5x' is not an id");
    expect_refused("apriltag:36h11@50mm", "apriltag:FAMILY:ID@SIZEmm");
    expect_refused("aruco:4X4_51:7@50mm", "did you mean '4X4_50'");
    expect_refused("apriltag:36h11:5@50", "must end in mm");
    expect_refused("apriltag:36h11:5@50cm", "must end in mm");
    expect_refused("apriltag:36h11:5@0mm", "not a length above 0");
    expect_refused("apriltag:36h11:5@-5mm", "not a length above 0");
    expect_refused("apriltag:36h11:5@nanmm", "not a length above 0");
    expect_refused("apriltag:36h11:5@infmm", "not a length above 0");
    expect_refused("chessboard:9@25mm", "form AxB");
    expect_refused("chessboard:9x1@25mm", "number of inner corners");
    expect_refused("chessboard:9x99999999@25mm", "number of inner corners");
    expect_refused("bitmap:/nowhere.png@5x7mm", "no such file");
    expect_refused("apritag:36h11:5@50mm", "did you mean 'apriltag'");
    expect_refused("50mm", "KIND:WHAT@SIZEmm");
    expect_refused("", "KIND:WHAT@SIZEmm");
    expect_refused("@:", "KIND:WHAT@SIZEmm");
}

// Boards of other tools are refused by name, with what there is.
TEST(Markers, OfKindsThatAreUnknownAreRefusedWithThoseThereAre) {
    for (const char* name : {"ecocheck:9x7n1@30mm", "charucodiamond:4X4_50@30mm/20mm",
                             "random-dot:1@50mm", "kalibr aprilgrid:6x6@88mm", "ecocheck_9x7n1"})
        for (const std::string& words :
             {std::string(name), std::string("the kinds are apriltag, aruco, topotag, stag, "
                                             "chessboard, charuco, charuco-legacy, aprilgrid, "
                                             "circles, acircles, hexcircles, squares, bitmap")})
            expect_refused(name, words);
}

}  // namespace
}  // namespace etalon
