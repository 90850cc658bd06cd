#include "calib/files/matlab_file.h"

#include <fmt/format.h>

#include "calib/files/foreign_camera.h"
#include "calib/files/foreign_value.h"
#include "calib/files/pixel_origin.h"
#include "core/text.h"

namespace etalon {
namespace {

ForeignMatrix transposed(const ForeignMatrix& matrix) {
    ForeignMatrix result = matrix;
    for (std::size_t row = 0; row < 3; ++row)
        for (std::size_t col = 0; col < 3; ++col)
            result.values[3 * row + col] = matrix.values[3 * col + row];
    return result;
}

// fx skew cx, 0 fy cy, 0 0 1.
ForeignMatrix matrix_of_lengths(const ForeignValue& root) {
    const ForeignValue focal = root.at("FocalLength");
    const auto f = focal.numbers(2), c = root.at("PrincipalPoint").numbers(2);
    const auto skew = root.find("Skew");
    const double s = skew ? skew->number() : 0.0;
    return {focal.place(), 3, 3, {f[0], s, c[0], 0.0, f[1], c[1], 0.0, 0.0, 1.0}};
}

std::vector<ForeignMatrix> camera_matrices(const ForeignValue& root) {
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

ForeignMatrix the_camera_matrix(const ForeignValue& root) {
    const std::vector<ForeignMatrix> all = camera_matrices(root);
    if (all.empty())
        root.fail("has none of K, IntrinsicMatrix and FocalLength");
    for (const ForeignMatrix& other : all)
        if (!agree(all.front(), other))
            throw ConfigError(other.place, "contradicts " + all.front().place.key);
    if (const auto skew = root.find("Skew"))
        if (!(std::abs(skew->number() - all.front().values[1]) <= 1e-6))
            skew->fail("contradicts " + all.front().place.key);
    return all.front();
}

ForeignMatrix distortion_of(const ForeignValue& root) {
    const ForeignValue radial = root.at("RadialDistortion");
    const std::vector<double> k = radial.numbers();
    if (k.size() != 2 && k.size() != 3)
        radial.fail(fmt::format("must have 2 or 3 coefficients, not {}", k.size()));
    std::vector<double> p{0.0, 0.0};
    if (const auto tangential = root.find("TangentialDistortion"))
        p = tangential->numbers(2);
    return {radial.place(), 1, 5, {k[0], k[1], p[0], p[1], k.size() == 3 ? k[2] : 0.0}};
}

}  // namespace

CameraModel read_matlab_camera(const std::filesystem::path& path) {
    const ForeignValue root = ForeignValue::parse(read_text(path), path.string());
    if (const auto fisheye = root.find("MappingCoefficients"))
        fisheye->fail("belongs to fisheyeParameters, a model that is not here");
    CameraModel camera = camera_from_matrices(the_camera_matrix(root), distortion_of(root));
    camera.intrinsics = from_pixels_of(CalibrationTool::matlab, camera.intrinsics);
    if (const auto size = root.find("ImageSize"); size && !size->numbers().empty()) {
        const auto sides = size->numbers(2);
        camera.height = checked_image_side(sides[0], size->place());
        camera.width = checked_image_side(sides[1], size->place());
    }
    return camera;
}

void write_matlab_camera(const std::filesystem::path& path, const CameraModel& camera) {
    require_foreign_camera(camera, path, "MATLAB's cameraParameters");
    shortest_distortion(camera, {5}, path, "MATLAB's cameraParameters");
    const Intrinsics i = to_pixels_of(CalibrationTool::matlab, camera.intrinsics);
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
