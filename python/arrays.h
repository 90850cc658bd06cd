// numpy arrays in and out. What comes in is refused by the argument's name: another type is a
// TypeError ("points_camera: ..."), another shape a ConfigError. Images are shared, never copied: a
// cv::Mat over numpy's memory for the time of a call, and a numpy array over a cv::Mat's memory for
// as long as the array lives.
//
// Everything here needs the GIL.
#pragma once

#include <pybind11/numpy.h>

#include "calib/camera/camera_model.h"
#include "core/geometry/rigid.h"
#include "python/arguments.h"

namespace etalon {

using NumberArray =
    py::array_t<double, int{py::array::c_style} | int{py::detail::npy_api::NPY_ARRAY_ALIGNED_}>;

// Real numbers (..., columns) in a line of memory, as double; a type that double does not hold
// (numpy.longdouble) is refused.
NumberArray number_rows(const py::object& values, py::ssize_t columns, const char* name);
// `shape` with its last dimensions replaced: (..., 3) -> (..., 2).
std::vector<py::ssize_t> shape_like(const NumberArray& rows, std::vector<py::ssize_t> last);

// (N, 2) and (N, 3), or nothing else.
std::vector<Eigen::Vector2d> pixel_list(const py::object& values, const char* name);
std::vector<Eigen::Vector3d> point_list(const py::object& values, const char* name);
// For what must not pass NaN on. Throws ConfigError.
void require_finite(const NumberArray& numbers, const char* name);
// (N,), finite
std::vector<double> number_list(const py::object& values, const char* name);

// A (4, 4) matrix [R t; 0 0 0 1] whose R is a rotation to 1e-6, mm.
Rigid rigid_of(const py::object& values, const char* name);

// (4, 4), (rows, columns), (N,), (N, 2), (N, 3): float64.
NumberArray array_of(const Rigid& transform);
NumberArray array_of(const std::vector<Rigid>& transforms);  // (N, 4, 4)
NumberArray array_of(const Eigen::MatrixXd& matrix);
NumberArray array_of(const std::vector<double>& numbers);
NumberArray array_of(const std::vector<Eigen::Vector2d>& pixels);
NumberArray array_of(const std::vector<Eigen::Vector3d>& points);
py::object array_of(const std::optional<Rigid>& transform);  // or None

// A getter: the member of an object as an array.
template <class Object, class Member>
auto as_array(Member Object::*member) {
    return [member](const Object& object) { return array_of(object.*member); };
}
// uint8 or uint16, (height, width); `bits` 0: as the type. Shares memory, which must outlive it.
CodeImage code_image(const py::array& values, const char* name, int bits = 0);
// The same as a photograph of this camera, of its size and bits.
CodeImage photo_of(const py::array& values, const CameraModel& camera, const char* name);
// float32, (height, width), shared in the same way.
Radiance radiance_of(const py::array& values, const char* name);

// uint8, uint16 or float32, (height, width), over the image's own memory.
py::array shared_array(const cv::Mat& image, bool is_writable = true);

// What each file of this folder adds to the module `etalon`: etalon/__init__.pyi, docs/python.md.
void bind_transforms(Module& module);
void bind_camera(Module& module);
void bind_marker(Module& module);
void bind_render(Module& module);
void bind_detect(Module& module);
void bind_photometric(Module& module);
void bind_calibrate(Module& module);
void bind_compare(Module& module);
void bind_devices(Module& module);
void bind_station(Module& module);
void bind_study(Module& module);
void bind_twin(Module& module);

}  // namespace etalon
