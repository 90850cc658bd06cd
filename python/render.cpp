// etalon.Marker, Renderer, SensorModel: what a calibrated camera sees of a marker.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "calib/camera/projector.h"
#include "core/program/errors.h"
#include "python/arrays.h"
#include "python/interruptible.h"
#include "sim/marker/marker.h"
#include "sim/render/renderer.h"

namespace etalon {
namespace {

Marker marker_named(const std::string& spec) {
    return without_gil([&] { return parse_marker(spec, "spec"); });
}

std::pair<double, double> pair_of(const Eigen::Vector2d& vector) {
    return {vector.x(), vector.y()};
}

// "(ndarray, Marker)": what was given in place of a pair.
std::string pair_words(py::handle item) {
    if (!py::isinstance<py::tuple>(item))
        return given_words(item);
    std::vector<std::string> words;
    for (const py::handle part : item)
        words.push_back(given_words(part));
    return fmt::format("({})", fmt::join(words, ", "));
}

// A list of (Marker, camera_from_marker (4, 4)).
Scene scene_of(const py::object& markers, double background) {
    Scene scene;
    scene.background = background;
    if (!py::isinstance<py::iterable>(markers))
        throw py::type_error(
            fmt::format("markers: must be a list of (Marker, camera_from_marker), is {}",
                        given_words(markers)));
    for (const py::handle item : markers) {
        const py::tuple placed =
            py::isinstance<py::tuple>(item) ? py::reinterpret_borrow<py::tuple>(item) : py::tuple();
        if (placed.size() != 2 || !py::isinstance<Marker>(placed[0]))
            throw py::type_error(
                fmt::format("markers: [{}] must be (Marker, camera_from_marker), is {}",
                            scene.markers.size(), pair_words(item)));
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
    const auto& lens = renderer.camera().lens;
    const bool is_wave = lens && lens->psf.kind == PointSpread::Kind::wave;
    if (options.method != RenderMethod::reference && !is_wave)
        return without_gil([&] { return renderer.render(scene, options); });
    return interruptible([&](std::stop_token stop) {
        options.stop = std::move(stop);
        return renderer.render(scene, options);
    });
}

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

void bind_marker(Module& module) {
    Bound<Marker>(module, "Marker", R"(A marker or board by its name: docs/files.md, "Markers".

Marker frame: x right, y down, z into the marker, as printed and seen from the front; mm.)")
        .init(&marker_named, "spec"_a,
              R"(spec: "apriltag:36h11:5@50mm", "chessboard:9x6@25mm", ... Raises ConfigError.)")
        .get("spec", "The name, as given.", &Marker::spec)
        .get("id", "Of a single tag.", &Marker::id)
        .get("size_mm", "Side of the tag or of a board's square.", &Marker::size_mm)
        .get("points_mm", "(N, 3): what detectors report, in the marker frame, mm.",
             as_array(&Marker::points_mm))
        .get("cells", "(rows, columns) float32, read-only: radiance 0 to 1 of each printed cell.",
             [](const Marker& marker) { return shared_array(marker.grid.cells, false); })
        .get("corner_mm", "(x, y) of the grid's top left corner, mm.",
             [](const Marker& marker) { return pair_of(marker.grid.corner_mm); })
        .get("cell_mm", "(x, y): size of a cell, mm.",
             [](const Marker& marker) { return pair_of(marker.grid.cell_mm); })
        .def("__repr__",
             [](const Marker& marker) { return fmt::format("<etalon.Marker {}>", marker.spec); });
}

void bind_render(Module& module) {
    Bound<RenderedImage>(module, "RenderedImage", "What Renderer.render() makes.")
        .get("radiance", "(height, width) float32: linear radiance, 1 = full scale.",
             [](const RenderedImage& image) { return shared_array(image.radiance); })
        .get("valid", "(height, width) uint8, read-only: 255 where the pixel has a ray, else 0.",
             [](const RenderedImage& image) { return shared_array(image.valid, false); })
        .get("plan", "How it was rendered and what was left out, with bounds; one line.",
             [](const RenderedImage& image) { return image.plan.describe(); });

    Bound<Renderer>(module, "Renderer",
                    R"(Renders markers as a camera sees them, in linear radiance.

One per camera: holds what it learns of it. Safe from every thread.)")
        .init(
            [](const Projector& camera) {
                return without_gil([&] { return Renderer(camera.camera()); });
            },
            "camera"_a)
        .def("render", &render, "markers"_a, py::kw_only(), "background"_a = 1.0,
             "tolerance_gray"_a = 0.1, "method"_a = "automatic",
             R"(A RenderedImage of markers at their poses.

markers: a list of (Marker, camera_from_marker), the latter (4, 4), mm. background: radiance around
them, 1 = full scale. tolerance_gray: largest error aimed at, 1/255 of full scale. method: automatic,
exact_lens, exact_area, reference (slow) or wave. Raises NumericalError for a marker behind the
lens or hidden by another one.)");

    Bound<SensorModel>(module, "SensorModel",
                       R"(The sensor behind the lens: code values from radiance, and back.

Safe from every thread. Raises ConfigError for a sensor section that contradicts itself.)")
        .init(
            [](const Projector& camera) {
                return without_gil([&] { return SensorModel(camera.camera()); });
            },
            "camera"_a)
        .def("expose", &expose, "radiance"_a, py::kw_only(), "seed"_a = py::none(), "frame"_a = 0,
             R"(Code values (height, width), uint8 or uint16, of radiance (height, width) float32.

A longer exposure is a larger radiance. seed: with the sensor's noise, a function of (seed, frame,
pixel). Raises NumericalError for another size than the camera's and what is not finite.)")
        .def("linear_radiance", &linear_radiance, "image"_a,
             R"(Radiance at the sensor, (height, width) float32, of code values.

Black level and curve are undone, the relative response is not.)")
        .get("bits", "Full scale is 2^bits - 1.", &SensorModel::bits);
}

}  // namespace etalon
