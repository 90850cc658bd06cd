// The scenes on which every method is measured, by name: a webcam focused near (blurred) and at 1 m
// (sharp), a 5-megapixel camera with strong distortion, and three wide lenses. The published method
// knows no wide lens.
//
// All show AprilTag 36h11 id 0 with its white border, tilted by 30 degrees about an axis at 35
// degrees in the image plane after a turn of 20 degrees in its own; the tag's centre projects to a
// given pixel, or before a wide lens lies in a given direction, which its tilt is to.
#pragma once

#include "sim/render/renderer.h"

namespace etalon {

// And without sensor.
CameraModel camera_without_lens(int width, int height, const Intrinsics& intrinsics,
                                const Distortion& distortion = {},
                                const LensProjection& projection = {});

struct BenchmarkScene {
    std::string name;  // "webcam-500", "sharp-1000", "canon-900", ...
    CameraModel camera;
    Scene scene;
};

// webcam-500, -1000, -1500, sharp-500, -1000, -1500, focus-152 (the plane of focus passes through
// the tag), canon-500, -900, and by the angle to the axis fisheye-10, -60, -95 (behind the lens),
// fisheye-near (a tag that spans 100 degrees), omni-50 and sphere-88 (sharp), in this order.
std::vector<BenchmarkScene> benchmark_scenes();

// Throws ConfigError for a name that is not among them.
BenchmarkScene benchmark_scene(const std::string& name);

}  // namespace etalon
