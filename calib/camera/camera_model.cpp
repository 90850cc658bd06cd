#include "calib/camera/camera_model.h"

#include <fmt/format.h>

#include <cmath>

#include "core/file/sha256.h"
#include "core/file/text.h"

namespace etalon {
namespace {

void refuse_much_skew(const CameraModel& camera) {
    if (!has_lens_with(camera.intrinsics))
        throw NumericalError(
            fmt::format("a lens needs rows and columns at right angles to {} rad, not a skew of {} "
                        "px: its point "
                        "spread, round on the sensor, would be an inclined ellipse in pixels",
                        max_skew_of_a_lens, camera.intrinsics.skew));
}

// Real solutions of c1 + 2 c2 s + 3 c3 s^2 = 0, none lost to cancellation. A value that is no
// solution does not change a minimum over values of the polynomial.
std::array<double, 2> stationary_points(const std::array<double, 3>& coefficients) {
    const auto [c1, c2, c3] = coefficients;
    const double q = -(c2 + std::copysign(std::sqrt(std::max(c2 * c2 - 3.0 * c1 * c3, 0.0)), c2));
    return {q / (3.0 * c3), c1 / q};
}

}  // namespace

bool has_lens_with(const Intrinsics& intrinsics) {
    return std::abs(intrinsics.skew) <= max_skew_of_a_lens * intrinsics.fx;
}

double image_distance_mm(const CameraModel& camera) {
    return camera.intrinsics.fx * scale_on_axis(camera.projection) * camera.sensor->pixel_pitch_um *
           1e-3;
}

ThinLens thin_lens(const CameraModel& camera) {
    require_point_of_view(camera, "a thin lens");
    if (!camera.lens || !camera.sensor)
        throw NumericalError("a thin lens needs the lens and the sensor section of the camera");
    refuse_much_skew(camera);
    const Lens& lens = *camera.lens;
    const double v = image_distance_mm(camera);
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

TelecentricLens telecentric_lens(const CameraModel& camera) {
    if (camera.projection.kind != Projection::telecentric || !camera.lens || !camera.sensor)
        throw NumericalError(
            "a telecentric lens needs the lens and the sensor section of a telecentric camera");
    if (camera.distortion.tau_x != 0.0 || camera.distortion.tau_y != 0.0)
        throw NumericalError("tau_x and tau_y belong to a perspective camera, not a telecentric");
    refuse_much_skew(camera);
    const Lens& lens = *camera.lens;
    const double m = camera.intrinsics.fx * camera.sensor->pixel_pitch_um * 1e-3;
    const bool usable = std::isfinite(m) && m > 0.0 && std::isfinite(lens.focus_distance_mm) &&
                        lens.focus_distance_mm > 0.0 && lens.object_na > 0.0 &&
                        lens.object_na < 1.0;
    if (!usable)
        throw NumericalError(fmt::format(
            "no telecentric lens has magnification {}, focus distance {} mm and object_na {}", m,
            lens.focus_distance_mm, lens.object_na));
    const double cosine = std::sqrt((1.0 - lens.object_na) * (1.0 + lens.object_na));
    return {m, lens.object_na / cosine, m / (2.0 * lens.object_na), lens.focus_distance_mm};
}

double working_f_number(const CameraModel& camera) {
    return camera.projection.kind == Projection::telecentric
               ? telecentric_lens(camera).working_f_number
               : thin_lens(camera).working_f_number;
}

double blur_radius_px(const CameraModel& camera, double z_mm) {
    if (!(z_mm > 0.0))
        throw NumericalError(fmt::format("blur at depth {} mm: not in front of the lens", z_mm));
    if (!camera.lens || camera.lens->psf.kind == PointSpread::Kind::measured)
        return 0.0;
    if (camera.projection.kind == Projection::telecentric) {
        const TelecentricLens lens = telecentric_lens(camera);
        return camera.intrinsics.fx * lens.cone_tangent * std::abs(z_mm - lens.focus_distance_mm);
    }
    const ThinLens lens = thin_lens(camera);
    const double vergence = std::abs(1.0 / z_mm - lens.inverse_focus_per_mm);
    return camera.intrinsics.fx * scale_on_axis(camera.projection) * lens.aperture_diameter_mm /
           2.0 * vergence;
}

double polynomial_illumination(const std::array<double, 3>& coefficients, double s) {
    const auto [c1, c2, c3] = coefficients;
    return 1.0 + s * (c1 + s * (c2 + s * c3));
}

double illumination_radius_squared(const CameraModel& camera, const Eigen::Vector2d& pixel) {
    const double diagonal = std::hypot(camera.width, camera.height);
    const Eigen::Vector2d centre(camera.intrinsics.cx, camera.intrinsics.cy);
    return 4.0 * (pixel - centre).squaredNorm() / (diagonal * diagonal);
}

double least_polynomial_illumination(const CameraModel& camera) {
    const auto& coefficients = camera.sensor->illumination.polynomial;
    double farthest = 0.0;
    for (const double x : {-0.5, camera.width - 0.5})
        for (const double y : {-0.5, camera.height - 0.5})
            farthest = std::max(farthest, illumination_radius_squared(camera, {x, y}));
    double least = std::min(polynomial_illumination(coefficients, farthest), 1.0);
    for (const double s : stationary_points(coefficients))
        if (s > 0.0 && s < farthest)
            least = std::min(least, polynomial_illumination(coefficients, s));
    return least;
}

bool images_lines_straight(const CameraModel& camera) {
    return camera.projection.is_flat() && camera.distortion.is_zero();
}

void require_perspective(const CameraModel& camera, const char* purpose) {
    if (camera.projection.kind != Projection::perspective)
        throw NumericalError(fmt::format("{} needs a perspective camera; this one is {}", purpose,
                                         name_of(camera.projection.kind).name));
}

void require_point_of_view(const CameraModel& camera, const char* purpose) {
    if (camera.projection.kind == Projection::telecentric)
        throw NumericalError(fmt::format(
            "{} needs rays from one point; those of a telecentric camera are parallel", purpose));
}

std::string camera_sha256(const std::filesystem::path& file, const CameraModel& camera) {
    std::string text = read_text(file);
    const auto add = [&](const std::vector<std::pair<double, double>>& table) {
        for (const auto& [a, b] : table)
            text += fmt::format("\n{},{}", a, b);
    };
    if (camera.lens)
        add(camera.lens->psf.profile);
    if (camera.sensor)
        add(camera.sensor->transfer.table);
    return sha256(text);
}

}  // namespace etalon
