// What the options of compare/detect/detector.h change, on exact renderings; at full size:
// tests/evidence/detector_options.cpp.
#include <gtest/gtest.h>

#include <limits>

#include "compare/detect/detector.h"
#include "core/errors.h"
#include "rendered_tags.h"

namespace etalon {
namespace {

using test::mean_offset;
using test::Offsets;
using test::sharp_camera;

constexpr const char* apriltag = "apriltag:36h11:17@50mm";
constexpr const char* aruco = "aruco:4X4_50:7@50mm";

DetectorOptions decimated(double factor) {
    DetectorOptions options;
    options.quad_decimate = factor;
    return options;
}

DetectorOptions refined(bool refine_edges) {
    DetectorOptions options;
    options.refine_edges = refine_edges;
    return options;
}

DetectorOptions window(int half_px) {
    DetectorOptions options;
    options.subpixel_half_window_px = half_px;
    return options;
}

// The message, or "" when nothing is wrong.
std::string complaint(const char* name, const char* marker, const DetectorOptions& options) {
    try {
        make_detector(name, parse_marker(marker, "test"), "study.yaml", options);
    } catch (const ConfigError& error) {
        return error.what();
    }
    return "";
}

TEST(DetectorOptions, OfAnotherDetectorAreRefused) {
    EXPECT_EQ(complaint("aruco", aruco, decimated(2)),
              "study.yaml: quad_decimate: belongs to the detector 'apriltag', and this is 'aruco'");
    EXPECT_EQ(complaint("auto", apriltag, window(5)),
              "study.yaml: subpixel_half_window_px: belongs to the detector 'aruco', and this is "
              "'apriltag'");
    EXPECT_NE(complaint("aruco-apriltag", aruco, refined(true)), "");
    EXPECT_NE(complaint("aruco-contour", aruco, window(5)), "");
    for (const char* marker : {"stag:HD21:5@50mm", "topotag:4x4:9283@50mm", "chessboard:7x4@8mm",
                               "charuco:4X4_50:5x4@12mm/9mm"}) {
        EXPECT_EQ(complaint("auto", marker, {}), "");
        EXPECT_NE(complaint("auto", marker, decimated(1)), "") << marker;
    }
}

TEST(DetectorOptions, OutOfRangeAreRefused) {
    for (const double factor :
         {0.0, -2.0, 0.5, 1.25, 2.5, 9.0, std::nan(""), std::numeric_limits<double>::infinity()})
        EXPECT_NE(complaint("apriltag", apriltag, decimated(factor)), "") << factor;
    for (const double factor : {1.0, 1.5, 2.0, 8.0})
        EXPECT_EQ(complaint("apriltag", apriltag, decimated(factor)), "") << factor;
    for (const int half_px : {-3, 0, 31})
        EXPECT_NE(complaint("aruco", aruco, window(half_px)), "") << half_px;
    for (const int half_px : {1, 30})
        EXPECT_EQ(complaint("auto", aruco, window(half_px)), "") << half_px;
}

std::vector<Eigen::Vector2d> corners(const char* marker, const DetectorOptions& options) {
    const Marker tag = parse_marker(marker, "test");
    const auto photo = test::render_tag(sharp_camera(), tag, {0.1, -0.2, 0.3, 10, -7, 300});
    return make_detector("auto", tag, "test", options)->detect(photo.image).value().pixels;
}

TEST(DetectorOptions, DefaultsGivenByNameChangeNothing) {
    DetectorOptions defaults = decimated(1);
    defaults.refine_edges = true;
    EXPECT_EQ(corners(apriltag, {}), corners(apriltag, defaults));
    EXPECT_EQ(corners(aruco, {}), corners(aruco, window(3)));
    EXPECT_NE(corners(apriltag, {}), corners(apriltag, decimated(2)));
    EXPECT_NE(corners(apriltag, {}), corners(apriltag, refined(false)));
    EXPECT_NE(corners(aruco, {}), corners(aruco, window(5)));
}

// A tag in an image that cannot hold the window: OpenCV would throw.
TEST(DetectorOptions, SubpixelWindowsLargerThanTheImageFindNothing) {
    const Marker tag = parse_marker(aruco, "test");
    CameraModel camera = sharp_camera();
    camera.width = camera.height = 60;
    camera.intrinsics = {300.0, 300.0, 29.7, 30.2};
    const auto photo = test::render_tag(camera, tag, {0, 0, 0.1, 0, 0, 400});
    EXPECT_TRUE(make_detector("auto", tag, "test", window(3))->detect(photo.image));
    EXPECT_FALSE(make_detector("auto", tag, "test", window(30))->detect(photo.image));
}

Offsets measured(const char* marker, const DetectorOptions& options, double side_px) {
    constexpr int poses = 20;
    const Marker tag = parse_marker(marker, "test");
    const auto detector = make_detector("auto", tag, "test", options);
    const Offsets offsets =
        mean_offset(test::tag_photos(sharp_camera(), tag, poses, side_px / 120.0), *detector);
    EXPECT_GE(offsets.detected, poses - 1);
    return offsets;
}

// Of 20 poses with 4 corners: single ones scatter by 0.08 px with refinement and 0.3 px without, so
// the means by 0.01 and 0.035 px. Releases from 3.4.3 on may well be nearer to zero without.
TEST(DetectorOptions, RefinedEdgesTakeAwayWhatDecimationDoesToCorners) {
    DetectorOptions coarse = decimated(2), fine = decimated(2);
    coarse.refine_edges = false;
    fine.refine_edges = true;
    const Offsets unrefined = measured(apriltag, coarse, 60.0),
                  edges = measured(apriltag, fine, 60.0);
    EXPECT_GT(unrefined.rms, 2.0 * edges.rms);
    EXPECT_LT(edges.rms, 0.15);
    EXPECT_LT(edges.mean.cwiseAbs().maxCoeff(), 0.05);
}

// On a tag of 30 px and six cells the window of 17 px holds three cells, that of 7 px one.
TEST(DetectorOptions, SubpixelWindowsThatHoldMoreThanTheCornerMissIt) {
    EXPECT_LT(measured(aruco, window(3), 30.0).rms, 0.3);
    EXPECT_GT(measured(aruco, window(8), 30.0).rms, 0.5);
    EXPECT_LT(measured(aruco, window(8), 60.0).rms, 0.4);
}

}  // namespace
}  // namespace etalon
