#include <fmt/format.h>

#include <span>

#include "calib/camera/lens_table.h"
#include "calib/camera/parameter_names.h"
#include "calib/files/camera_file.h"
#include "core/file/text.h"
#include "core/program/errors.h"

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

std::string exact_list(std::span<const double> values) {
    std::string text;
    for (const double value : values)
        text += (text.empty() ? "" : ", ") + exact(value);
    return "[" + text + "]";
}

std::string projection_text(const LensProjection& projection) {
    const std::string word = name_of(projection.kind).name;
    if (projection.kind == Projection::splined_stereographic) {
        const LensTable& table = *projection.table;
        return fmt::format(
            "{{{}: {{order: {}, columns: {}, rows: {}, field_of_view_deg: {},\n"
            "    control_points: {}}}}}",
            word, table.order, table.columns, table.rows, exact(table.field_of_view_deg),
            exact_list(table.coefficients));
    }
    std::string parameters;
    for (const auto& [name, value] : named_parameters(projection))
        parameters += fmt::format("{}{}: {}", parameters.empty() ? "" : ", ", name, exact(value));
    return parameters.empty() ? word : fmt::format("{{{}: {{{}}}}}", word, parameters);
}

std::string distortion_lines(const Distortion& distortion) {
    const auto coefficients = distortion.coefficients();
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

std::string point_spread_word(const PointSpread& psf, const std::filesystem::path& profile) {
    switch (psf.kind) {
        case PointSpread::Kind::ideal:
            return "ideal";
        case PointSpread::Kind::wave:
            return "wave";
        case PointSpread::Kind::gaussian:
            return "{gaussian: {sigma_px: " + exact(psf.sigma_px) + "}}";
        case PointSpread::Kind::measured:
            break;
    }
    return "{measured: {file: " + quoted(profile.filename().string()) + "}}";
}

// Uncertainties of a table's rows: one each, or none at all.
void check_uncertainties(const std::filesystem::path& path, std::size_t given, std::size_t rows) {
    if (given != 0 && given != rows)
        throw ConfigError({path.string()}, fmt::format("{} uncertainties of {} rows", given, rows));
}

void write_profile(const std::filesystem::path& path, const PointSpread& psf,
                   const std::vector<double>& uncertainties) {
    check_uncertainties(path, uncertainties.size(), psf.profile.size());
    std::vector<double> radii, densities;
    for (const auto& [radius, density] : psf.profile) {
        radii.push_back(radius);
        densities.push_back(density);
    }
    std::string text = "etalon: psf/1\nradius_px: " + exact_list(radii) +
                       "\ndensity: " + exact_list(densities) + "\n";
    if (!uncertainties.empty())
        text += "standard_uncertainty: " + exact_list(uncertainties) + "\n";
    write_text(path, text);
}

std::string lens_lines(const CameraModel& camera, const std::filesystem::path& profile) {
    const Lens& lens = *camera.lens;
    const std::string focus =
        std::isinf(lens.focus_distance_mm) ? "infinity" : exact(lens.focus_distance_mm);
    const std::string aperture = camera.projection.kind == Projection::telecentric
                                     ? "object_na: " + exact(lens.object_na)
                                     : "f_number: " + exact(lens.f_number);
    return fmt::format(
        "lens:\n  {}\n  focus_distance_mm: {}\n  wavelength_nm: {}\n"
        "  psf: {}\n",
        aperture, focus, exact(lens.wavelength_nm), point_spread_word(lens.psf, profile));
}

// A code value that reads back as exactly this fraction of full scale, where there is one.
double code_of(double fraction, double full_scale) {
    const double code = fraction * full_scale;
    for (const double near : {code, std::nextafter(code, 0.0), std::nextafter(code, full_scale)})
        if (near / full_scale == fraction)
            return near;
    return code;
}

void write_transfer_table(const std::filesystem::path& path, const Sensor& sensor,
                          const std::vector<double>& uncertainties) {
    const auto& table = sensor.transfer.table;
    check_uncertainties(path, uncertainties.size(), table.size());
    const double full_scale = (1 << sensor.bits) - 1;
    std::string text = uncertainties.empty() ? "radiance,code\n" : "radiance,code,u_code\n";
    for (std::size_t i = 0; i < table.size(); ++i) {
        text += exact(table[i].first) + "," + exact(code_of(table[i].second, full_scale));
        if (!uncertainties.empty())
            text += "," + exact(code_of(uncertainties[i], full_scale));
        text += "\n";
    }
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

std::string illumination_line(const Illumination& illumination) {
    switch (illumination.kind) {
        case Illumination::Kind::cos4:
            return "  illumination: {cos4: true}\n";
        case Illumination::Kind::polynomial:
            return "  illumination: {polynomial: " + exact_list(illumination.polynomial) + "}\n";
        case Illumination::Kind::uniform:
            break;
    }
    return "";
}

std::string mosaic_lines(const Sensor& sensor) {
    constexpr std::array<const char*, 5> names{"", "RGGB", "BGGR", "GRBG", "GBRG"};
    if (sensor.mosaic == Mosaic::none)
        return "";
    return fmt::format("  mosaic: {}\n  channel_response: {}\n",
                       names[static_cast<std::size_t>(sensor.mosaic)],
                       exact_list(sensor.channel_response));
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
    return text + illumination_line(sensor.illumination) + mosaic_lines(sensor);
}

std::string uncertainty_lines(const CameraUncertainty& uncertainty) {
    std::string entries;
    const auto add = [&entries](const char* key, const std::string& value) {
        entries += std::string("  ") + key + ": " + value + "\n";
    };
    const auto add_number = [&add](const char* key, const std::optional<double>& value) {
        if (value)
            add(key, exact(*value));
    };
    add_number("f_number", uncertainty.f_number);
    add_number("focus_distance_mm", uncertainty.focus_distance_mm);
    add_number("psf_sigma_px", uncertainty.psf_sigma_px);
    add_number("black", uncertainty.black_dn);
    add_number("gain_e_per_dn", uncertainty.gain_e_per_dn);
    add_number("read_noise_e", uncertainty.read_noise_e);
    if (uncertainty.illumination)
        add("illumination", exact_list(*uncertainty.illumination));
    return entries.empty() ? "" : "standard_uncertainty:\n" + entries;
}

}  // namespace

void write_camera(const std::filesystem::path& path, const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    const CameraUncertainty uncertainty = camera.standard_uncertainty.value_or(CameraUncertainty{});
    std::filesystem::path table = path, profile = path;
    table.replace_extension(".transfer.csv");
    profile.replace_extension(".psf.yml");
    std::string text = "etalon: camera/1\n";
    if (!camera.serial.empty())
        text += "serial: " + quoted(camera.serial) + "\n";
    text += fmt::format("image: {{width: {}, height: {}}}\n", camera.width, camera.height);
    if (camera.projection.kind != Projection::perspective)
        text += "projection: " + projection_text(camera.projection) + "\n";
    text +=
        fmt::format("intrinsics: {{fx: {}, fy: {}, cx: {}, cy: {}{}}}\n", exact(i.fx), exact(i.fy),
                    exact(i.cx), exact(i.cy), i.skew != 0.0 ? ", skew: " + exact(i.skew) : "");
    if (!camera.distortion.is_zero())
        text += distortion_lines(camera.distortion);
    if (camera.covariance)
        text += covariance_lines(*camera.covariance);
    if (camera.lens) {
        text += lens_lines(camera, profile);
        if (camera.lens->psf.kind == PointSpread::Kind::measured)
            write_profile(profile, camera.lens->psf, uncertainty.psf_density);
    }
    if (camera.sensor) {
        text += sensor_lines(*camera.sensor, table);
        if (camera.sensor->transfer.kind == Transfer::Kind::table)
            write_transfer_table(table, *camera.sensor, uncertainty.transfer_code);
    }
    write_text(path, text + uncertainty_lines(uncertainty));
}

}  // namespace etalon
