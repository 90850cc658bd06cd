// Where a detector finds the marker in what the camera under test should see: what B3 compares the
// photographs' corners with.
//
// Noise moves a detector's corners, and always the same way: the lines that AprilTag fits to the
// demo's photographs lie 0.02 px apart from those of images without noise. More frames do not
// average that out. So renders are given the noise that the calibration states, in several
// exposures, and the corners' mean is taken. A calibration without noise gets one exposure without.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "compare/detect/detector.h"
#include "compare/expect/expected_view.h"

namespace etalon {

class RenderedCorners {
public:
    // Of a render for each frame of a photographed pose: noise adds a fifth to the variance of the
    // difference.
    static constexpr int exposures_per_frame = 5;

    // `frames`: of a photographed pose. `seed`: of the noise.
    RenderedCorners(const ExpectedScene& scene, int frames, std::uint64_t seed);

    const ExpectedView& view() const { return view_; }

    // Variance of these corners by noise, in units of that of a pose's mean over its frames.
    static double noise_ratio(const CameraModel& camera);

    // How far noise leaves the corners of these exposures apart: of a coordinate in the mean over a
    // pose's frames. Nothing without noise, or where it is not detected in two.
    struct Noise {
        double variance_px2 = 0.0, degrees_of_freedom = 0.0;
    };
    std::optional<Noise> noise_at(const Rigid& camera_from_marker) const;

    // In the order of Marker::points_mm; nothing when the whole marker is not detected in most of
    // the exposures. A pure function of scene and pose, which are seen in parallel. Safe from every
    // thread. Throws what Renderer::render throws.
    std::optional<std::vector<Eigen::Vector2d>> at(const Rigid& camera_from_marker) const;

private:
    std::vector<std::optional<DetectedCorners>> exposed_at(const Rigid& camera_from_marker) const;

    ExpectedView view_;
    // One a thread and not one an exposure: libapriltag's takes 20 MB.
    mutable tbb::enumerable_thread_specific<std::unique_ptr<Detector>> detectors_;
    int frames_, exposures_;
    std::uint64_t seed_;
};

}  // namespace etalon
