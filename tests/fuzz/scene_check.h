// What must hold for a render of anything: it ends in an image without a flaw or in a refusal.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "bench/stability/stability_case.h"
#include "sim/render/renderer.h"
#include "tests/fuzz/random_scenes.h"

namespace etalon::test {

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
