#include "calib/intrinsics/camera_check.h"

#include <fmt/format.h>

#include <cmath>

#include "calib/camera/projector.h"

namespace etalon {
namespace {

using Weight = CameraFinding::Weight;
constexpr int steps = 64;
constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

// A position in the image, 0 to 1 from its outer left upper to its outer right lower corner.
Eigen::Vector2d image_position(const CameraModel& camera, double x, double y) {
    return {x * camera.width - 0.5, y * camera.height - 0.5};
}

double angle_between_deg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return std::atan2(a.cross(b).norm(), a.dot(b)) * 180.0 / std::numbers::pi;
}

// Of a wide lens by way of the middle, as it may see more than 180 degrees.
void measure_field_of_view(const Projector& projector, CameraCheck& check) {
    const CameraModel& camera = projector.camera();
    const bool is_telecentric = camera.projection.kind == Projection::telecentric;
    const auto ray_at = [&](double x, double y) {
        return projector.ray(image_position(camera, x, y));
    };
    const auto across = [&](double x, double y) {
        const auto a = ray_at(x, y), b = ray_at(1.0 - x, 1.0 - y), middle = ray_at(0.5, 0.5);
        if (!a || !b)
            return not_a_number;
        if (is_telecentric)
            return (*a - *b).norm();
        if (camera.projection.is_flat())
            return angle_between_deg(*a, *b);
        return middle ? angle_between_deg(*a, *middle) + angle_between_deg(*middle, *b)
                      : not_a_number;
    };
    (is_telecentric ? check.horizontal_mm : check.horizontal_deg) = across(0, 0.5);
    (is_telecentric ? check.vertical_mm : check.vertical_deg) = across(0.5, 0);
    (is_telecentric ? check.diagonal_mm : check.diagonal_deg) = across(0, 0);
}

void measure_valid_region(const Projector& projector, CameraCheck& check) {
    int without_ray = 0;
    check.margin = std::numeric_limits<double>::infinity();
    for (int row = 0; row <= steps; ++row)
        for (int col = 0; col <= steps; ++col) {
            const auto point = projector.undistorted(
                image_position(projector.camera(), double(col) / steps, double(row) / steps));
            const bool on_edge = row == 0 || row == steps || col == 0 || col == steps;
            if (!point)
                ++without_ray;
            else if (on_edge && point->norm() > 0.0)
                check.margin = std::min(check.margin, projector.border(*point) / point->norm());
        }
    check.image_without_ray = without_ray / double((steps + 1) * (steps + 1));
}

// Whether the largest circle about the principal point that fits the image has rays: a wide lens
// may image no more than that.
bool has_image_circle(const Projector& projector) {
    const CameraModel& camera = projector.camera();
    const Eigen::Vector2d centre(camera.intrinsics.cx, camera.intrinsics.cy);
    const Eigen::Vector2d last(camera.width - 0.5, camera.height - 0.5);
    const double radius = std::min((centre.array() + 0.5).minCoeff(), (last - centre).minCoeff());
    for (int i = 0; i < steps && radius > 0.0; ++i) {
        const double angle = 2.0 * std::numbers::pi * i / steps;
        if (!projector.undistorted(centre +
                                   radius * Eigen::Vector2d(std::cos(angle), std::sin(angle))))
            return false;
    }
    return radius > 0.0;
}

void judge_valid_region(const Projector& projector, CameraCheck& check) {
    constexpr const char* about = "valid region";
    const double percent = 100.0 * check.image_without_ray;
    const bool is_flat = projector.camera().projection.is_flat();
    if (percent > 0.0 && !is_flat && has_image_circle(projector))
        check.findings.push_back(
            {Weight::note, about,
             fmt::format(
                 "{:.2g} % of the image has no ray: outside the circle that the lens images",
                 percent)});
    else if (percent > 0.0)
        check.findings.push_back(
            {Weight::fault, about,
             fmt::format("the distortion folds, or has a pole, inside the image: {:.2g} % of it "
                         "has no ray",
                         percent)});
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
    if (std::abs(i.skew / i.fx) > 0.001)
        findings.push_back({Weight::warning, "intrinsics",
                            fmt::format("skew / fx is {:.4f}: no usual sensor has rows and columns "
                                        "at other than right angles",
                                        i.skew / i.fx)});
}

void judge_thin_lens(const CameraModel& camera, std::vector<CameraFinding>& findings) {
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
    const double magnification = lens.image_distance_mm * lens.inverse_focus_per_mm;
    if (magnification > 5.0)
        findings.push_back({Weight::warning, "lens",
                            fmt::format("focused at {:.3g} mm, which it magnifies {:.1f} times: is "
                                        "focus_distance_mm right?",
                                        1.0 / lens.inverse_focus_per_mm, magnification)});
}

void judge_lens(const CameraModel& camera, std::vector<CameraFinding>& findings) {
    if (!camera.lens)
        return;
    const double f_number = working_f_number(camera);
    if (camera.projection.kind != Projection::telecentric)
        judge_thin_lens(camera, findings);
    else
        findings.push_back(
            {Weight::note, "lens",
             fmt::format("telecentric, magnification {:.4f}, working f-number {:.3f}",
                         telecentric_lens(camera).magnification, f_number)});
    if (f_number < 0.5)
        findings.push_back(
            {Weight::warning, "lens", "faster than f/0.5, which no lens in air can be"});
    // First zero of the Airy pattern.
    const double airy_px =
        1.22e-3 * camera.lens->wavelength_nm * f_number / camera.sensor->pixel_pitch_um;
    if (airy_px > 10.0)
        findings.push_back({Weight::warning, "lens",
                            fmt::format("diffraction alone blurs by {:.1f} px (radius of the Airy "
                                        "disk): do f-number, wavelength and pixel pitch agree?",
                                        airy_px)});
}

// What a sensor says of itself, and what no usual one says.
void judge_sensor(const CameraModel& camera, std::vector<CameraFinding>& findings) {
    if (!camera.sensor)
        return;
    const Sensor& sensor = *camera.sensor;
    const auto unusual = [&](const std::string& message) {
        findings.push_back({Weight::warning, "sensor", message});
    };
    if (sensor.pixel_pitch_um > 0.0 && (sensor.pixel_pitch_um < 0.5 || sensor.pixel_pitch_um > 50))
        unusual(fmt::format("pixels of {} um", sensor.pixel_pitch_um));
    const double range_dn = std::exp2(sensor.bits) - 1.0 - sensor.black_dn;
    if (sensor.black_dn > 0.25 * (range_dn + sensor.black_dn))
        unusual(fmt::format("black is {} of {} code values", sensor.black_dn,
                            range_dn + sensor.black_dn));
    const double full_well_e = sensor.gain_e_per_dn * range_dn;
    if (full_well_e > 0.0 && (full_well_e < 200.0 || full_well_e > 2e6))
        unusual(fmt::format("full scale is {:.3g} electrons: is gain_e_per_dn that of {} bits?",
                            full_well_e, sensor.bits));
    if (full_well_e > 0.0 && sensor.read_noise_e > 0.05 * full_well_e)
        unusual(fmt::format("read noise of {:.3g} electrons, {:.0f} % of full scale",
                            sensor.read_noise_e, 100.0 * sensor.read_noise_e / full_well_e));
}

void judge_illumination(const CameraModel& camera, std::vector<CameraFinding>& findings) {
    if (!camera.sensor || camera.sensor->illumination.kind != Illumination::Kind::polynomial)
        return;
    const double least = least_polynomial_illumination(camera);
    if (least < 0.1)
        findings.push_back({Weight::warning, "illumination",
                            fmt::format("falls to {:.1f} % in the image: a polynomial beyond where "
                                        "it was measured?",
                                        100.0 * least)});
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
    judge_valid_region(projector, check);
    judge_intrinsics(camera, check.findings);
    judge_lens(camera, check.findings);
    judge_sensor(camera, check.findings);
    judge_illumination(camera, check.findings);
    judge_completeness(camera, check.findings);
    return check;
}

}  // namespace etalon
