// Random cameras and scenes for the property tests and the differential fuzzer: a pure function of
// a seed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "bench/stability/stability_case.h"
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

// What must hold for a render of anything: it ends in an image without a flaw or in a refusal.

struct Violation {
    std::string rule, details;
};

struct SceneCheck {
    std::string refusal;  // the message; empty: rendered
    std::vector<Violation> violations;
    std::optional<double> methods_gray;    // largest difference of E and C, if both rendered
    std::optional<double> reference_gray;  // largest difference from the reference beyond 4 s.e.
};

// The renderer of the last camera, kept while the key stays.
class KeptRenderer {
public:
    // Throws as Renderer's constructor does.
    const Renderer& of(const RandomInput& input);

private:
    std::uint64_t key_ = 0;
    std::optional<Renderer> renderer_;
};

// Renders with the automatic plan, E and C, and compares (C only of images blurred by less
// than half a pixel: it samples the lens at a few points); a region alone with the whole's;
// `probes` pixels with the reference (0: none). An exception that is not an Error
// (core/program/errors.h) is let through.
SceneCheck check_scene_of(KeptRenderer& kept, const RandomInput& input, int probes,
                          const ReferenceEffort& effort);

}  // namespace etalon::test
