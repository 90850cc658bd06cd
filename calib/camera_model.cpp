#include "calib/camera_model.h"

#include "core/errors.h"

namespace etalon {

ThinLens thin_lens(const CameraModel& camera) {
    if (!camera.lens || !camera.sensor)
        throw NumericalError("a thin lens needs the lens and the sensor section of the camera");
    const Lens& lens = *camera.lens;
    const double v = camera.intrinsics.fx * camera.sensor->pixel_pitch_um * 1e-3;
    const bool usable = std::isfinite(v) && v > 0.0 && lens.focus_distance_mm > 0.0 &&
                        std::isfinite(lens.f_number) && lens.f_number > 0.0;
    if (!usable)
        throw NumericalError(fmt::format(
            "no thin lens has image distance {} mm, focus distance {} mm and f-number {}", v,
            lens.focus_distance_mm, lens.f_number));
    ThinLens thin;
    thin.image_distance_mm = v;
    thin.inverse_focus_per_mm = 1.0 / lens.focus_distance_mm;  // 0 for infinity
    thin.focal_length_mm = 1.0 / (thin.inverse_focus_per_mm + 1.0 / v);
    thin.aperture_diameter_mm = thin.focal_length_mm / lens.f_number;
    thin.working_f_number = v / thin.aperture_diameter_mm;
    return thin;
}

double blur_radius_px(const CameraModel& camera, double z_mm) {
    if (!(z_mm > 0.0))
        throw NumericalError(fmt::format("blur at depth {} mm: not in front of the lens", z_mm));
    if (!camera.lens)
        return 0.0;
    const ThinLens lens = thin_lens(camera);
    const double vergence = std::abs(1.0 / z_mm - lens.inverse_focus_per_mm);
    return camera.intrinsics.fx * lens.aperture_diameter_mm / 2.0 * vergence;
}

}  // namespace etalon
