// What a camera that was read must be, whatever the file.
#pragma once

#include "calib/camera/camera_model.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {

inline void require_sound(const Lens& lens) {
    require_all_finite(
        std::array{lens.f_number, lens.wavelength_nm, lens.psf.sigma_px, lens.object_na});
    require(lens.focus_distance_mm > 0.0, "a focus distance that is none");
    for (const auto& [radius, density] : lens.psf.profile)
        require_all_finite(std::array{radius, density});
}

inline void require_sound(const Sensor& sensor) {
    require_all_finite(std::array{sensor.pixel_pitch_um, sensor.black_dn, sensor.gain_e_per_dn,
                                  sensor.read_noise_e});
    require_all_finite(sensor.illumination.polynomial);
    require_all_finite(sensor.channel_response);
    require(sensor.bits >= 1 && sensor.bits <= 16, "a sensor of impossible bits");
    for (const auto& [radiance, code] : sensor.transfer.table)
        require_all_finite(std::array{radiance, code});
}

inline void require_sound(const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    require_all_finite(std::array{i.fx, i.fy, i.cx, i.cy});
    require(i.fx > 0.0 && i.fy > 0.0, "a focal length that is not positive");
    require(camera.width >= 0 && camera.height >= 0, "an image of negative size");
    require_all_finite(camera.distortion.coefficients());
    require(is_possible(camera.projection), "a projection that no lens has");
    if (camera.covariance)
        require(camera.covariance->matrix.allFinite() &&
                    (camera.covariance->matrix.diagonal().array() > 0.0).all(),
                "a covariance that is none");
    if (camera.lens)
        require_sound(*camera.lens);
    if (camera.sensor)
        require_sound(*camera.sensor);
}

}  // namespace etalon::test
