// The marker rendered at a pose as a calibration says it looks, through the camera's sensor
// (transfer curve, black level, bit depth), and what a detector makes of it.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <cstdint>

#include "compare/pose/pose.h"
#include "sim/render/renderer.h"

namespace etalon {

// A camera before a marker, and the detector that is to find it.
struct ExpectedScene {
    CameraModel camera;
    Marker marker;
    std::string detector = "auto";
    double background = 1.0;   // radiance around the marker, whose white is 1
    double white_level = 1.0;  // of the marker's white in the photographs, 1 = full scale
};

bool states_noise(const CameraModel& camera);

// Whether the renderer takes the marker there: before a wide lens it has an end.
bool is_rendered(const CellGrid& marker, const Rigid& camera_from_marker,
                 const CameraModel& camera);

// Immutable, safe from every thread.
class ExpectedView {
public:
    // Of the renders. With 0.1 gray it would be a third of a good run's U.
    static constexpr double tolerance_gray = 0.02;

    explicit ExpectedView(const ExpectedScene& scene);

    // The picture in front of the sensor. Throws what Renderer::render throws.
    RenderedPart radiance_at(const Rigid& camera_from_marker) const;

    // As the sensor has it, without noise.
    CodeImage at(const Rigid& camera_from_marker) const;

    // The pixels that a detector needs: the marker with a margin, in steps of 16 px, a multiple of
    // the tiles in which detectors take their thresholds.
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

// One view to be exposed and detected many times. Safe from every thread, with a detector for each.
class ExpectedExposures {
public:
    // Throws what Renderer::render throws. `view` must outlive it.
    ExpectedExposures(const ExpectedView& view, const Rigid& camera_from_marker);

    CodeImage without_noise() const { return sensor_.expose(whole_); }
    std::optional<DetectedCorners> without_noise(Detector& detector) const;

    // With the noise that the calibration states, in the marker's area alone: the rest would take
    // most of the time.
    std::optional<DetectedCorners> with_noise(Detector& detector, const NoiseKey& noise) const;

private:
    const SensorModel& sensor_;
    RenderedPart whole_, area_;
};

// The corners in renders that B3 compares the photographs' corners with. Noise moves a detector's
// corners systematically (AprilTag's in the demo by 0.02 px). So renders are exposed several times
// with the noise that the calibration states, and the mean is taken; without stated noise once.
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

    // From the scatter of these exposures. Nothing without noise, or where it is not detected in
    // two.
    std::optional<CornerNoise> noise_at(const Rigid& camera_from_marker) const;

    // In the order of Marker::points_mm; nothing unless the whole marker is detected in most
    // exposures. Depends on scene and pose alone. Exposures are detected in parallel; safe from
    // every thread. Throws what Renderer::render throws.
    std::optional<ImagePoints> at(const Rigid& camera_from_marker) const;

private:
    std::vector<std::optional<DetectedCorners>> exposed_at(const Rigid& camera_from_marker) const;

    ExpectedView view_;
    // One a thread and not one an exposure: libapriltag's takes 20 MB.
    mutable tbb::enumerable_thread_specific<std::unique_ptr<Detector>> detectors_;
    int frames_, exposures_;
    std::uint64_t seed_;
};

}  // namespace etalon
