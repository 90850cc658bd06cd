// What every detector promises (compare/detect/detector.h), on exact renderings of its marker. What
// only one of them does is in the tests of their own.

#include "tests/compare/rendered_targets.h"
#include "tests/test.h"

namespace etalon {
namespace {

using test::largest_error_px;
using test::RenderedTag;
using test::sharp_camera;

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
    return test::render_tag(Renderer(sharp_camera()), marker,
                            test::board_pose(marker, {0.1, -0.2, 0.3}, middle));
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
    EXPECT_LT(largest_error_px(
                  test::corners_at(projector, marker_.points_mm, estimate->camera_from_marker),
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
        const RenderedTag photo =
            test::render_tag(sharp_camera(), marker, {0.2, 0.1, 0, 3, 5, 300});
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
    EXPECT_LT((estimate->camera_from_marker * test::middle_of(board) - Eigen::Vector3d(10, -7, 290))
                  .norm(),
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

}  // namespace
}  // namespace etalon
