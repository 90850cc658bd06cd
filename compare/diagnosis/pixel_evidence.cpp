#include "compare/diagnosis/pixel_evidence.h"

#include <algorithm>
#include <cmath>

namespace etalon {

PixelInformation deviation_prior() {
    const PixelDeviation deviations{1.0, 0.01, 4.0, 1.0, 1.0};
    return deviations.cwiseAbs2().cwiseInverse().asDiagonal();
}

CameraModel with_lens(const CameraModel& camera, const PixelDeviation& deviating) {
    CameraModel changed = camera;
    if (!camera.lens)
        return changed;
    changed.lens->f_number *= std::exp(deviating[deviation::f_number]);
    const double inverse =
        1.0 / camera.lens->focus_distance_mm + deviating[deviation::inverse_focus];
    changed.lens->focus_distance_mm = 1.0 / std::max(inverse, 0.0);
    return changed;
}

bool is_common(int photos, const std::vector<std::vector<PhotoFinding>>& findings) {
    constexpr double often = 0.05;
    constexpr int least = 2;
    return photos >= least && photos > often * static_cast<double>(findings.size());
}

bool is_overexposed(const std::vector<std::vector<PhotoFinding>>& findings) {
    const auto saturated = std::ranges::count_if(findings, [](const auto& of_photo) {
        return std::ranges::find(of_photo, "saturated", &PhotoFinding::name) != of_photo.end();
    });
    return is_common(static_cast<int>(saturated), findings);
}

double blur_sigma_px(const CameraModel& camera, double depth_mm, const PixelDeviation& deviating) {
    constexpr double box_px2 = 1.0 / 12.0, unknown_px = 0.5, airy = 0.42;
    if (!camera.lens)
        return unknown_px;
    const CameraModel changed = with_lens(camera, deviating);
    const double radius = blur_radius_px(changed, depth_mm);
    double variance = box_px2 + radius * radius / 4.0 + deviating[deviation::blur];
    const PointSpread& psf = changed.lens->psf;
    if (psf.kind == PointSpread::Kind::gaussian || psf.kind == PointSpread::Kind::measured)
        variance += psf.sigma_px * psf.sigma_px;
    else
        variance += std::pow(airy * changed.lens->wavelength_nm * 1e-3 * working_f_number(changed) /
                                 changed.sensor->pixel_pitch_um,
                             2);
    return std::sqrt(std::max(variance, 0.0));
}

}  // namespace etalon
