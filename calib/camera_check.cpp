#include "calib/camera_check.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "calib/projector.h"

namespace etalon {
namespace {

using Weight = CameraFinding::Weight;
constexpr int steps = 64;
constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

// A position in the image, 0 to 1 from its outer left upper to its outer right lower corner.
Eigen::Vector2d image_position(const CameraModel& camera, double x, double y) {
    return {x * camera.width - 0.5, y * camera.height - 0.5};
}

double angle_between_deg(const Projector& projector, const Eigen::Vector2d& a,
                         const Eigen::Vector2d& b) {
    const auto ray_a = projector.unproject(a), ray_b = projector.unproject(b);
    if (!ray_a || !ray_b)
        return not_a_number;
    const Eigen::Vector3d u = ray_a->homogeneous(), v = ray_b->homogeneous();
    return std::atan2(u.cross(v).norm(), u.dot(v)) * 180.0 / std::numbers::pi;
}

void measure_field_of_view(const Projector& projector, CameraCheck& check) {
    const CameraModel& camera = projector.camera();
    if (camera.projection == Projection::telecentric)
        return;
    const auto at = [&](double x, double y) { return image_position(camera, x, y); };
    check.horizontal_deg = angle_between_deg(projector, at(0, 0.5), at(1, 0.5));
    check.vertical_deg = angle_between_deg(projector, at(0.5, 0), at(0.5, 1));
    check.diagonal_deg = angle_between_deg(projector, at(0, 0), at(1, 1));
}

void measure_valid_region(const Projector& projector, CameraCheck& check) {
    int without_ray = 0;
    check.margin = std::numeric_limits<double>::infinity();
    for (int row = 0; row <= steps; ++row)
        for (int col = 0; col <= steps; ++col) {
            const auto ray = projector.unproject(
                image_position(projector.camera(), double(col) / steps, double(row) / steps));
            const bool on_edge = row == 0 || row == steps || col == 0 || col == steps;
            if (!ray)
                ++without_ray;
            else if (on_edge && ray->norm() > 0.0)
                check.margin =
                    std::min(check.margin, projector.valid_region().border(*ray) / ray->norm());
        }
    check.image_without_ray = without_ray / double((steps + 1) * (steps + 1));
}

void judge_valid_region(CameraCheck& check) {
    constexpr const char* about = "valid region";
    if (check.image_without_ray > 0.0)
        check.findings.push_back(
            {Weight::fault, about,
             fmt::format(
                 "the distortion folds, or has a pole, inside the image: {:.2g} % of it has "
                 "no ray",
                 100.0 * check.image_without_ray)});
    else if (check.margin < 1.05)
        check.findings.push_back(
            {Weight::warning, about,
             fmt::format("ends at {:.3f} times the radius of the image's edge: a fold or pole lies "
                         "just outside",
                         check.margin)});
}

void judge_intrinsics(const CameraModel& camera, std::vector<CameraFinding>& findings) {
    const Intrinsics& i = camera.intrinsics;
    const double off_x = i.cx - 0.5 * (camera.width - 1), off_y = i.cy - 0.5 * (camera.height - 1);
    const bool outside =
        i.cx < -0.5 || i.cx > camera.width - 0.5 || i.cy < -0.5 || i.cy > camera.height - 0.5;
    if (outside || std::abs(off_x) > 0.1 * camera.width || std::abs(off_y) > 0.1 * camera.height)
        findings.push_back({Weight::warning, "principal point",
                            fmt::format("lies {:.1f}, {:.1f} px from the image's centre{}", off_x,
                                        off_y, outside ? ", outside the image" : "")});
    if (std::abs(i.fy / i.fx - 1.0) > 0.01)
        findings.push_back({Weight::warning, "intrinsics",
                            fmt::format("fy / fx is {:.4f}: pixels that are not square, or a "
                                        "calibration that went wrong",
                                        i.fy / i.fx)});
}

void judge_lens(const CameraModel& camera, std::vector<CameraFinding>& findings) {
    if (!camera.lens || camera.projection == Projection::telecentric)
        return;
    const ThinLens lens = thin_lens(camera);
    const double sensor_mm = camera.width * camera.sensor->pixel_pitch_um * 1e-3;
    findings.push_back({Weight::note, "lens",
                        fmt::format("focal length {:.3f} mm, aperture {:.3f} mm, working f-number "
                                    "{:.3f}, sensor {:.2f} mm wide",
                                    lens.focal_length_mm, lens.aperture_diameter_mm,
                                    lens.working_f_number, sensor_mm)});
    if (lens.focal_length_mm < 0.5 || lens.focal_length_mm > 2000.0)
        findings.push_back({Weight::warning, "lens",
                            "the focal length is that of no usual lens: is pixel_pitch_um right?"});
    if (lens.working_f_number < 0.5)
        findings.push_back(
            {Weight::warning, "lens", "faster than f/0.5, which no lens in air can be"});
}

// What the renderer will leave out because the file does not say it.
void judge_completeness(const CameraModel& camera, std::vector<CameraFinding>& findings) {
    const auto missing = [&](const char* what, const char* effect) {
        findings.push_back({Weight::note, "renderer", fmt::format("no {}: {}", what, effect)});
    };
    if (!camera.lens)
        missing("lens section", "renders are sharp, neither defocus nor diffraction");
    if (!camera.sensor)
        missing("sensor section", "8 bits, linear, no noise, uniform illumination");
    else if (camera.sensor->gain_e_per_dn == 0.0)
        missing("gain_e_per_dn", "--noise-seed adds no shot noise");
    if (!camera.covariance)
        missing("covariance", "how well the calibration is known is not said");
}

}  // namespace

bool CameraCheck::has_fault() const {
    return std::any_of(findings.begin(), findings.end(),
                       [](const CameraFinding& f) { return f.weight == Weight::fault; });
}

CameraCheck check_camera(const CameraModel& camera) {
    const Projector projector(camera);
    CameraCheck check;
    measure_field_of_view(projector, check);
    measure_valid_region(projector, check);
    judge_valid_region(check);
    judge_intrinsics(camera, check.findings);
    judge_lens(camera, check.findings);
    judge_completeness(camera, check.findings);
    return check;
}

}  // namespace etalon
