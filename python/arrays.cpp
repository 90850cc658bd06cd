#include "python/arrays.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "compare/photo_pose.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

std::string shape_text(const py::array& values) {
    std::vector<py::ssize_t> shape(values.shape(), values.shape() + values.ndim());
    return fmt::format("({}{})", fmt::join(shape, ", "), shape.size() == 1 ? "," : "");
}

[[noreturn]] void refuse_type(const char* name, const char* wanted, const py::array& values) {
    throw py::type_error(
        fmt::format("{}: must be {}, is {}", name, wanted, std::string(py::str(values.dtype()))));
}

[[noreturn]] void refuse_shape(const char* name, const std::string& wanted,
                               const py::array& values) {
    throw ConfigError({name}, fmt::format("must be {}, is {}", wanted, shape_text(values)));
}

// Any shape, float64 in a line of memory.
NumberArray real_numbers(const py::object& values, const char* name) {
    const py::array array = py::array::ensure(values);
    if (!array) {
        PyErr_Clear();
        throw py::type_error(fmt::format("{}: must be an array of real numbers", name));
    }
    if (std::string_view("fiu").find(array.dtype().kind()) == std::string_view::npos)
        refuse_type(name, "an array of real numbers", array);
    if (NumberArray numbers = NumberArray::ensure(array))
        return numbers;
    refuse_type(name, "an array of numbers that float64 holds", array);
}

template <int Size>
std::vector<Eigen::Matrix<double, Size, 1>> vector_list(const py::object& values,
                                                        const char* name) {
    const NumberArray array = real_numbers(values, name);
    if (array.ndim() != 2 || array.shape(1) != Size)
        refuse_shape(name, fmt::format("(N, {})", Size), array);
    std::vector<Eigen::Matrix<double, Size, 1>> list;
    list.reserve(static_cast<std::size_t>(array.shape(0)));
    for (py::ssize_t i = 0; i < array.shape(0); ++i)
        list.emplace_back(array.data(i));
    return list;
}

template <int Size>
NumberArray array_of_vectors(const std::vector<Eigen::Matrix<double, Size, 1>>& list) {
    NumberArray array({static_cast<py::ssize_t>(list.size()), py::ssize_t{Size}});
    double* to = array.mutable_data();
    for (const auto& vector : list)
        to = std::copy(vector.begin(), vector.end(), to);
    return array;
}

// `type` is OpenCV's, of the array's elements.
cv::Mat over(const py::array& values, int type, const char* name) {
    constexpr py::ssize_t most = std::numeric_limits<int>::max();
    const py::ssize_t item = values.itemsize();
    if (values.ndim() != 2 || values.shape(0) < 1 || values.shape(1) < 1 ||
        values.shape(0) > most || values.shape(1) > most)
        refuse_shape(name, "(height, width), one channel", values);
    const py::ssize_t row = item * values.shape(1);
    const py::ssize_t step = values.shape(0) > 1 ? values.strides(0) : row;
    const bool is_aligned = (values.flags() & py::detail::npy_api::NPY_ARRAY_ALIGNED_) != 0;
    if ((values.shape(1) > 1 && values.strides(1) != item) || step < row || !is_aligned)
        throw ConfigError(
            {name},
            "pixels of a row must lie side by side and aligned: copy() of the array does it");
    return {static_cast<int>(values.shape(0)), static_cast<int>(values.shape(1)), type,
            const_cast<void*>(values.data()), static_cast<std::size_t>(step)};
}

template <class Type>
bool holds(const py::array& values) {
    return py::isinstance<py::array_t<Type>>(values);
}

py::dtype type_of(const cv::Mat& image) {
    switch (image.type()) {
        case CV_8UC1:
            return py::dtype::of<std::uint8_t>();
        case CV_16UC1:
            return py::dtype::of<std::uint16_t>();
        case CV_32FC1:
            return py::dtype::of<float>();
    }
    throw std::logic_error("an image of a type that is not shared");
}

}  // namespace

NumberArray number_rows(const py::object& values, py::ssize_t columns, const char* name) {
    NumberArray array = real_numbers(values, name);
    if (array.ndim() == 0 || array.shape(array.ndim() - 1) != columns)
        refuse_shape(name, fmt::format("(..., {})", columns), array);
    return array;
}

std::vector<py::ssize_t> shape_like(const NumberArray& rows, std::vector<py::ssize_t> last) {
    last.insert(last.begin(), rows.shape(), rows.shape() + rows.ndim() - 1);
    return last;
}

