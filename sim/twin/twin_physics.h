// What the twin's camera sees: the marker on the stage's carriage, through a TRUE camera that may
// differ from the calibration that the station is told. No sockets, no threads, no clock: the twin
// (mocks/) puts it behind real protocols, studies run it in process.
#pragma once

#include "sim/render/renderer.h"

namespace etalon {

// Errors put into a camera on purpose.
struct CameraErrors {
    double focal_length_percent = 0.0;  // fx and fy; > -100
    double k1_percent = 0.0;            // of k1, which must not be 0 to have an effect
    Eigen::Vector2d principal_point_px = Eigen::Vector2d::Zero();  // added to cx, cy
};

// The camera that was calibrated as `told` if the calibration is wrong by these errors.
CameraModel with_errors(const CameraModel& told, const CameraErrors& errors);

// Where camera and marker are mounted, which the station does not know.
struct TwinScene {
    CellGrid marker;
    double background = 1.0;  // radiance everywhere outside the marker's grid
    Rigid camera_from_base;
    Rigid carriage_from_marker;
};

// Safe from every thread once built.
class TwinPhysics {
public:
    // Throws as Renderer and SensorModel do for a camera that cannot exist.
    TwinPhysics(const CameraModel& true_camera, TwinScene scene, RenderMethod method,
                std::uint64_t noise_seed);

    // The picture before the sensor with the carriage there, at the nominal exposure; background
    // where the marker cannot be rendered (behind the lens, through it). Costs one rendering.
    Radiance radiance(const Rigid& base_from_carriage) const;

    // The frame that the sensor makes of it: `exposure` times the nominal light (gain included),
    // saturating, with shot and read noise keyed by (seed, frame, pixel), quantised.
    // exposure >= 0 and finite. About 7 ns a pixel with noise.
    CodeImage expose(const Radiance& radiance, double exposure, std::uint32_t frame) const;

    const CameraModel& camera() const { return renderer_.camera(); }

private:
    Renderer renderer_;
    SensorModel sensor_;
    TwinScene scene_;
    RenderOptions options_;
    std::uint64_t noise_seed_;
};

}  // namespace etalon
