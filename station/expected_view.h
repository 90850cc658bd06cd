// What the camera under test should see, if its calibration were true: the marker rendered at a
// pose, through the camera's sensor (transfer curve, black level, bit depth) but without noise, so
// that a detector is given the same kind of image as from the device.
#pragma once

#include "core/image.h"
#include "core/rigid.h"
#include "sim/renderer.h"
#include "sim/sensor_model.h"

namespace etalon {

// Immutable, safe from every thread.
class ExpectedView {
public:
    // `background`: radiance around the marker, whose white is 1. `white_level`: what that white
    // is in the photographs, 1 = full scale.
    ExpectedView(const CameraModel& camera, CellGrid marker, double background, double white_level)
        : renderer_(camera),
          sensor_(camera),
          marker_(std::move(marker)),
          background_(background),
          white_level_(white_level) {}

    // The picture in front of the sensor. Throws what Renderer::render throws.
    Radiance radiance_at(const Rigid& camera_from_marker) const {
        const RenderedImage rendered =
            renderer_.render({{{marker_, camera_from_marker}}, background_});
        return rendered.radiance * white_level_;
    }
    CodeImage codes_of(const Radiance& radiance) const { return sensor_.expose(radiance); }
    CodeImage at(const Rigid& camera_from_marker) const {
        return codes_of(radiance_at(camera_from_marker));
    }

private:
    Renderer renderer_;
    SensorModel sensor_;
    CellGrid marker_;
    double background_, white_level_;
};

}  // namespace etalon
