// A board that is seen in part: what takes it, and what needs all of its points.
#include <gtest/gtest.h>

#include "compare/photo_pose.h"
#include "station/qualify/runner.h"

namespace etalon {
namespace {

Detector told(const DetectedCorners& corners) {
    return {"told", [corners](const CodeImage&) { return Detection{corners}; }};
}

CameraModel webcam() {
    return {.width = 640, .height = 480, .intrinsics = {700.0, 705.0, 321.7, 238.2}};
}

const Rigid camera_from_board{rotation_from_vector({0.3, -0.2, 0.5}), {-20.0, -11.0, 400.0}};

// Of a board's points those that are named; all when none is.
DetectedCorners seen(const Marker& board, const std::vector<int>& points) {
    DetectedCorners corners{0, {}, points};
    for (const Eigen::Vector3d& point : seen_points_mm(board, corners))
        corners.pixels.push_back(Projector(webcam()).project(camera_from_board * point).value());
    return corners;
}

TEST(PartialMarker, HasAPoseByThePointsThatAreSeen) {
    const Marker board = parse_marker("charuco:4X4_50:6x5@12mm/9mm", "test");
    Detector detector = told(seen(board, {2, 3, 4, 7, 8, 9, 13}));
    const PhotoPose pose = find_marker("photo.png", {}, detector, Projector(webcam()), board);
    ASSERT_TRUE(pose.estimate) << pose.failure;
    EXPECT_LT(left_difference(camera_from_board, pose.estimate->camera_from_marker).norm(), 1e-6);
}

TEST(PartialMarker, IsNotDetectedWhereMeansOverFramesAreTaken) {
    const Marker board = parse_marker("charuco:4X4_50:6x5@12mm/9mm", "test");
    Detector part = told(seen(board, {2, 3, 4, 7, 8, 9, 13})), whole = told(seen(board, {}));
    FrameRecord partly, wholly;
    detect_frame(part, {}, partly);
    detect_frame(whole, {}, wholly);
    EXPECT_TRUE(partly.corners.empty());
    EXPECT_EQ(partly.detection, "marker seen in part only");
    EXPECT_EQ(wholly.corners.size(), 20u);
    EXPECT_EQ(wholly.detection, "");
}

}  // namespace
}  // namespace etalon
