// MATLAB's cameraParameters or cameraIntrinsics as JSON: jsonencode(toStruct(cameraParams)).
//
//   K [fx skew cx; 0 fy cy; 0 0 1], or IntrinsicMatrix, its transpose, or FocalLength [fx, fy],
//       PrincipalPoint [cx, cy] and Skew (which may be missing): at least one of them; those that
//       are there must agree
//   ImageSize          [rows, columns]; may be empty: the size is then not known
//   RadialDistortion   2 or 3 coefficients, k1 k2 k3
//   TangentialDistortion   p1 p2, OpenCV's; may be missing
//
// Source: MATLAB's documentation of cameraParameters, cameraIntrinsics. Principal points: 1-based.
//
// fisheyeIntrinsics, jsonencode'd, or as Intrinsics of fisheyeParameters:
//
//   MappingCoefficients    [a0, a2, a3, a4], a0 positive; the projection `polynomial`, in px
//   DistortionCenter       [cx, cy], 1-based
//   StretchMatrix          [c d; e 1]; may be missing: no stretch
//   ImageSize              as above
//
// A point (u, v) of the image, less the centre and by the stretch's inverse, is (x, y) with
// r^2 = x^2 + y^2; its ray is (x, y, a0 + a2 r^2 + a3 r^3 + a4 r^4).
//
// Written for MATLAB:  s = jsondecode(fileread('camera.json'));
//   cameraIntrinsics(s.FocalLength', s.PrincipalPoint', s.ImageSize', Skew=s.Skew,
//       RadialDistortion=s.RadialDistortion', TangentialDistortion=s.TangentialDistortion')
//   fisheyeIntrinsics(s.MappingCoefficients', s.ImageSize', s.DistortionCenter', s.StretchMatrix)
// The latter reads back within rounding. Throws ConfigError for coefficients beyond k1 k2 p1 p2 k3,
// of a polynomial camera any.
#include "calib/files/foreign_file.h"

#include <fmt/format.h>

#include "core/file/text.h"

