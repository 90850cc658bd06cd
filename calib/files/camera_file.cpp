#include "calib/files/camera_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Eigenvalues>

#include "calib/files/foreign_camera.h"
#include "calib/files/foreign_file.h"
#include "core/config/csv_file.h"
#include "core/file/text.h"

namespace etalon {
namespace {

Intrinsics read_intrinsics(const Value& value) {
    const auto skew = value.find("skew");
    return {.fx = value.at("fx").number(units::px.positive()),
            .fy = value.at("fy").number(units::px.positive()),
            .cx = value.at("cx").number(units::px.either_sign()),
            .cy = value.at("cy").number(units::px.either_sign()),
            .skew = skew ? skew->number(units::px.either_sign()) : 0.0};
}

Distortion read_distortion(const Value& value) {
    std::array<double, Distortion::count> coefficients{};
    for (std::size_t i = 0; i < coefficients.size(); ++i) {
        const bool is_tilt = std::string_view(distortion_names[i]).starts_with("tau");
        constexpr double right_angle = std::numbers::pi / 2;
        if (const auto given = value.find(distortion_names[i]))
            coefficients[i] = given->number(is_tilt ? Range{-right_angle, right_angle}
                                                    : units::one.either_sign());
    }
    return Distortion::of(coefficients);
}

std::vector<std::string> read_parameter_order(const Value& value) {
    std::vector<std::string> order;
    for (const Value& item : value.items()) {
        const std::string name = item.text();
        if (!is_camera_parameter(name))
            item.fail("is no camera parameter: '" + name + "'");
        if (std::find(order.begin(), order.end(), name) != order.end())
            item.fail("is listed twice: '" + name + "'");
        order.push_back(name);
    }
    return order;
}

// By the correlations, free of units; -1e-6 leaves room for files with few digits.
bool is_positive_semidefinite(const Eigen::MatrixXd& matrix) {
    const Eigen::VectorXd deviations = matrix.diagonal().cwiseSqrt();
    if (!deviations.allFinite())
        return false;  // a negative variance
    Eigen::MatrixXd correlation = matrix;
    for (Eigen::Index i = 0; i < matrix.rows(); ++i)
        for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
            const double scale = deviations(i) * deviations(j);
            if (scale > 0.0)
                correlation(i, j) /= scale;
            else if (matrix(i, j) != 0.0)
                return false;  // correlated with something known exactly
        }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(correlation, Eigen::EigenvaluesOnly);
    return eigen.info() == Eigen::Success && eigen.eigenvalues().minCoeff() >= -1e-6;
}

ParameterCovariance read_covariance(const Value& value) {
    ParameterCovariance covariance;
    covariance.order = read_parameter_order(value.at("order"));
    const std::size_t n = covariance.order.size();
    if (n == 0)
        value.at("order").fail("must name at least one parameter");
    const Value lower = value.at("lower");
    constexpr double most = units::one.most * units::one.most;
    const std::vector<double> entries = lower.numbers(n * (n + 1) / 2, {-most, most});
    covariance.matrix.resize(n, n);
    std::size_t next = 0;
    for (std::size_t row = 0; row < n; ++row)
        for (std::size_t col = 0; col <= row; ++col)
            covariance.matrix(row, col) = covariance.matrix(col, row) = entries[next++];
    if (!is_positive_semidefinite(covariance.matrix))
        lower.fail("is no covariance: not positive semi-definite");
    return covariance;
}

using PsfKind = PointSpread::Kind;
using TransferKind = Transfer::Kind;
using IlluminationKind = Illumination::Kind;
constexpr std::array<const char*, 5> mosaic_names{"", "RGGB", "BGGR", "GRBG", "GBRG"};

// Pairs of a table, and the standard uncertainty of each second number where the file has them.
struct MeasuredTable {
    std::vector<std::pair<double, double>> pairs;
    std::vector<double> uncertainties;
};

// A radial profile, `etalon: psf/1`.
MeasuredTable read_profile(const std::filesystem::path& path) {
    const StrictFile file(path, "psf/1");
    const Value radius = file.root().at("radius_px"), density = file.root().at("density");
    const std::vector<double> radii = radius.numbers(0, units::px.non_negative());
    if (radii.size() < 4)
        radius.fail("needs at least 4 radii");
    const std::vector<double> densities = density.numbers(radii.size(), units::one.non_negative());
    MeasuredTable profile;
    if (const auto uncertainty = file.root().find("standard_uncertainty"))
        profile.uncertainties = uncertainty->numbers(radii.size(), units::one.non_negative());
    file.finish();
    if (radii.front() != 0.0)
        radius.fail("must begin with 0");
    for (std::size_t i = 1; i < radii.size(); ++i)
        if (!(radii[i] > radii[i - 1]))
            radius.fail(fmt::format("must ascend: {} after {}", radii[i], radii[i - 1]));
    if (std::all_of(densities.begin(), densities.end(), [](double d) { return d == 0.0; }))
        density.fail("holds no energy");
    for (std::size_t i = 0; i < radii.size(); ++i)
        profile.pairs.emplace_back(radii[i], densities[i]);
    return profile;
}

PointSpread read_point_spread(const StrictFile& file, const Value& value,
                              std::vector<double>& density_uncertainties) {
    if (value.is_scalar())
        return {.kind =
                    value.one_of({"ideal", "wave"}) == "ideal" ? PsfKind::ideal : PsfKind::wave};
    if (const auto measured = value.find("measured")) {
        MeasuredTable profile = read_profile(file.resolve(measured->at("file").text()));
        density_uncertainties = std::move(profile.uncertainties);
        return {.kind = PsfKind::measured, .profile = std::move(profile.pairs)};
    }
    return {.kind = PsfKind::gaussian,
            .sigma_px = value.at("gaussian").at("sigma_px").number(units::px.positive())};
}

double read_focus_distance(const Value& value) {
    if (value.is_scalar() && value.text() == "infinity")
        return std::numeric_limits<double>::infinity();
    return value.number(units::mm.positive());
}

// Engraved f-number from whichever is given: N = N_w f / v = N_w / (1 + v / z_f).
double read_f_number(const Value& lens, double image_distance_mm, double focus_distance_mm) {
    const auto engraved = lens.find("f_number"), working = lens.find("working_f_number");
    if (!working)
        return lens.at("f_number").number(units::f_number.positive());
    const double from_working =
        working->number(units::f_number.positive()) / (1.0 + image_distance_mm / focus_distance_mm);
    if (!engraved)
        return from_working;
    const double f_number = engraved->number(units::f_number.positive());
    if (!(std::abs(from_working / f_number - 1.0) <= 1e-6))
        working->fail(
            fmt::format("contradicts f_number {}: belongs to {}", f_number, from_working));
    return f_number;
}

Lens read_lens(const StrictFile& file, const Value& value, const CameraModel& camera,
               CameraUncertainty& uncertainty) {
    Lens lens;
    if (camera.projection.kind == Projection::telecentric) {
        lens.focus_distance_mm = value.at("focus_distance_mm").number(units::mm.positive());
        lens.object_na = value.at("object_na").number({0.0, 1.0, true});
        if (lens.object_na == 1.0)
            value.at("object_na").fail("must be less than 1");
    } else {
        lens.focus_distance_mm = read_focus_distance(value.at("focus_distance_mm"));
        lens.f_number = read_f_number(value, image_distance_mm(camera), lens.focus_distance_mm);
    }
    lens.wavelength_nm = value.at("wavelength_nm").number(units::nm.positive());
    if (const auto psf = value.find("psf"))
        lens.psf = read_point_spread(file, *psf, uncertainty.psf_density);
    if (lens.psf.kind == PsfKind::wave && !camera.projection.is_flat())
        value.at("psf").fail(
            fmt::format("wave belongs to a flat projection, whose pattern is round "
                        "on the sensor: this one is {}, which draws it out",
                        name_of(camera.projection.kind).name));
    return lens;
}

void require_transfer(const std::vector<double>& row, int full_scale, const SourcePlace& place) {
    if (row[0] < 0.0 || row[1] < 0.0 || row[1] > full_scale)
        throw ConfigError(
            place,
            fmt::format("radiance must be at least 0 and code between 0 and {}", full_scale));
    if (row.size() == 3 && row[2] < 0.0)
        throw ConfigError(place, "a standard uncertainty must be at least 0");
}

// CSV `radiance,code` or `radiance,code,u_code`; codes become fractions of full scale.
MeasuredTable read_transfer_table(const std::filesystem::path& path, int full_scale) {
    MeasuredTable table;
    for (const CsvRow& row : read_csv(path, {"radiance,code", "radiance,code,u_code"}).rows) {
        const std::vector<double> numbers = row.numbers();
        require_transfer(numbers, full_scale, row.place);
        const std::pair<double, double> entry(numbers[0], numbers[1] / full_scale);
        if (!table.pairs.empty() &&
            (entry.first <= table.pairs.back().first || entry.second <= table.pairs.back().second))
            throw ConfigError(row.place, "must be greater than the line before, in both columns");
        table.pairs.push_back(entry);
        if (numbers.size() == 3)
            table.uncertainties.push_back(numbers[2] / full_scale);
    }
    if (table.pairs.size() < 2)
        throw ConfigError({path.string()}, "must have at least two lines of numbers");
    return table;
}

Transfer read_transfer(const StrictFile& file, const Value& value, int full_scale,
                       std::vector<double>& code_uncertainties) {
    if (value.is_scalar())
        return {.kind = value.one_of({"linear", "rec709"}) == "linear" ? TransferKind::linear
                                                                       : TransferKind::rec709};
    MeasuredTable table =
        read_transfer_table(file.resolve(value.at("table").at("file").text()), full_scale);
    code_uncertainties = std::move(table.uncertainties);
    return {.kind = TransferKind::table, .table = std::move(table.pairs)};
}

Illumination read_illumination(const Value& value, Projection projection) {
    Illumination illumination;
    const auto cos4 = value.find("cos4"), polynomial = value.find("polynomial");
    if (cos4 && polynomial)
        polynomial->fail("excludes cos4: it is the whole relative illumination");
    if (polynomial) {
        illumination.kind = IlluminationKind::polynomial;
        std::ranges::copy(polynomial->numbers(3, units::one.either_sign()),
                          illumination.polynomial.begin());
    } else if (value.at("cos4").flag()) {
        if (projection != Projection::perspective)
            cos4->fail(
                fmt::format("belongs to a perspective camera, with a pupil across its axis: this "
                            "one is {}; a polynomial does for any",
                            name_of(projection).name));
        illumination.kind = IlluminationKind::cos4;
    }
    return illumination;
}

void read_mosaic(const Value& value, Sensor& sensor) {
    if (const auto mosaic = value.find("mosaic")) {
        const std::string word = mosaic->one_of({"RGGB", "BGGR", "GRBG", "GBRG"});
        sensor.mosaic =
            static_cast<Mosaic>(std::ranges::find(mosaic_names, word) - mosaic_names.begin());
    }
    if (const auto response = value.find("channel_response")) {
        if (sensor.mosaic == Mosaic::none)
            response->fail("needs a mosaic");
        std::ranges::copy(response->numbers(3, units::one.positive()),
                          sensor.channel_response.begin());
    }
}

Sensor read_sensor(const StrictFile& file, const Value& value, Projection projection,
                   CameraUncertainty& uncertainty) {
    Sensor sensor;
    const auto number = [&value](const char* key, Range range) {
        const auto given = value.find(key);
        return given ? given->number(range) : 0.0;
    };
    sensor.pixel_pitch_um = number("pixel_pitch_um", units::um.positive());
    if (const auto bits = value.find("bits"))
        sensor.bits = bits->integer(1, 16);
    const int full_scale = (1 << sensor.bits) - 1;
    if (const auto transfer = value.find("transfer"))
        sensor.transfer = read_transfer(file, *transfer, full_scale, uncertainty.transfer_code);
    sensor.black_dn = number("black", {0.0, static_cast<double>(full_scale)});
    sensor.gain_e_per_dn = number("gain_e_per_dn", units::electrons.non_negative());
    sensor.read_noise_e = number("read_noise_e", units::electrons.non_negative());
    if (sensor.read_noise_e > 0.0 && sensor.gain_e_per_dn == 0.0)
        value.at("read_noise_e").fail("needs gain_e_per_dn to become code values");
    if (const auto illumination = value.find("illumination"))
        sensor.illumination = read_illumination(*illumination, projection);
    read_mosaic(value, sensor);
    return sensor;
}

void check_illumination(const CameraModel& camera, const Value& sensor) {
    if (camera.sensor->illumination.kind != IlluminationKind::polynomial)
        return;
    const double least = least_polynomial_illumination(camera);
    if (!(least > 0.0))
        sensor.at("illumination")
            .at("polynomial")
            .fail(fmt::format("falls to {} within the image", least));
}

// A lens whose numbers overflow or vanish in double precision is no lens.
void check_lens(const CameraModel& camera, const Value& value) {
    std::vector<double> lengths{working_f_number(camera)};
    if (camera.projection.kind == Projection::telecentric) {
        const TelecentricLens lens = telecentric_lens(camera);
        lengths.insert(lengths.end(), {lens.magnification, lens.cone_tangent});
    } else {
        const ThinLens lens = thin_lens(camera);
        lengths.insert(lengths.end(),
                       {lens.image_distance_mm, lens.focal_length_mm, lens.aperture_diameter_mm});
    }
    for (const double length : lengths)
        if (!std::isfinite(length) || length <= 0.0)
            value.fail("describes no lens: a length overflows or vanishes");
}

LensProjection tabled_projection(Projection kind, const Value& value) {
    const auto number = [&](const char* key) {
        return value.at(key).number(units::one.either_sign());
    };
    const auto number_or = [&](const char* key, double otherwise) {
        return value.find(key) ? number(key) : otherwise;
    };
    if (kind == Projection::polynomial)
        return polynomial_projection(number("a2"), number("a3"), number("a4"),
                                     number_or("shear", 0.0));
    if (kind == Projection::cahvor)
        return cahvor_projection(number("alpha"), number("beta"), number("r0"), number("r1"),
                                 number("r2"), number_or("linearity", 1.0));
    const int columns = value.at("columns").integer(1, 1000);
    const int rows = value.at("rows").integer(1, 1000);
    const std::size_t numbers = 2 * static_cast<std::size_t>(columns) * rows;
    return splined_projection(
        value.at("order").integer(2, 3), columns, rows,
        value.at("field_of_view_deg").number(units::deg.positive()),
        value.at("control_points").numbers(numbers, units::one.either_sign()));
}

// A word, or a word with its parameters.
LensProjection read_projection(const Value& value) {
    const std::string word =
        value.is_mapping() && value.keys().size() == 1 ? value.keys().front() : value.text();
    for (const ProjectionName& known : projection_names()) {
        if (word != known.name)
            continue;
        if (has_table(known.kind)) {
            if (!value.is_mapping())
                value.fail(fmt::format("needs its parameters: {{{}: {{...}}}}", word));
            return projection_at(value.place(),
                                 [&] { return tabled_projection(known.kind, value.at(word)); });
        }
        LensProjection projection{known.kind};
        double* const values[] = {&projection.a, &projection.b};
        for (std::size_t i = 0; i < 2; ++i)
            if (const std::string parameter = known.parameters[i]; !parameter.empty()) {
                if (!value.is_mapping())
                    value.fail(
                        fmt::format("needs its parameters: {{{}: {{{}: ...}}}}", word, parameter));
                *values[i] = value.at(word).at(parameter).number(units::one.either_sign());
            }
        return checked_projection(projection, value.place());
    }
    std::vector<std::string> names;
    for (const ProjectionName& known : projection_names())
        names.push_back(known.name);
    value.fail(fmt::format("must be {}, not '{}'", fmt::join(names, ", "), word));
}

void check_distortion(const CameraModel& camera, const Value& distortion) {
    if (camera.projection.kind != Projection::perspective)
        for (const char* key : {"tau_x", "tau_y"})
            if (const auto tilt = distortion.find(key);
                tilt && tilt->number(units::one.either_sign()) != 0.0)
                tilt->fail("belongs to a perspective camera");
}

// A standard uncertainty of one number: of `key` in a section, or of the Gaussian point spread.
struct UncertainNumber {
    const char *key, *section;
    Unit unit;
    std::optional<double> CameraUncertainty::*value;
};
constexpr UncertainNumber uncertain_numbers[]{
    {"f_number", "lens", units::f_number, &CameraUncertainty::f_number},
    {"focus_distance_mm", "lens", units::mm, &CameraUncertainty::focus_distance_mm},
    {"psf_sigma_px", "lens.psf.gaussian", units::px, &CameraUncertainty::psf_sigma_px},
    {"black", "sensor", units::one, &CameraUncertainty::black_dn},
    {"gain_e_per_dn", "sensor", units::electrons, &CameraUncertainty::gain_e_per_dn},
    {"read_noise_e", "sensor", units::electrons, &CameraUncertainty::read_noise_e}};

// Only of what the file has: the uncertainty of a default would be that of nothing measured.
void read_uncertainty(const Value& root, const CameraModel& camera, CameraUncertainty& result) {
    const auto given = root.find("standard_uncertainty");
    if (!given)
        return;
    const auto require = [](const Value& value, bool is_there, const std::string& what) {
        if (!is_there)
            value.fail("is of " + what + ", which this file does not have");
    };
    for (const auto& [key, section, unit, target] : uncertain_numbers) {
        const auto value = given->find(key);
        if (!value)
            continue;
        if (target == &CameraUncertainty::psf_sigma_px) {
            require(*value, camera.lens && camera.lens->psf.kind == PsfKind::gaussian, section);
        } else {
            const auto holder = root.find(section);
            require(*value, holder && holder->find(key), fmt::format("{}.{}", section, key));
        }
        result.*target = value->number(unit.non_negative());
    }
    if (const auto illumination = given->find("illumination")) {
        require(*illumination,
                camera.sensor && camera.sensor->illumination.kind == IlluminationKind::polynomial,
                "sensor.illumination.polynomial");
        const std::vector<double> deviations = illumination->numbers(3, units::one.non_negative());
        result.illumination = {deviations[0], deviations[1], deviations[2]};
    }
}

CameraModel read_own_camera(const std::filesystem::path& path) {
    const StrictFile file(path, "camera/1");
    const Value root = file.root();
    CameraModel camera;
    CameraUncertainty uncertainty;
    if (const auto serial = root.find("serial"))
        camera.serial = serial->text();
    camera.width = root.at("image").at("width").integer(1, 100'000);
    camera.height = root.at("image").at("height").integer(1, 100'000);
    if (const auto projection = root.find("projection"))
        camera.projection = read_projection(*projection);
    camera.intrinsics = read_intrinsics(root.at("intrinsics"));
    if (const auto distortion = root.find("distortion")) {
        camera.distortion = read_distortion(*distortion);
        check_distortion(camera, *distortion);
    }
    if (const auto covariance = root.find("covariance"))
        camera.covariance = read_covariance(*covariance);
    if (const auto sensor = root.find("sensor")) {
        camera.sensor = read_sensor(file, *sensor, camera.projection.kind, uncertainty);
        check_illumination(camera, *sensor);
    }
    if (const auto lens = root.find("lens")) {
        if (!has_lens_with(camera.intrinsics))
            lens->fail(
                fmt::format("has no meaning where a skew is above {} fx: its point spread, round "
                            "on the sensor, would be an inclined ellipse in pixels",
                            max_skew_of_a_lens));
        root.at("sensor").at("pixel_pitch_um").number(units::um.positive());
        camera.lens = read_lens(file, *lens, camera, uncertainty);
        check_lens(camera, *lens);
    }
    read_uncertainty(root, camera, uncertainty);
    if (uncertainty != CameraUncertainty{})
        camera.standard_uncertainty = std::move(uncertainty);
    file.finish();
    return camera;
}

void settle_image_size(CameraModel& camera, const std::filesystem::path& path,
                       std::optional<cv::Size> known) {
    const bool in_file = camera.width > 0;
    if (!in_file && !known)
        throw ConfigError({path.string(), 0, "image_width"},
                          "missing, and the image size is not known from elsewhere");
    if (in_file && known && (camera.width != known->width || camera.height != known->height))
        throw ConfigError({path.string()},
                          fmt::format("is for images of {}x{}, not {}x{}", camera.width,
                                      camera.height, known->width, known->height));
    if (!in_file) {
        camera.width = known->width;
        camera.height = known->height;
    }
}

// As YAML's double-quoted text.
std::string quoted(const std::string& text) {
    std::string result = "\"";
    for (const char c : printable(text)) {
        if (c == '"' || c == '\\')
            result += '\\';
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
    return psf.kind == PsfKind::ideal  ? "ideal"
           : psf.kind == PsfKind::wave ? "wave"
           : psf.kind == PsfKind::gaussian
               ? "{gaussian: {sigma_px: " + exact(psf.sigma_px) + "}}"
               : "{measured: {file: " + quoted(profile.filename().string()) + "}}";
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
    return transfer.kind == TransferKind::linear ? "linear"
           : transfer.kind == TransferKind::rec709
               ? "rec709"
               : "{table: {file: " + quoted(table.filename().string()) + "}}";
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
    const auto& [illumination, polynomial] = sensor.illumination;
    if (illumination == IlluminationKind::cos4)
        text += "  illumination: {cos4: true}\n";
    if (illumination == IlluminationKind::polynomial)
        text += "  illumination: {polynomial: " + exact_list(polynomial) + "}\n";
    if (sensor.mosaic != Mosaic::none)
        text += fmt::format("  mosaic: {}\n  channel_response: {}\n",
                            mosaic_names[static_cast<std::size_t>(sensor.mosaic)],
                            exact_list(sensor.channel_response));
    return text;
}

std::string uncertainty_lines(const CameraUncertainty& uncertainty) {
    std::string entries;
    for (const UncertainNumber& each : uncertain_numbers)
        if (const auto& value = uncertainty.*each.value)
            entries += fmt::format("  {}: {}\n", each.key, exact(*value));
    if (uncertainty.illumination)
        entries += "  illumination: " + exact_list(*uncertainty.illumination) + "\n";
    return entries.empty() ? "" : "standard_uncertainty:\n" + entries;
}

}  // namespace

CameraModel read_any_camera(const std::filesystem::path& path, std::optional<cv::Size> image_size) {
    CameraModel camera = is_etalon_file(path) ? read_own_camera(path) : read_foreign_camera(path);
    settle_image_size(camera, path, image_size);
    return camera;
}

CameraModel read_camera(const std::filesystem::path& path, std::optional<cv::Size> image_size) {
    CameraModel camera = read_any_camera(path, image_size);
    if (!camera.projection.is_flat())
        throw ConfigError({path.string()},
                          fmt::format("is of a lens that is {}, which this does not take so far",
                                      name_of(camera.projection.kind).name));
    return camera;
}

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
        if (camera.lens->psf.kind == PsfKind::measured)
            write_profile(profile, camera.lens->psf, uncertainty.psf_density);
    }
    if (camera.sensor) {
        text += sensor_lines(*camera.sensor, table);
        if (camera.sensor->transfer.kind == TransferKind::table)
            write_transfer_table(table, *camera.sensor, uncertainty.transfer_code);
    }
    write_text(path, text + uncertainty_lines(uncertainty));
}

}  // namespace etalon
