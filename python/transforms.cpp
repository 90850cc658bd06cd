// Poses as six numbers, and images as files.

#include "python/arrays.h"
#include "python/interruptible.h"
#include "report/number_text.h"
#include "sim/scene/pose_file.h"

namespace etalon {
namespace {

NumberArray from_vector(const py::object& pose) {
    const NumberArray numbers = number_rows(pose, 6, "pose");
    require_finite(numbers, "pose");
    std::vector<Rigid> transforms;
    for (py::ssize_t i = 0; i < numbers.size(); i += 6)
        transforms.push_back(rigid_from_vector(Vector6d(numbers.data() + i)));
    return array_of(transforms).reshape(shape_like(numbers, {4, 4}));
}

NumberArray to_vector(const py::object& transform) {
    return array_of(numbers_of(vector_from_rigid(rigid_of(transform, "transform"))));
}

NumberArray poses_of_file(const std::filesystem::path& path) {
    return array_of(without_gil([&] { return read_poses(path); }));
}

py::array image_of_file(const std::filesystem::path& path) {
    return shared_array(without_gil([&] { return read_image(path); }).pixels);
}

void image_to_file(const std::filesystem::path& path, const py::array& image) {
    const CodeImage codes = code_image(image, "image");
    without_gil([&] { write_image(path, codes); });
}

void radiance_to_file(const std::filesystem::path& path, const py::array& radiance) {
    const Radiance shared = radiance_of(radiance, "radiance");
    without_gil([&] { write_radiance(path, shared); });
}

}  // namespace

void bind_transforms(Module& module) {
    module.def("rigid_from_vector", &from_vector, "pose"_a,
               R"(Transforms (..., 4, 4) of poses (..., 6): rx, ry, rz (rad), tx, ty, tz (mm).)");
    module.def(
        "vector_from_rigid", &to_vector, "transform"_a,
        R"(The six numbers of a transform (4, 4): rotation vector (rad), translation (mm).)");
    module.def("read_poses", &poses_of_file, "path"_a,
               R"(Transforms (N, 4, 4) of a pose file, CSV or JSON. Raises ConfigError.)");
    module.def("read_image", &image_of_file, "path"_a,
               R"(A PNG, TIFF or JPEG as (height, width) uint8 or uint16; colour becomes luma.

Raises ConfigError with the path.)");
    module.def("write_image", &image_to_file, "path"_a, "image"_a,
               R"(Writes (height, width) uint8 or uint16 as PNG or TIFF, by the file's extension.

Raises ConfigError with the path.)");
    module.def("write_radiance", &radiance_to_file, "path"_a, "radiance"_a,
               R"(Writes (height, width) float32 as a 32-bit TIFF. Raises ConfigError.)");
}

}  // namespace etalon