namespace etalon {
namespace {

// `rows` lists of `cols` numbers.
ForeignMatrix matrix_of_rows(const Value& value, std::size_t rows, std::size_t cols) {
    ForeignMatrix matrix{value.place(), static_cast<int>(rows), static_cast<int>(cols), {}};
    const std::vector<Value> lists = value.items();
    if (lists.size() != rows)
        value.fail(fmt::format("must have {} rows, not {}", rows, lists.size()));
    for (const Value& row : lists)
        for (const double number : row.numbers(cols, any_number))
            matrix.values.push_back(number);
    return matrix;
}

ForeignMatrix transposed(const ForeignMatrix& matrix) {
    ForeignMatrix result = matrix;
    for (std::size_t row = 0; row < 3; ++row)
        for (std::size_t col = 0; col < 3; ++col)
            result.values[3 * row + col] = matrix.values[3 * col + row];
    return result;
}

// fx skew cx, 0 fy cy, 0 0 1.
ForeignMatrix matrix_of_lengths(const Value& root) {
    const Value focal = root.at("FocalLength");
    const auto f = focal.numbers(2, any_number),
               c = root.at("PrincipalPoint").numbers(2, any_number);
    const double s = root.number_or_zero("Skew", any_number);
    return {focal.place(), 3, 3, {f[0], s, c[0], 0.0, f[1], c[1], 0.0, 0.0, 1.0}};
}

std::vector<ForeignMatrix> camera_matrices(const Value& root) {
    std::vector<ForeignMatrix> found;
    if (const auto k = root.find("K"))
        found.push_back(matrix_of_rows(*k, 3, 3));
    if (const auto matrix = root.find("IntrinsicMatrix"))
        found.push_back(transposed(matrix_of_rows(*matrix, 3, 3)));
    if (root.find("FocalLength"))
        found.push_back(matrix_of_lengths(root));
    return found;
}

// To the digits that a shorter text may keep.
bool agree(const ForeignMatrix& a, const ForeignMatrix& b) {
    for (std::size_t i = 0; i < 9; ++i)
        if (!(std::abs(a.values[i] - b.values[i]) <= 1e-6 * std::max(1.0, std::abs(a.values[i]))))
            return false;
    return true;
}

ForeignMatrix the_camera_matrix(const Value& root) {
    const std::vector<ForeignMatrix> all = camera_matrices(root);
    if (all.empty())
        root.fail("has none of K, IntrinsicMatrix and FocalLength");
    for (const ForeignMatrix& other : all)
        if (!agree(all.front(), other))
            throw ConfigError(other.place, "contradicts " + all.front().place.key);
    if (const auto skew = root.find("Skew"))
        if (!(std::abs(skew->number(any_number) - all.front().values[1]) <= 1e-6))
            skew->fail("contradicts " + all.front().place.key);
    return all.front();
}

void read_distortion(const Value& root, CameraModel& camera) {
    const Value radial = root.at("RadialDistortion");
    const std::vector<double> k = radial.numbers(0, any_number);
    if (k.size() != 2 && k.size() != 3)
        radial.fail(fmt::format("must have 2 or 3 coefficients, not {}", k.size()));
    set_parameters(camera, {"k1", "k2", "k3"}, k);
    if (const auto tangential = root.find("TangentialDistortion"))
        set_parameters(camera, {"p1", "p2"}, tangential->numbers(2, any_number));
}

void read_image_size(const Value& root, CameraModel& camera) {
    const auto size = root.find("ImageSize");
    if (!size || size->numbers(0, any_number).empty())
        return;
    std::tie(camera.height, camera.width) = image_sides(*size);
}

// The stretch matrix [c d; e 1] is [c - d e, d; 0, 1] [1 0; e 1]: the left one goes into the
// intrinsics, e stays with the projection. Radii are in units of a0, the focal length.
CameraModel read_fisheye(const Value& fisheye) {
    const Value mapping = fisheye.at("MappingCoefficients");
    const auto a = mapping.numbers(4, any_number),
               centre = fisheye.at("DistortionCenter").numbers(2, any_number);
    std::vector<double> stretch{1.0, 0.0, 0.0, 1.0};
    if (const auto given = fisheye.find("StretchMatrix")) {
        stretch = matrix_of_rows(*given, 2, 2).values;
        if (stretch[3] != 1.0)
            given->fail(fmt::format("must be [c d; e 1], not with {} for 1", stretch[3]));
    }
    const double c = stretch[0], d = stretch[1], e = stretch[2], f = a[0];
    CameraModel camera;
    camera.intrinsics =
        checked_intrinsics((c - d * e) * f, f, centre[0], centre[1], mapping.place(), d * f);
    camera.projection = projection_at(mapping.place(), [&] {
        return polynomial_projection(a[1] * f, a[2] * f * f, a[3] * f * f * f, e);
    });
    read_image_size(fisheye, camera);
    return camera;
}

void write_fisheye(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "MATLAB's fisheyeIntrinsics";
    require_foreign_camera(camera, path, format, {Projection::polynomial});
    require_only(camera, {}, path, format);
    const Intrinsics& i = camera.intrinsics;
    const std::vector<double>& a = camera.projection.table->coefficients;
    const double f = i.fy, d = i.skew / f, e = a[3];
    write_text(path,
               fmt::format("{{\n"
                           "  \"MappingCoefficients\": [{}, {}, {}, {}],\n"
                           "  \"ImageSize\": [{}, {}],\n"
                           "  \"DistortionCenter\": [{}, {}],\n"
                           "  \"StretchMatrix\": [[{}, {}], [{}, 1]]\n"
                           "}}\n",
                           exact(f), exact(a[0] / f), exact(a[1] / (f * f)),
                           exact(a[2] / (f * f * f)), camera.height, camera.width, exact(i.cx),
                           exact(i.cy), exact(i.fx / f + d * e), exact(d), exact(e)));
}

}  // namespace

CameraModel read_matlab_camera(const std::filesystem::path& path) {
    const Value root = foreign_root(read_text(path), path.string());
    if (const auto nested = root.find("Intrinsics"); nested && nested->find("MappingCoefficients"))
        return read_fisheye(*nested);
    if (root.find("MappingCoefficients"))
        return read_fisheye(root);
    CameraModel camera;
    camera.intrinsics = intrinsics_of(the_camera_matrix(root));
    read_distortion(root, camera);
    read_image_size(root, camera);
    return camera;
}

void write_matlab_camera(const std::filesystem::path& path, const CameraModel& camera) {
    if (camera.projection.kind == Projection::polynomial)
        return write_fisheye(path, camera);
    require_foreign_camera(camera, path, "MATLAB's cameraParameters", {Projection::perspective});
    require_only(camera, first_coefficients(5), path, "MATLAB's cameraParameters");
    const Intrinsics& i = camera.intrinsics;
    const Distortion& d = camera.distortion;
    const std::string fx = exact(i.fx), fy = exact(i.fy), cx = exact(i.cx), cy = exact(i.cy),
                      skew = exact(i.skew);
    write_text(path,
               fmt::format("{{\n"
                           "  \"FocalLength\": [{}, {}],\n"
                           "  \"PrincipalPoint\": [{}, {}],\n"
                           "  \"ImageSize\": [{}, {}],\n"
                           "  \"RadialDistortion\": [{}, {}, {}],\n"
                           "  \"TangentialDistortion\": [{}, {}],\n"
                           "  \"Skew\": {},\n"
                           "  \"K\": [[{}, {}, {}], [0, {}, {}], [0, 0, 1]]\n"
                           "}}\n",
                           fx, fy, cx, cy, camera.height, camera.width, exact(d.k1), exact(d.k2),
                           exact(d.k3), exact(d.p1), exact(d.p2), skew, fx, skew, cx, fy, cy));
}

}  // namespace etalon
