// AprilTag and ArUco, and what the options of compare/detect/detector_adaptors.h change, on exact
// renderings; at full size: tests/evidence/detector_options.cpp. What every detector promises is in
// detector_contract_test.cpp.

#include "compare/detect/detector_adaptors.h"
#include "tests/compare/rendered_tags.h"
#include "tests/test.h"

namespace etalon {
namespace {

using test::mean_offset;
using test::Offsets;
using test::sharp_camera;

constexpr const char* apriltag = "apriltag:36h11:17@50mm";
constexpr const char* aruco = "aruco:4X4_50:7@50mm";

ArucoOptions window(int half_px) {
    return {ArucoRefinement::subpixel, half_px};
}

std::unique_ptr<Detector> detector_of(const Marker& tag, const ApriltagOptions& options) {
    return make_apriltag_detector(tag, "study.yaml", options);
}

std::unique_ptr<Detector> detector_of(const Marker& tag, const ArucoOptions& options) {
    return make_aruco_detector(tag, "study.yaml", options);
}

template <typename Options>
std::string complaint(const char* marker, const Options& options) {
    return config_error_of([&] { detector_of(parse_marker(marker, "test"), options); });
}

TEST(DetectorOptions, OfAnotherRefinementAreRefused) {
    EXPECT_EQ(complaint(aruco, ArucoOptions{ArucoRefinement::contour, 5}),
              "study.yaml: subpixel_half_window_px: belongs to the detector 'aruco', and this is "
              "'aruco-contour'");
    EXPECT_EQ(complaint(aruco, ArucoOptions{ArucoRefinement::contour}), "no error");
}

TEST(DetectorOptions, OutOfRangeAreRefused) {
    for (const double factor :
         {0.0, -2.0, 0.5, 1.25, 2.5, 9.0, std::nan(""), std::numeric_limits<double>::infinity()})
        EXPECT_NE(complaint(apriltag, ApriltagOptions{factor}), "no error") << factor;
    for (const double factor : {1.0, 1.5, 2.0, 8.0})
        EXPECT_EQ(complaint(apriltag, ApriltagOptions{factor}), "no error") << factor;
    for (const int half_px : {-3, 0, 31})
        EXPECT_NE(complaint(aruco, window(half_px)), "no error") << half_px;
    for (const int half_px : {1, 30})
        EXPECT_EQ(complaint(aruco, window(half_px)), "no error") << half_px;
}

template <typename Options>
std::vector<Eigen::Vector2d> corners(const char* marker, const Options& options) {
    const Marker tag = parse_marker(marker, "test");
    const auto photo = test::render_tag(sharp_camera(), tag, {0.1, -0.2, 0.3, 10, -7, 300});
    return detector_of(tag, options)->detect(photo.image).corners.value().pixels;
}

TEST(DetectorOptions, DefaultsGivenByNameChangeNothing) {
    const auto tag = corners(apriltag, ApriltagOptions{}), marker = corners(aruco, ArucoOptions{});
    EXPECT_EQ(tag, corners(apriltag, ApriltagOptions{1.0, true}));
    EXPECT_EQ(marker, corners(aruco, window(3)));
    EXPECT_NE(tag, corners(apriltag, ApriltagOptions{2.0, true}));
    EXPECT_NE(tag, corners(apriltag, ApriltagOptions{1.0, false}));
    EXPECT_NE(marker, corners(aruco, window(5)));
}

// A tag in an image that cannot hold the window: OpenCV would throw.
TEST(DetectorOptions, SubpixelWindowsLargerThanTheImageFindNothing) {
    const Marker tag = parse_marker(aruco, "test");
    CameraModel camera = sharp_camera();
    camera.width = camera.height = 60;
    camera.intrinsics = {300.0, 300.0, 29.7, 30.2};
    const auto photo = test::render_tag(camera, tag, {0, 0, 0.1, 0, 0, 400});
    EXPECT_TRUE(detector_of(tag, window(3))->detect(photo.image).corners);
    EXPECT_FALSE(detector_of(tag, window(30))->detect(photo.image).corners);
}

template <typename Options>
Offsets measured(const char* marker, const Options& options, double side_px, int poses = 20,
                 int least_detected = 19) {
    const Marker tag = parse_marker(marker, "test");
    const auto detector = detector_of(tag, options);
    const Offsets offsets =
        mean_offset(test::tag_photos(sharp_camera(), tag, poses, side_px / 120.0), *detector);
    EXPECT_GE(offsets.detected, least_detected);
    std::printf("%s: mean offset %+.4f, %+.4f px, inward %+.4f px, %d poses\n",
                detector->name().c_str(), offsets.mean.x(), offsets.mean.y(), offsets.inward,
                offsets.detected);
    return offsets;
}

// Of 20 poses with 4 corners: single ones scatter by 0.08 px with refinement and 0.3 px without, so
// the means by 0.01 and 0.035 px. Releases from 3.4.3 on may well be nearer to zero without.
TEST(DetectorOptions, RefinedEdgesTakeAwayWhatDecimationDoesToCorners) {
    const Offsets unrefined = measured(apriltag, ApriltagOptions{2.0, false}, 60.0),
                  edges = measured(apriltag, ApriltagOptions{2.0, true}, 60.0);
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

// The library's half pixel is undone: without that the mean offset would be +0.5 px in x and in y.
// 40 poses with 4 corners; a corner's own scatter is about 0.05 px, so the mean's standard
// deviation is 0.05 / sqrt(160) = 0.004 px: 0.02 px is five of them.
TEST(ApriltagDetector, HasNoMeanOffset) {
    const Offsets offsets = measured(apriltag, ApriltagOptions{}, 120.0, 40, 38);
    EXPECT_LT(offsets.mean.cwiseAbs().maxCoeff(), 0.02);
}

// The bias that each refinement has, measured and not corrected: a comparison of photograph and
// rendering meets it on both sides. A wrong half pixel would show as an offset of 0.5 px in x and
// in y.
TEST(ArucoDetector, HasTheBiasOfItsRefinement) {
    struct Bias {
        ArucoRefinement refinement;
        double largest_mean, least_inward, largest_inward;
    };
    constexpr double any = 1e9;
    for (const auto& [refinement, mean, least, largest] :
         {Bias{ArucoRefinement::subpixel, 0.03, 0.0, 0.2},
          Bias{ArucoRefinement::none, 0.15, 0.29, 0.79},
          Bias{ArucoRefinement::contour, 0.15, 0.37, 0.97},
          Bias{ArucoRefinement::apriltag, 0.2, -any, any}}) {
        const Offsets offsets = measured(aruco, ArucoOptions{refinement}, 120.0, 40, 36);
        EXPECT_LT(offsets.mean.norm(), mean);
        EXPECT_GT(offsets.inward, least);
        EXPECT_LT(offsets.inward, largest);
    }
}

TEST(MakeDetector, RefusesUnknownNames) {
    const Marker tag = parse_marker(apriltag, "test");
    EXPECT_THROW(make_detector("apriltags", tag, "--detector"), ConfigError);
}

}  // namespace
}  // namespace etalon
