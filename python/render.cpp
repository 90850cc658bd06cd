// etalon.Marker, Renderer, SensorModel: what a calibrated camera sees of a marker.
#include <fmt/format.h>

#include "calib/camera/projector.h"
#include "core/program/errors.h"
#include "python/arrays.h"
#include "python/bindings.h"
#include "python/interruptible.h"
#include "sim/marker/marker.h"
#include "sim/render/renderer.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

// ---- markers

Marker marker_named(const std::string& spec) {
    return without_gil([&] { return parse_marker(spec, "spec"); });
}

std::pair<double, double> pair_of(const Eigen::Vector2d& vector) {
    return {vector.x(), vector.y()};
}

// ---- rendering

// A list of (Marker, camera_from_marker (4, 4)).
Scene scene_of(const py::object& markers, double background) {
    Scene scene;
    scene.background = background;
    for (const py::handle item : markers) {
        if (!py::isinstance<py::tuple>(item) || py::len(item) != 2)
            throw py::type_error("markers: must be (Marker, camera_from_marker) pairs");
        const py::tuple placed = py::reinterpret_borrow<py::tuple>(item);
        scene.markers.push_back(
            {placed[0].cast<const Marker&>().grid, rigid_of(placed[1], "camera_from_marker")});
    }
    return scene;
}

RenderMethod method_named(const std::string& name) {
    for (const auto& [word, method] : {std::pair("automatic", RenderMethod::automatic),
                                       {"exact_lens", RenderMethod::exact_lens},
                                       {"exact_area", RenderMethod::exact_area},
                                       {"reference", RenderMethod::reference},
                                       {"wave", RenderMethod::wave}})
        if (name == word)
            return method;
    throw ConfigError({"method"}, fmt::format("there is no method \"{}\"", name));
}

RenderedImage render(const Renderer& renderer, const py::object& markers, double background,
                     double tolerance_gray, const std::string& method) {
    const Scene scene = scene_of(markers, background);
    RenderOptions options;
    options.method = method_named(method);
    options.tolerance_gray = tolerance_gray;
    return without_gil([&] { return renderer.render(scene, options); });
}

// ---- the sensor

py::array expose(const SensorModel& sensor, const py::array& radiance,
                 const std::optional<std::uint64_t>& seed, std::uint32_t frame) {
    const Radiance shared = radiance_of(radiance, "radiance");
    std::optional<NoiseKey> noise;
    if (seed)
        noise = NoiseKey{*seed, frame};
    return shared_array(without_gil([&] { return sensor.expose(shared, noise); }).pixels);
}

py::array linear_radiance(const SensorModel& sensor, const py::array& image) {
    const CodeImage codes = code_image(image, "image", sensor.bits());
    return shared_array(without_gil([&] { return sensor.linear_radiance(codes); }));
}

}  // namespace

void bind_marker(py::module_& module) {
    py::class_<Marker>(module, "Marker", R"(A marker or board by its name: docs/files.md, "Markers".

Marker frame: x right, y down, z into the marker, as printed and seen from the front; mm.)")
        .def(py::init(&marker_named), py::arg("spec"),
             R"(spec: "apriltag:36h11:5@50mm", "chessboard:9x6@25mm", ... Raises ConfigError.)")
        .def_readonly("spec", &Marker::spec, "The name, as given.")
        .def_readonly("id", &Marker::id, "Of a single tag.")
        .def_readonly("size_mm", &Marker::size_mm, "Side of the tag or of a board's square.")
        .def_property_readonly("points_mm", as_array(&Marker::points_mm),
                               "(N, 3): what detectors report, in the marker frame, mm.")
        .def_property_readonly(
            "cells", [](const Marker& marker) { return shared_array(marker.grid.cells, false); },
            "(rows, columns) float32, read-only: radiance 0 to 1 of each printed cell.")
        .def_property_readonly(
            "corner_mm", [](const Marker& marker) { return pair_of(marker.grid.corner_mm); },
            "(x, y) of the grid's top left corner, mm.")
        .def_property_readonly(
            "cell_mm", [](const Marker& marker) { return pair_of(marker.grid.cell_mm); },
            "(x, y): size of a cell, mm.")
        .def("__repr__",
             [](const Marker& marker) { return fmt::format("<etalon.Marker {}>", marker.spec); });
}

void bind_render(py::module_& module) {
    py::class_<RenderedImage>(module, "RenderedImage", "What Renderer.render() makes.")
        .def_property_readonly(
            "radiance", [](const RenderedImage& image) { return shared_array(image.radiance); },
            "(height, width) float32: linear radiance, 1 = full scale.")
        .def_property_readonly(
            "valid", [](const RenderedImage& image) { return shared_array(image.valid, false); },
            "(height, width) uint8, read-only: 255 where the pixel has a ray, else 0.")
        .def_property_readonly(
            "plan", [](const RenderedImage& image) { return image.plan.describe(); },
            "How it was rendered and what was left out, with bounds; one line.");

    py::class_<Renderer>(module, "Renderer",
                         R"(Renders markers as a camera sees them, in linear radiance.

One per camera: holds what it learns of it. Safe from every thread.)")
        .def(py::init([](const Projector& camera) {
                 return without_gil([&] { return Renderer(camera.camera()); });
             }),
             py::arg("camera"))
        .def("render", &render, py::arg("markers"), py::kw_only(), py::arg("background") = 1.0,
             py::arg("tolerance_gray") = 0.1, py::arg("method") = "automatic",
             R"(A RenderedImage of markers at their poses.

markers: a list of (Marker, camera_from_marker), the latter (4, 4), mm. background: radiance around
them, 1 = full scale. tolerance_gray: largest error aimed at, 1/255 of full scale. method: automatic,
exact_lens, exact_area, reference (slow) or wave. Raises NumericalError for a marker behind the
lens or hidden by another one.)");

    py::class_<SensorModel>(module, "SensorModel",
                            R"(The sensor behind the lens: code values from radiance, and back.

Safe from every thread. Raises ConfigError for a sensor section that contradicts itself.)")
        .def(py::init([](const Projector& camera) {
                 return without_gil([&] { return SensorModel(camera.camera()); });
             }),
             py::arg("camera"))
        .def("expose", &expose, py::arg("radiance"), py::kw_only(), py::arg("seed") = py::none(),
             py::arg("frame") = 0,
             R"(Code values (height, width), uint8 or uint16, of radiance (height, width) float32.

A longer exposure is a larger radiance. seed: with the sensor's noise, a function of (seed, frame,
pixel). Raises NumericalError for another size than the camera's and what is not finite.)")
        .def("linear_radiance", &linear_radiance, py::arg("image"),
             R"(Radiance at the sensor, (height, width) float32, of code values.

Black level and curve are undone, the relative response is not.)")
        .def_property_readonly("bits", &SensorModel::bits, "Full scale is 2^bits - 1.");
}

}  // namespace etalon
