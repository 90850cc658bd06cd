#include "calib/files/foreign_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "core/file/text.h"

namespace etalon {
namespace {

std::size_t index_of(std::string_view coefficient) {
    const auto at = std::ranges::find(distortion_names, coefficient);
    return static_cast<std::size_t>(at - distortion_names.begin());
}

// The first coefficient that is not 0 and not named.
std::optional<std::size_t> first_besides(const Distortion& distortion,
                                         const ParameterNames& names) {
    const auto coefficients = distortion.coefficients();
    for (std::size_t i = 0; i < coefficients.size(); ++i)
        if (coefficients[i] != 0.0 &&
            std::find(names.begin(), names.end(), distortion_names[i]) == names.end())
            return i;
    return std::nullopt;
}

[[noreturn]] void refuse(const char* parameter, double value, const std::filesystem::path& path,
                         const char* format) {
    throw ConfigError({path.string()},
                      fmt::format("{} has no place for {} = {}", format, parameter, value));
}

}  // namespace

Value foreign_root(const std::string& text, const std::string& file) {
    Value root = Value::of_foreign_file(text, file);
    if (text.starts_with("Model = CAHV"))
        throw ConfigError({file, 1},
                          "is a CAHV, CAHVOR or CAHVORE file of JPL, which is not read: "
                          "mrcal-from-cahvor makes a .cameramodel of it, which is");
    if (!root.is_mapping())
        throw ConfigError({file, 1}, "is no camera calibration of a known format");
    return root;
}

void set_size(ForeignMatrix& matrix, double rows, double cols) {
    const std::size_t count = matrix.values.size();
    if (!(rows >= 1 && cols >= 1 && rows * cols == static_cast<double>(count)))
        throw ConfigError(matrix.place,
                          fmt::format("says {}x{} but has {} numbers", rows, cols, count));
    matrix.rows = static_cast<int>(rows);
    matrix.cols = static_cast<int>(cols);
}

Intrinsics intrinsics_of(const ForeignMatrix& matrix) {
    if (matrix.rows != 3 || matrix.cols != 3 || matrix.values.size() != 9)
        throw ConfigError(matrix.place,
                          fmt::format("must be a 3x3 matrix, not {}x{} with {} numbers",
                                      matrix.rows, matrix.cols, matrix.values.size()));
    const std::vector<double>& m = matrix.values;
    if (std::ranges::any_of(m, [](double x) { return !std::isfinite(x); }))
        throw ConfigError(matrix.place, "has a number that is not finite");
    if (m[3] != 0.0 || m[6] != 0.0 || m[7] != 0.0 || m[8] != 1.0)
        throw ConfigError(matrix.place, "must be [fx skew cx; 0 fy cy; 0 0 1]");
    return checked_intrinsics(m[0], m[4], m[2], m[5], matrix.place, m[1]);
}

Intrinsics checked_intrinsics(double fx, double fy, double cx, double cy, const SourcePlace& place,
                              double skew) {
    for (const double value : {fx, fy, cx, cy, skew})
        if (!std::isfinite(value))
            throw ConfigError(place, "has a number that is not finite");
    if (fx <= 0.0 || fy <= 0.0)
        throw ConfigError(place, fmt::format("fx and fy must be positive, not {} and {}", fx, fy));
    for (const double focal_length : {fx, fy})
        if (const Range range = units::px.positive(); !range.contains(focal_length))
            throw ConfigError(place, fmt::format("{} must be {}", focal_length, range.words()));
    for (const double length : {cx, cy, skew})
        if (const Range range = units::px.either_sign(); !range.contains(length))
            throw ConfigError(place, fmt::format("{} must be {}", length, range.words()));
    return {.fx = fx, .fy = fy, .cx = cx, .cy = cy, .skew = skew};
}

ParameterNames first_coefficients(std::size_t count) {
    return {distortion_names.begin(), distortion_names.begin() + count};
}

const ForeignModel& model_named(const ForeignModels& models, const std::string& name,
                                const SourcePlace& place) {
    std::vector<std::string_view> names;
    for (const ForeignModel& model : models) {
        if (name == model.name)
            return model;
        names.emplace_back(model.name);
    }
    const std::string_view last = names.back();
    names.pop_back();
    throw ConfigError(
        place, fmt::format("must be {} or {}, not '{}'", fmt::join(names, ", "), last, name));
}

const ForeignModel& model_holding(const ForeignModels& models, const CameraModel& camera,
                                  const std::filesystem::path& path, const char* format) {
    const ForeignModel* last = nullptr;
    for (const ForeignModel& model : models) {
        if (model.one_focal_length || model.projection != camera.projection.kind)
            continue;
        last = &model;
        if (!first_besides(camera.distortion, model.parameters))
            return model;
    }
    require_only(camera, last->parameters, path, format);
    return *last;
}

void require_only(const CameraModel& camera, const ParameterNames& names,
                  const std::filesystem::path& path, const char* format) {
    if (const auto i = first_besides(camera.distortion, names))
        refuse(distortion_names[*i], camera.distortion.coefficients()[*i], path, format);
}

void require_projection(const CameraModel& camera, const std::filesystem::path& path,
                        const char* format, std::initializer_list<Projection> projections) {
    const Projection kind = camera.projection.kind;
    if (std::find(projections.begin(), projections.end(), kind) == projections.end())
        throw ConfigError({path.string()},
                          fmt::format("{} has no {} cameras", format, name_of(kind).name));
    checked_projection(camera.projection, {path.string()});
}

void require_foreign_camera(const CameraModel& camera, const std::filesystem::path& path,
                            const char* format, std::initializer_list<Projection> projections) {
    require_projection(camera, path, format, projections);
    if (camera.width < 1 || camera.height < 1)
        throw ConfigError({path.string()}, "the image size is not known");
    const Intrinsics& i = camera.intrinsics;
    checked_intrinsics(i.fx, i.fy, i.cx, i.cy, {path.string()}, i.skew);
    for (const double coefficient : camera.distortion.coefficients())
        if (!std::isfinite(coefficient))
            throw ConfigError({path.string()}, "has a coefficient that is not finite");
}

void require_no_skew(const CameraModel& camera, const std::filesystem::path& path,
                     const char* format) {
    if (camera.intrinsics.skew != 0.0)
        refuse("skew", camera.intrinsics.skew, path, format);
}

void set_parameters(CameraModel& camera, const ParameterNames& names,
                    const std::vector<double>& numbers) {
    auto coefficients = camera.distortion.coefficients();
    for (std::size_t i = 0; i < names.size(); ++i) {
        const double number = i < numbers.size() ? numbers[i] : 0.0;
        if (names[i] == "omega")
            camera.projection.a = number;
        else
            coefficients[index_of(names[i])] = number;
    }
    camera.distortion = Distortion::of(coefficients);
}

std::vector<double> parameters_of(const CameraModel& camera, const ParameterNames& names) {
    const auto coefficients = camera.distortion.coefficients();
    std::vector<double> numbers;
    for (const std::string_view name : names)
        numbers.push_back(name == "omega" ? camera.projection.a : coefficients[index_of(name)]);
    return numbers;
}

LensProjection projection_at(const SourcePlace& place,
                             const std::function<LensProjection()>& make) {
    try {
        return make();
    } catch (const NumericalError& error) {
        throw ConfigError(place, error.what());
    }
}

LensProjection checked_projection(const LensProjection& projection, const SourcePlace& place) {
    return projection_at(place, [&] {
        require_possible(projection);
        return projection;
    });
}

std::string yaml_real(double value) {
    std::string text = exact(value);
    if (text.find('.') == std::string::npos)
        text.insert(std::min(text.find('e'), text.size()), ".0");
    return text;
}

std::string yaml_reals(const std::vector<double>& values) {
    std::string text;
    for (const double value : values)
        text += (text.empty() ? "" : ", ") + yaml_real(value);
    return text;
}

int checked_image_side(double value, const SourcePlace& place) {
    if (!(value >= 1.0 && value <= 100'000.0) || value != std::floor(value))
        throw ConfigError(
            place, fmt::format("must be a whole number of 1 to 100000 pixels, not {}", value));
    return static_cast<int>(value);
}

int image_side(const Value& value) {
    return checked_image_side(value.number(any_number), value.place());
}

std::pair<int, int> image_sides(const Value& value) {
    const std::vector<double> sides = value.numbers(2, any_number);
    return {checked_image_side(sides[0], value.place()),
            checked_image_side(sides[1], value.place())};
}

}  // namespace etalon
