// Whether a calibration can be used: the image seen, the distortion's limits, contradictions, what
// the renderer will miss. Whether the numbers are right takes photographs (`etalon compare`).
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

struct CameraFinding {
    enum class Weight {
        note,     // good to know
        warning,  // unusual: check it
        fault,    // part of the image cannot be used
    };
    Weight weight = Weight::note;
    std::string about;    // "valid region", "sensor", ...: one of a few words
    std::string message;  // one line
};

struct CameraCheck {
    double horizontal_deg = 0, vertical_deg = 0, diagonal_deg = 0;  // field of view; NaN: no ray
    double horizontal_mm = 0, vertical_mm = 0, diagonal_mm = 0;     // of a telecentric camera
    double image_without_ray = 0.0;  // share of the image that no ray reaches, 0 to 1
    // Smallest ratio of the valid region's border to the radius of the image's edge, along the
    // edge: above 1 the fold, pole or horizon lies outside the image; infinity where none exists.
    double margin = 0.0;
    std::vector<CameraFinding> findings;

    bool has_fault() const;
};

// Fields of view in degrees, telecentric in mm. A wide lens may leave corners without rays if a
// circle as wide as the image has them. Looks at 65 x 65 pixels: some milliseconds. Throws
// NumericalError where Projector does.
CameraCheck check_camera(const CameraModel& camera);

}  // namespace etalon
