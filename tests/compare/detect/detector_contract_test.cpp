// What every detector promises (compare/detect/detector.h), on exact renderings of its marker. What
// only one of them does is in the tests of their own.
#include "compare/detect/detector_adaptors.h"
#include "tests/compare/rendered_tags.h"
#include "tests/test.h"

namespace etalon {
namespace {

struct Contract {
    const char* detector;
    const char* marker;
    const char* other;        // of the same kind, with another id or layout
    double largest_error_px;  // of a point: its bias and scatter, some twice of it here
    const char* seen_twice;   // what is said then; empty for a marker without id
};

void PrintTo(const Contract& contract, std::ostream* out) {
    *out << contract.detector;
}

// Boards' ids are those of their tags: seen twice, none of them counts.
const Contract contracts[] = {
    {"apriltag", "apriltag:36h11:5@50mm", "apriltag:36h11:6@50mm", 0.2, "marker 5 is seen 2 times"},
    {"aruco", "aruco:4X4_50:7@50mm", "aruco:4X4_50:8@50mm", 0.5, "marker 7 is seen 2 times"},
    {"stag", "stag:HD21:5@50mm", "stag:HD21:6@50mm", 0.05, "marker 5 is seen 2 times"},
    {"topotag", "topotag:4x4:9283@50mm", "topotag:4x4:9282@50mm", 0.05,
     "marker 9283 is seen 2 times"},
    {"charuco", "charuco:4X4_50:5x4@12mm/9mm", "charuco:5X5_50:5x4@12mm/9mm", 0.02,
     "ids 0 to 9, but not where 5x4 squares"},
    {"chessboard", "chessboard:7x4@8mm", "chessboard:5x4@8mm", 0.02, ""},
    {"aprilgrid", "aprilgrid:36h11:3x2@20mm/6mm", "aprilgrid:25h9:3x2@20mm/6mm", 0.02,
     "marker not found"},
    {"circles", "circles:7x4@8mm/5mm", "circles:6x5@8mm/5mm", 0.02, ""},
    {"squares", "squares:4x3@10mm/7mm", "squares:5x2@10mm/7mm", 0.05, ""},
};

Marker marker_of(const char* spec) {
    return parse_marker(spec, "test");
}

// The marker's middle at (x, y, z), in mm, some 120 px wide or more.
RenderedTag photo_of(const Marker& marker, const Eigen::Vector3d& middle) {
    return render_tag(Renderer(sharp_camera()), marker,
                      board_pose(marker, {0.1, -0.2, 0.3}, middle));
}

class EveryDetector : public testing::TestWithParam<Contract> {
protected:
    const Contract& contract() const { return GetParam(); }
    const Marker marker_ = marker_of(GetParam().marker);
    const std::unique_ptr<Detector> detector_ = make_detector(GetParam().detector, marker_, "test");
};

TEST_P(EveryDetector, FindsItsMarkerAndItsPose) {
    EXPECT_EQ(detector_->name(), contract().detector);
    EXPECT_EQ(make_detector("auto", marker_, "test")->name(), contract().detector);
    const RenderedTag photo = photo_of(marker_, {10, -7, 290});
    const auto [found, reason, several, shown_as] = detector_->detect(photo.image);
    ASSERT_TRUE(found) << reason;
    EXPECT_EQ(reason, "");
    EXPECT_EQ(found->id, marker_.id);
    EXPECT_TRUE(found->is_whole());
    ASSERT_EQ(found->pixels.size(), photo.corners.size());
    EXPECT_LT(largest_error_px(found->pixels, photo.corners), contract().largest_error_px);

    const Projector projector(sharp_camera());
    const auto estimate = estimate_pose(projector, seen_points_mm(marker_, *found), found->pixels);
    ASSERT_TRUE(estimate);
    EXPECT_LT(
        largest_error_px(corners_at(projector, marker_.points_mm, estimate->camera_from_marker),
                         photo.corners),
        contract().largest_error_px);
}

TEST_P(EveryDetector, CountsOnlyTheMarkersOwnId) {
    const RenderedTag photo = photo_of(marker_of(contract().other), {10, -7, 290});
    const Detection detection = detector_->detect(photo.image);
    EXPECT_FALSE(detection.corners);
    EXPECT_THAT(detection.reason, StartsWith("marker not found"));
}

TEST_P(EveryDetector, TakesNeitherOfTwoWithTheSameIdAndSaysSo) {
    if (*contract().seen_twice == '\0')
        GTEST_SKIP() << contract().detector << ": no ids to tell two apart";
    const RenderedTag left = photo_of(marker_, {-70, 5, 300}),
                      right = photo_of(marker_, {70, -5, 300});
    // The white around each yields to the other.
    const CodeImage both{cv::min(left.image.pixels, right.image.pixels), 8};
    EXPECT_TRUE(detector_->detect(left.image).corners);
    EXPECT_TRUE(detector_->detect(right.image).corners);
    const Detection detection = detector_->detect(both);
    EXPECT_FALSE(detection.corners);
    EXPECT_THAT(detection.reason, HasSubstr(contract().seen_twice));
}

TEST_P(EveryDetector, GivesTheSameForTheSameImageWhateverItSawBefore) {
    const RenderedTag photo = photo_of(marker_, {10, -7, 290}),
                      other = photo_of(marker_, {-20, 3, 250});
    const auto first = detector_->detect(photo.image).corners;
    const auto between = detector_->detect(other.image).corners;
    const auto again = detector_->detect(photo.image).corners;
    const auto fresh = make_detector("auto", marker_, "test")->detect(photo.image).corners;
    ASSERT_TRUE(first && between && again && fresh);
    EXPECT_NE(first->pixels, between->pixels);
    EXPECT_EQ(first->pixels, again->pixels);
    EXPECT_EQ(first->pixels, fresh->pixels);
}

TEST_P(EveryDetector, FindsNothingInImagesWithoutContentOrSize) {
    EXPECT_FALSE(detector_->detect({cv::Mat(), 8}).corners);
    for (const cv::Size size : {cv::Size(1, 1), cv::Size(7, 300), cv::Size(9, 9), cv::Size(16, 16),
                                cv::Size(17, 40), cv::Size(700, 3), cv::Size(320, 240)})
        for (const int level : {0, 128, 255}) {
            const Detection detection =
                detector_->detect({cv::Mat(size, CV_8UC1, cv::Scalar(level)), 8});
            EXPECT_FALSE(detection.corners);
            EXPECT_THAT(detection.reason, StartsWith("marker not found"));
        }
    cv::Mat gradient(240, 320, CV_16UC1);
    for (int y = 0; y < gradient.rows; ++y)
        for (int x = 0; x < gradient.cols; ++x)
            gradient.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(100 * x + 50 * y);
    EXPECT_FALSE(detector_->detect({gradient, 16}).corners);
}

TEST_P(EveryDetector, FindsNothingInNoise) {
    for (std::uint64_t i = 0; i < 4; ++i) {
        cv::Mat noise(70, 90, CV_8UC1);
        cv::RNG(i + 1).fill(noise, cv::RNG::UNIFORM, 0, 256);
        EXPECT_FALSE(detector_->detect({noise, 8}).corners);
    }
}

TEST_P(EveryDetector, RefusesMarkersThatItCannotSee) {
    for (const Contract& other : contracts) {
        if (other.detector == std::string(contract().detector))
            continue;
        EXPECT_THROW(make_detector(contract().detector, marker_of(other.marker), "--detector"),
                     ConfigError)
            << other.marker;
    }
}

INSTANTIATE_TEST_SUITE_P(InProcess, EveryDetector, testing::ValuesIn(contracts),
                         [](const auto& one) { return std::string(one.param.detector); });

// Codes are rounded to 1/4095: 1e-4 of the step, and less of a pixel.
TEST(TwelveBitImages, AreSeenAsEightBitOnesAre) {
    for (const auto& [spec, codes_per_code, largest_px] :
         {std::tuple("apriltag:36h11:5@50mm", 4095.0 / 255.0, 1e-9),
          {"stag:HD21:5@50mm", 16.0, 1e-6},
          {"topotag:4x4:9283@50mm", 4095.0 / 255.0, 1e-3}}) {
        const Marker marker = marker_of(spec);
        const RenderedTag photo = render_tag(sharp_camera(), marker, {0.2, 0.1, 0, 3, 5, 300});
        CodeImage deep{{}, 12};
        photo.image.pixels.convertTo(deep.pixels, CV_16U, codes_per_code);
        const auto detector = make_detector("auto", marker, "test");
        const auto eight = detector->detect(photo.image).corners,
                   twelve = detector->detect(deep).corners;
        ASSERT_TRUE(eight && twelve) << spec;
        EXPECT_LT(largest_error_px(twelve->pixels, eight->pixels), largest_px) << spec;
    }
}

// Right of x, nothing is seen.
CodeImage covered_from(const CodeImage& image, int x) {
    CodeImage covered{image.pixels.clone(), image.bits};
    covered.pixels.colRange(x, covered.pixels.cols).setTo(cv::Scalar(120));
    return covered;
}

class CharucoDetector : public testing::Test {
protected:
    const Marker board = marker_of("charuco:4X4_50:9x6@12mm/9mm");
    const RenderedTag photo = photo_of(board, {10, -7, 290});
    const std::unique_ptr<Detector> detector = make_detector("auto", board, "test");
};

TEST_F(CharucoDetector, FindsTheCornersThatAreSeenAndThePoseByThem) {
    const auto found = detector->detect(covered_from(photo.image, 350)).corners;
    ASSERT_TRUE(found);
    EXPECT_FALSE(found->is_whole());
    EXPECT_GT(found->points.size(), 12u);
    EXPECT_LT(found->points.size(), 40u);
    ASSERT_EQ(found->pixels.size(), found->points.size());
    EXPECT_TRUE(std::is_sorted(found->points.begin(), found->points.end()));
    for (std::size_t i = 0; i < found->points.size(); ++i) {
        const auto point = static_cast<std::size_t>(found->points[i]);
        EXPECT_LT((found->pixels[i] - photo.corners.at(point)).norm(), 0.1) << point;
    }
    const auto estimate =
        estimate_pose(Projector(sharp_camera()), seen_points_mm(board, *found), found->pixels);
    ASSERT_TRUE(estimate);
    EXPECT_LT(
        (estimate->camera_from_marker * middle_of(board) - Eigen::Vector3d(10, -7, 290)).norm(),
        0.2);
}

TEST_F(CharucoDetector, NeedsSixCornersOfABoardThatHasThem) {
    const auto leftmost =
        std::ranges::min_element(photo.corners, {}, [](const auto& pixel) { return pixel.x(); });
    const Detection detection =
        detector->detect(covered_from(photo.image, static_cast<int>(leftmost->x()) + 15));
    EXPECT_FALSE(detection.corners);
    EXPECT_THAT(detection.reason, HasSubstr("of its points are seen: 6 of them"));
}

// ---- tag detectors

// AprilTag and ArUco, and what the options of compare/detect/detector_adaptors.h change, on exact
// renderings; at full size: tests/evidence/detector_options.cpp. What every detector promises is in
// detector_contract_test.cpp.

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
    const auto photo = render_tag(sharp_camera(), tag, {0.1, -0.2, 0.3, 10, -7, 300});
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
    const CameraModel camera = camera_with(60, 60, {300.0, 300.0, 29.7, 30.2});
    const auto photo = render_tag(camera, tag, {0, 0, 0.1, 0, 0, 400});
    EXPECT_TRUE(detector_of(tag, window(3))->detect(photo.image).corners);
    EXPECT_FALSE(detector_of(tag, window(30))->detect(photo.image).corners);
}

template <typename Options>
Offsets measured(const char* marker, const Options& options, double side_px, int poses = 20,
                 int least_detected = 19) {
    const Marker tag = parse_marker(marker, "test");
    const auto detector = detector_of(tag, options);
    const Offsets offsets =
        mean_offset(tag_photos(sharp_camera(), tag, poses, side_px / 120.0), *detector);
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
