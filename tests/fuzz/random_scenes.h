// Random cameras and scenes for the property tests and the differential fuzzer: a pure function of
// a seed.
#pragma once

#include <cstdint>
#include <string>

#include "sim/render/renderer.h"

namespace etalon::test {

struct RandomInput {
    // Equal keys, equal cameras (making a renderer takes longer than rendering); 0: its own.
    std::uint64_t camera_key = 0;
    CameraModel camera;
    Scene scene;
    double tolerance_gray = 0.1;
    std::string poison;  // the number that was made NaN or infinite; empty: none
};

// What any user may have: a tag some cells wide before an ordinary camera, all numbers in range.
// Small images of 16 to 64 px a side. Sixteen seeds in a row have one camera.
RandomInput ordinary_input(std::uint64_t seed);

// Anything: tilts to and beyond edge-on, focal lengths from 5 px to 500 000 px, f-numbers from 0.95
// to 200, focus from some mm to infinity, distortions that fold, with poles and tilts, markers
// near, far, behind, larger than the image or a fraction of a pixel, several of them, images of 1 x
// 1 px. One in ten has a number that is NaN or infinite.
RandomInput hostile_input(std::uint64_t seed);

}  // namespace etalon::test
