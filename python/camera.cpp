// etalon.Camera: a calibration, its projection and the exact inverse.
#include "calib/camera/projector.h"

#include <fmt/format.h>

#include <Eigen/LU>

#include "calib/files/camera_file.h"
#include "calib/files/foreign_camera.h"
#include "calib/intrinsics/calibration_model.h"
#include "calib/intrinsics/camera_check.h"
#include "core/program/errors.h"
#include "python/arrays.h"
#include "python/interruptible.h"

namespace etalon {
namespace {

constexpr double no_number = std::numeric_limits<double>::quiet_NaN();

std::optional<cv::Size> size_of(const std::optional<std::pair<int, int>>& image_size) {
    return image_size ? std::optional(cv::Size(image_size->first, image_size->second))
                      : std::nullopt;
}

Projector load(const std::filesystem::path& path,
               const std::optional<std::pair<int, int>>& image_size) {
    return without_gil([&] { return Projector(read_any_camera(path, size_of(image_size))); });
}

// `tool`: "etalon", or a word of calibration_tools().
void save(const Projector& camera, const std::filesystem::path& path, const std::string& tool) {
    if (tool == "etalon")
        return without_gil([&] { write_camera(path, camera.camera()); });
    for (const CalibrationTool known : calibration_tools())
        if (tool == name_of(known))
            return without_gil([&] { write_foreign_camera(path, known, camera.camera()); });
    throw ConfigError({"tool"}, fmt::format("there is no tool \"{}\"", tool));
}

// What OpenCV's users have at hand.
Projector from_opencv(const std::pair<int, int>& image_size, const py::object& matrix,
                      const py::object& distortion) {
    const NumberArray k = number_rows(matrix, 3, "matrix");
    if (k.ndim() != 2 || k.shape(0) != 3 || k.at(1, 0) != 0.0 || k.at(2, 0) != 0.0 ||
        k.at(2, 1) != 0.0 || k.at(2, 2) != 1.0)
        throw ConfigError({"matrix"}, "must be [fx skew cx; 0 fy cy; 0 0 1]");
    std::array<double, Distortion::count> coefficients{};  // k7, the last, is none of OpenCV's
    const std::vector<double> given = number_list(distortion, "distortion");
    if (given.size() >= coefficients.size())
        throw ConfigError({"distortion"}, "OpenCV has 14 coefficients at most");
    std::copy(given.begin(), given.end(), coefficients.begin());
    if (image_size.first < 1 || image_size.second < 1)
        throw ConfigError({"image_size"}, "must be (width, height), both at least 1 px");
    CameraModel camera;
    camera.width = image_size.first;
    camera.height = image_size.second;
    camera.intrinsics = {k.at(0, 0), k.at(1, 1), k.at(0, 2), k.at(1, 2), k.at(0, 1)};
    camera.distortion = Distortion::of(coefficients);
    return Projector(camera);
}

// Rows of `In` numbers to rows of `Out`, with the derivative of each if asked for; NaN is left
// where `map`(row, value, derivative or null) writes nothing.
template <int In, int Out, class Map>
py::object mapped_rows(const NumberArray& rows, bool jacobians, const Map& map) {
    using Derivative = Eigen::Matrix<double, Out, In>;
    NumberArray values(shape_like(rows, {Out}));
    NumberArray by_row(jacobians ? shape_like(rows, {Out, In}) : std::vector<py::ssize_t>{0});
    const double* from = rows.data();
    double* to = values.mutable_data();
    double* jacobian = by_row.mutable_data();
    without_gil([&] {
        for (py::ssize_t i = 0; i < rows.size(); i += In, to += Out) {
            Eigen::Map<Eigen::Matrix<double, Out, 1>> value(to);
            value.fill(no_number);
            Derivative derivative = Derivative::Constant(no_number);
            map(Eigen::Matrix<double, In, 1>(from + i), value, jacobians ? &derivative : nullptr);
            if (jacobians)
                Eigen::Map<Eigen::Matrix<double, Out, In, Eigen::RowMajor>>(jacobian + Out * i) =
                    derivative;
        }
    });
    return jacobians ? py::object(py::make_tuple(values, by_row)) : values;
}

py::object project(const Projector& camera, const py::object& points_camera, bool jacobians) {
    return mapped_rows<3, 2>(number_rows(points_camera, 3, "points_camera"), jacobians,
                             [&](const Eigen::Vector3d& point, auto& pixel, auto* derivative) {
                                 if (!derivative) {
                                     if (const auto seen = camera.project(point))
                                         pixel = *seen;
                                 } else if (const auto seen = camera.project_with_jacobian(point)) {
                                     pixel = seen->pixel;
                                     *derivative = seen->jacobian;
                                 }
                             });
}

// d ray / d pixel: the inverse of d pixel / d p_camera on the plane in which rays can move, which
// is Z = 1 or, of rays of length 1, across the ray (there the inverse is Moore and Penrose's).
Eigen::Matrix<double, 3, 2> ray_by_pixel(const Eigen::Matrix<double, 2, 3>& pixel_by_point,
                                         bool is_flat) {
    if (!is_flat)
        return pixel_by_point.transpose() * (pixel_by_point * pixel_by_point.transpose()).inverse();
    Eigen::Matrix<double, 3, 2> result = Eigen::Matrix<double, 3, 2>::Zero();
    result.topRows<2>() = pixel_by_point.leftCols<2>().inverse();
    return result;
}

py::object unproject(const Projector& camera, const py::object& pixels, bool jacobians) {
    const bool is_flat = camera.camera().projection.is_flat();
    return mapped_rows<2, 3>(number_rows(pixels, 2, "pixels"), jacobians,
                             [&](const Eigen::Vector2d& pixel, auto& ray, auto* derivative) {
                                 const auto found = camera.ray(pixel);
                                 if (found)
                                     ray = *found;
                                 const auto back = found && derivative
                                                       ? camera.project_with_jacobian(*found)
                                                       : std::nullopt;
                                 if (back)
                                     *derivative = ray_by_pixel(back->jacobian, is_flat);
                             });
}

py::dict parameters(const Projector& camera) {
    const CameraModel& model = camera.camera();
    const Intrinsics& k = model.intrinsics;
    py::dict all;
    all["fx"] = k.fx;
    all["fy"] = k.fy;
    all["cx"] = k.cx;
    all["cy"] = k.cy;
    all["skew"] = k.skew;
    const auto coefficients = model.distortion.coefficients();
    for (std::size_t i = 0; i < coefficients.size(); ++i)
        all[distortion_names[i]] = coefficients[i];
    for (const auto& [name, value] : named_parameters(model.projection))
        all[name] = value;
    return all;
}

NumberArray matrix(const Projector& camera) {
    const Intrinsics& k = camera.camera().intrinsics;
    return array_of(Eigen::MatrixXd(
        (Eigen::Matrix3d() << k.fx, k.skew, k.cx, 0, k.fy, k.cy, 0, 0, 1).finished()));
}

py::object covariance(const Projector& camera) {
    const auto& stated = camera.camera().covariance;
    if (!stated)
        return py::none();
    return py::make_tuple(stated->order, array_of(stated->matrix));
}

py::object lens(const Projector& camera) {
    const auto& lens = camera.camera().lens;
    if (!lens)
        return py::none();
    static constexpr const char* spreads[] = {"ideal", "gaussian", "measured", "wave"};
    return py::dict("f_number"_a = lens->f_number, "focus_distance_mm"_a = lens->focus_distance_mm,
                    "wavelength_nm"_a = lens->wavelength_nm, "object_na"_a = lens->object_na,
                    "psf"_a = spreads[static_cast<int>(lens->psf.kind)],
                    "sigma_px"_a = lens->psf.sigma_px);
}

py::object sensor(const Projector& camera) {
    const auto& sensor = camera.camera().sensor;
    if (!sensor)
        return py::none();
    static constexpr const char* curves[] = {"linear", "rec709", "table"};
    return py::dict("pixel_pitch_um"_a = sensor->pixel_pitch_um, "bits"_a = sensor->bits,
                    "transfer"_a = curves[static_cast<int>(sensor->transfer.kind)],
                    "black_dn"_a = sensor->black_dn, "gain_e_per_dn"_a = sensor->gain_e_per_dn,
                    "read_noise_e"_a = sensor->read_noise_e);
}

py::dict check(const Projector& camera) {
    const CameraCheck check = without_gil([&] { return check_camera(camera.camera()); });
    static constexpr const char* weights[] = {"note", "warning", "fault"};
    py::list findings;
    for (const CameraFinding& finding : check.findings)
        findings.append(py::dict("weight"_a = weights[static_cast<int>(finding.weight)],
                                 "about"_a = finding.about, "message"_a = finding.message));
    return py::dict("has_fault"_a = check.has_fault(), "horizontal_deg"_a = check.horizontal_deg,
                    "vertical_deg"_a = check.vertical_deg, "diagonal_deg"_a = check.diagonal_deg,
                    "image_without_ray"_a = check.image_without_ray, "margin"_a = check.margin,
                    "findings"_a = findings);
}

std::string text_of(const Projector& camera) {
    const CameraModel& model = camera.camera();
    return fmt::format("<etalon.Camera {} x {} px, {}, fx {:.6g}, fy {:.6g}>", model.width,
                       model.height, name_of(model.projection.kind).name, model.intrinsics.fx,
                       model.intrinsics.fy);
}

}  // namespace

void bind_camera(Module& module) {
    Bound<Projector>(module, "Camera",
                     R"(A calibrated camera. Immutable, safe from every thread.

Camera frame: x right, y down, z forward, mm. Pixel (0, 0) is the centre of the top-left pixel.)")
        .init(&from_opencv, "image_size"_a, "matrix"_a, "distortion"_a = py::tuple(),
              R"(A perspective camera from OpenCV's numbers; others are read from files: load().

image_size: (width, height), px. matrix: (3, 3), [fx skew cx; 0 fy cy; 0 0 1], px.
distortion: up to 14 coefficients in OpenCV's order. Raises ConfigError, NumericalError.)")
        .def_static("load", &load, "path"_a, "image_size"_a = py::none(),
                    R"(Reads camera.yml or the calibration of another tool, of any lens.

image_size: (width, height) where the file may not say it. Raises ConfigError with file, line and
key.)")
        .def("save", &save, "path"_a, "tool"_a = "etalon",
             R"(Writes camera.yml, so that load() gives the same doubles, or another tool's file.

tool: etalon, opencv, ros, kalibr, mrcal, matlab, boofcv or colmap. Raises ConfigError where the
tool lacks a coefficient that is not 0.)")
        .def("project", &project, "points_camera"_a, py::kw_only(), "jacobians"_a = false,
             R"(Pixels (..., 2) of points (..., 3) in the camera frame, mm.

With jacobians=True also d pixel / d point, (..., 2, 3), px/mm. NaN where a point has no image:
behind the camera, outside the distortion model's valid region, not finite.)")
        .def("unproject", &unproject, "pixels"_a, py::kw_only(), "jacobians"_a = false,
             R"(Rays (..., 3) of pixels (..., 2): Z = 1, or length 1 of a wide lens.

With jacobians=True also d ray / d pixel, (..., 3, 2). NaN where a pixel has no ray. Of a
telecentric camera X and Y in mm.)")
        .def("check", &check, R"(Whether the whole image can be used, and what is unusual: a dict.

Angles in degrees, image_without_ray 0 to 1, findings with weight, about and message.)")
        .get("width", "px", [](const Projector& c) { return c.camera().width; })
        .get("height", "px", [](const Projector& c) { return c.camera().height; })
        .get("serial", "Serial number; empty where it is not known.",
             [](const Projector& c) { return c.camera().serial; })
        .get("projection", "perspective, telecentric, equidistant, ...: docs/files.md.",
             [](const Projector& c) { return name_of(c.camera().projection.kind).name; })
        .get("parameters", "By name: fx, fy, cx, cy, skew, k1 ... k7, and the projection's.",
             &parameters)
        .get("matrix", "(3, 3), [fx skew cx; 0 fy cy; 0 0 1], px.", &matrix)
        .get("covariance", "(names, (P, P)) of the calibrated parameters, or None.", &covariance)
        .get("lens", "What is known of the lens: a dict, or None.", &lens)
        .get("sensor", "What is known of the sensor: a dict, or None.", &sensor)
        .def("__repr__", &text_of);
}

}  // namespace etalon