std::vector<Eigen::Vector2d> pixel_list(const py::object& values, const char* name) {
    return vector_list<2>(values, name);
}

std::vector<Eigen::Vector3d> point_list(const py::object& values, const char* name) {
    return vector_list<3>(values, name);
}

void require_finite(const NumberArray& numbers, const char* name) {
    if (!std::all_of(numbers.data(), numbers.data() + numbers.size(),
                     [](double number) { return std::isfinite(number); }))
        throw ConfigError({name}, "must be finite numbers");
}

std::vector<double> number_list(const py::object& values, const char* name) {
    const NumberArray array = real_numbers(values, name);
    if (array.ndim() != 1)
        refuse_shape(name, "(N,)", array);
    require_finite(array, name);
    return {array.data(), array.data() + array.size()};
}

Rigid rigid_of(const py::object& values, const char* name) {
    const NumberArray array = real_numbers(values, name);
    if (array.ndim() != 2 || array.shape(0) != 4 || array.shape(1) != 4)
        refuse_shape(name, "(4, 4)", array);
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(array.data());
    const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
    const double off = (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() +
                       (matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm();
    if (!matrix.allFinite() || !(off < 1e-6) || rotation.determinant() < 0.0)
        throw ConfigError({name}, "must be a rigid transform [R t; 0 0 0 1], R a rotation");
    return {Eigen::Quaterniond(rotation).normalized(), matrix.topRightCorner<3, 1>()};
}

NumberArray array_of(const Rigid& transform) {
    Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
    matrix.topLeftCorner<3, 3>() = transform.rotation.toRotationMatrix();
    matrix.topRightCorner<3, 1>() = transform.translation;
    return array_of(Eigen::MatrixXd(matrix));
}

NumberArray array_of(const std::vector<Rigid>& transforms) {
    NumberArray matrices(
        {static_cast<py::ssize_t>(transforms.size()), py::ssize_t{4}, py::ssize_t{4}});
    double* to = matrices.mutable_data();
    for (const Rigid& transform : transforms)
        to = std::copy_n(array_of(transform).data(), 16, to);
    return matrices;
}

NumberArray array_of(const Eigen::MatrixXd& matrix) {
    NumberArray array({matrix.rows(), matrix.cols()});
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
        array.mutable_data(), matrix.rows(), matrix.cols()) = matrix;
    return array;
}

NumberArray array_of(const std::vector<double>& numbers) {
    return NumberArray(static_cast<py::ssize_t>(numbers.size()), numbers.data());
}

NumberArray array_of(const std::vector<Eigen::Vector2d>& pixels) {
    return array_of_vectors<2>(pixels);
}

NumberArray array_of(const std::vector<Eigen::Vector3d>& points) {
    return array_of_vectors<3>(points);
}

py::object array_of(const std::optional<Rigid>& transform) {
    return transform ? py::object(array_of(*transform)) : py::none();
}

CodeImage code_image(const py::array& values, const char* name, int bits) {
    const bool is_byte = holds<std::uint8_t>(values);
    if (!is_byte && !holds<std::uint16_t>(values))
        refuse_type(name, "uint8 or uint16", values);
    const int most = is_byte ? 8 : 16;
    if (bits != 0 && (bits < (is_byte ? 1 : 9) || bits > most))
        refuse_type(name, bits > 8 ? "uint16" : "uint8", values);
    return {over(values, is_byte ? CV_8UC1 : CV_16UC1, name), bits == 0 ? most : bits};
}

CodeImage photo_of(const py::array& values, const CameraModel& camera, const char* name) {
    return taken_by(camera, code_image(values, name), name, "that was given");
}

Radiance radiance_of(const py::array& values, const char* name) {
    if (!holds<float>(values))
        refuse_type(name, "float32", values);
    return over(values, CV_32FC1, name);
}

py::array shared_array(const cv::Mat& image, bool is_writable) {
    auto owner = std::make_unique<cv::Mat>(image);
    const py::capsule keeper(owner.get(), [](void* kept) { delete static_cast<cv::Mat*>(kept); });
    const cv::Mat& kept = *owner.release();
    py::array array(
        type_of(kept), {kept.rows, kept.cols},
        {static_cast<py::ssize_t>(kept.step[0]), static_cast<py::ssize_t>(kept.elemSize())},
        kept.data, keeper);
    if (!is_writable)
        array.attr("flags").attr("writeable") = false;
    return array;
}

}  // namespace etalon
