// What the camera under test should see if its calibration were true: the marker rendered at a
// pose, through the camera's sensor (transfer curve, black level, bit depth).
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <cstdint>
#include <memory>

#include "compare/detect/detector.h"
#include "sim/render/renderer.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {

// A camera before a marker, and the detector that is to find it.
struct ExpectedScene {
    CameraModel camera;
    Marker marker;
    std::string detector = "auto";
    double background = 1.0;   // radiance around the marker, whose white is 1
    double white_level = 1.0;  // of the marker's white in the photographs, 1 = full scale
};

// Whether the calibration states the sensor's noise.
bool states_noise(const CameraModel& camera);

// Whether the renderer takes the marker there: before a wide lens it has an end.
bool is_rendered(const CellGrid& marker, const Rigid& camera_from_marker,
                 const CameraModel& camera);

// Immutable, safe from every thread.
class ExpectedView {
public:
    // Of the renders: where everything else is well, a tolerance of 0.1 gray is a third of U.
    static constexpr double tolerance_gray = 0.02;

    explicit ExpectedView(const ExpectedScene& scene);

    // The picture in front of the sensor. Throws what Renderer::render throws.
    RenderedPart radiance_at(const Rigid& camera_from_marker) const;

    // As the sensor has it, without noise.
    CodeImage at(const Rigid& camera_from_marker) const;

    // The pixels in which a detector sees all that it looks at: the marker with a margin, in steps
    // of 16 px, a multiple of the tiles in which detectors take their thresholds.
    cv::Rect area_of(const Rigid& camera_from_marker) const;

    bool takes(const Rigid& camera_from_marker) const {
        return is_rendered(marker_, camera_from_marker, projector_.camera());
    }

    const SensorModel& sensor() const { return sensor_; }

private:
    Renderer renderer_;
    Projector projector_;
    SensorModel sensor_;
    CellGrid marker_;
    double background_, white_level_;
};

// One expected view, to be exposed and detected any number of times. Safe from every thread, with a
// detector for each.
class ExpectedExposures {
public:
    // Throws what Renderer::render throws. `view` must outlive it.
    ExpectedExposures(const ExpectedView& view, const Rigid& camera_from_marker);

    // The whole image without noise, and the marker in it.
    CodeImage without_noise() const { return sensor_.expose(whole_); }
    std::optional<DetectedCorners> without_noise(Detector& detector) const;

    // With the noise that the calibration states. Only the marker's area is exposed and searched:
    // the rest is background, and would take most of the time.
    std::optional<DetectedCorners> with_noise(Detector& detector, const NoiseKey& noise) const;

private:
    const SensorModel& sensor_;
    RenderedPart whole_, area_;
};

// Where a detector finds the marker in what the camera under test should see: what B3 compares the
// photographs' corners with.
//
// Noise moves a detector's corners systematically (AprilTag's lines in the demo by 0.02 px), and
// more frames do not average that out. So renders are exposed several times with the noise that the
// calibration states, and the corners' mean is taken; without stated noise once.
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
    // the exposures. A pure function of scene and pose. Exposures are detected in parallel; safe
    // from every thread. Throws what Renderer::render throws.
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
