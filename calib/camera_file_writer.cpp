#include "calib/camera_file.h"
#include "calib/parameter_names.h"
#include "core/text.h"

namespace etalon {
namespace {

// As YAML's double-quoted text, which any byte survives.
std::string quoted(const std::string& text) {
    std::string result = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\')
            result += std::string("\\") + c;
        else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
            result += fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
        else
            result += c;
    }
    return result + "\"";
}

std::string distortion_lines(const Distortion& distortion) {
    const auto coefficients = distortion.in_opencv_order();
    std::string entries;
    for (std::size_t i = 0; i < coefficients.size(); ++i)
        if (coefficients[i] != 0.0 || i < 5)
            entries += fmt::format("{}{}: {}", entries.empty() ? "" : ", ", distortion_names[i],
                                   exact(coefficients[i]));
    return "distortion: {" + entries + "}\n";
}

std::string covariance_lines(const ParameterCovariance& covariance) {
    std::string text =
        fmt::format("covariance:\n  order: [{}]\n  lower: [", fmt::join(covariance.order, ", "));
    for (Eigen::Index row = 0; row < covariance.matrix.rows(); ++row) {
        text += row == 0 ? "" : ",\n          ";
        for (Eigen::Index col = 0; col <= row; ++col)
            text += (col == 0 ? "" : ", ") + exact(covariance.matrix(row, col));
    }
    return text + "]\n";
}

std::string lens_lines(const Lens& lens) {
    const std::string focus =
        std::isinf(lens.focus_distance_mm) ? "infinity" : exact(lens.focus_distance_mm);
    const std::string psf = lens.psf.kind == PointSpread::Kind::ideal
                                ? "ideal"
                                : "{gaussian: {sigma_px: " + exact(lens.psf.sigma_px) + "}}";
    return fmt::format(
        "lens:\n  f_number: {}\n  focus_distance_mm: {}\n  wavelength_nm: {}\n"
        "  psf: {}\n",
        exact(lens.f_number), focus, exact(lens.wavelength_nm), psf);
}

// A code value that reads back as exactly this fraction of full scale, where there is one.
double code_of(double fraction, double full_scale) {
    const double code = fraction * full_scale;
    for (const double near : {code, std::nextafter(code, 0.0), std::nextafter(code, full_scale)})
        if (near / full_scale == fraction)
            return near;
    return code;
}

void write_transfer_table(const std::filesystem::path& path, const Sensor& sensor) {
    const double full_scale = (1 << sensor.bits) - 1;
    std::string text = "radiance,code\n";
    for (const auto& [radiance, fraction] : sensor.transfer.table)
        text += exact(radiance) + "," + exact(code_of(fraction, full_scale)) + "\n";
    write_text(path, text);
}

std::string transfer_word(const Transfer& transfer, const std::filesystem::path& table) {
    switch (transfer.kind) {
        case Transfer::Kind::linear:
            return "linear";
        case Transfer::Kind::rec709:
            return "rec709";
        case Transfer::Kind::table:
            break;
    }
    return "{table: {file: " + quoted(table.filename().string()) + "}}";
}

std::string sensor_lines(const Sensor& sensor, const std::filesystem::path& table) {
    std::string text = "sensor:\n";
    if (sensor.pixel_pitch_um > 0.0)
        text += "  pixel_pitch_um: " + exact(sensor.pixel_pitch_um) + "\n";
    text += fmt::format(
        "  bits: {}\n  transfer: {}\n  black: {}\n  gain_e_per_dn: {}\n"
        "  read_noise_e: {}\n",
        sensor.bits, transfer_word(sensor.transfer, table), exact(sensor.black_dn),
        exact(sensor.gain_e_per_dn), exact(sensor.read_noise_e));
    if (sensor.cos4_illumination)
        text += "  illumination: {cos4: true}\n";
    return text;
}

}  // namespace

void write_camera(const std::filesystem::path& path, const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    std::filesystem::path table = path;
    table.replace_extension(".transfer.csv");
    std::string text = "etalon: camera/1\n";
    if (!camera.serial.empty())
        text += "serial: " + quoted(camera.serial) + "\n";
    text += fmt::format("image: {{width: {}, height: {}}}\n", camera.width, camera.height);
    text += fmt::format("intrinsics: {{fx: {}, fy: {}, cx: {}, cy: {}}}\n", exact(i.fx),
                        exact(i.fy), exact(i.cx), exact(i.cy));
    if (!camera.distortion.is_zero())
        text += distortion_lines(camera.distortion);
    if (camera.covariance)
        text += covariance_lines(*camera.covariance);
    if (camera.lens)
        text += lens_lines(*camera.lens);
    if (camera.sensor) {
        text += sensor_lines(*camera.sensor, table);
        if (camera.sensor->transfer.kind == Transfer::Kind::table)
            write_transfer_table(table, *camera.sensor);
    }
    write_text(path, text);
}

}  // namespace etalon
