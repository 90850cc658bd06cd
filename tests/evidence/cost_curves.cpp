// How the cost of a frame grows with what is in it, each quantity alone: pixels, cells, markers,
// blur, frames, cores. Prints a table with the slope of each step in double logarithmic paper (1:
// in proportion) and writes a picture of the curves: docs/performance.md has both.
//     build/release/tests/evidence/cost_curves [PICTURE.svg]
#include <fmt/format.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "bench/bench_methods.h"
#include "report/svg_plot.h"
#include "sim/marker/marker.h"

namespace etalon {
namespace {

// The bench's webcam with so many times as many pixels a side, all else as it is.
CameraModel finer(CameraModel camera, double times) {
    camera.width = static_cast<int>(camera.width * times);
    camera.height = static_cast<int>(camera.height * times);
    for (double* length : {&camera.intrinsics.fx, &camera.intrinsics.fy, &camera.intrinsics.cx,
                           &camera.intrinsics.cy})
        *length *= times;
    camera.sensor->pixel_pitch_um /= times;
    return camera;
}

PlacedMarker placed(const std::string& spec, const Rigid& pose) {
    return {parse_marker(spec, "cost curves").grid, pose};
}

double frame_ms(const CameraModel& camera, const Scene& scene) {
    const Renderer renderer(camera);
    return median_cpu_ms([&] { renderer.render(scene); });
}

// A 12-megapixel camera without distortion, sharp at 500 mm, and a plane of tags there.
CameraModel large_camera() {
    CameraModel camera = benchmark_scene("sharp-500").camera;
    camera.width = 4000;
    camera.height = 3000;
    camera.intrinsics = {4000, 4000, 1999.5, 1499.5};
    camera.distortion = {};
    camera.sensor->pixel_pitch_um = 3.0;
    camera.lens->focus_distance_mm = 500.0;
    return camera;
}

Scene tags(int count) {
    constexpr double z_mm = 500.0, spacing_mm = 12.0;
    const int columns = std::max(1, static_cast<int>(std::ceil(std::sqrt(count * 4.0 / 3.0))));
    Scene scene;
    for (int i = 0; i < count; ++i) {
        Rigid pose;
        pose.translation = {(i % columns - 0.5 * (columns - 1)) * spacing_mm,
                            (i / columns - 0.5 * (count / columns)) * spacing_mm, z_mm};
        scene.markers.push_back(placed(fmt::format("apriltag:36h11:{}@8mm", i % 587), pose));
    }
    return scene;
}

struct Curve {
    std::string name, unit;
    Series times;

    void add(double x, double ms) {
        const std::size_t n = times.xs.size();
        const std::string slope = n == 0 ? ""
                                         : fmt::format("{:.2f}", std::log(ms / times.ys[n - 1]) /
                                                                     std::log(x / times.xs[n - 1]));
        fmt::print("| {} | {:.4g} {} | {:.3g} | {} |\n", n == 0 ? name : "", x, unit, ms, slope);
        std::fflush(stdout);
        times.add(x, ms);
    }
};

Curve pixels() {
    Curve curve{"pixels", "Mpx", {}};
    const BenchmarkScene base = benchmark_scene("webcam-500");
    for (const double times : {1.0, 2.0, 4.0, 8.0, 12.8}) {
        const CameraModel camera = finer(base.camera, times);
        curve.add(1e-6 * camera.width * camera.height, frame_ms(camera, base.scene));
    }
    return curve;
}

Curve cells() {
    Curve curve{"cells of a marker", "", {}};
    const BenchmarkScene base = benchmark_scene("webcam-500");
    const CameraModel camera = finer(base.camera, 4.0);
    for (const int side : {8, 16, 32, 64, 128, 200}) {
        const std::string spec =
            fmt::format("chessboard:{}x{}@{}mm", side - 1, side - 1, 50.0 / side);
        curve.add(side * side,
                  frame_ms(camera, {{placed(spec, base.scene.markers[0].camera_from_marker)}}));
    }
    return curve;
}

Curve markers() {
    Curve curve{"markers in 12 Mpx", "", {}};
    const CameraModel camera = large_camera();
    for (const int count : {1, 3, 10, 30, 100, 300, 1000})
        curve.add(count, frame_ms(camera, tags(count)));
    return curve;
}

// A tag of 1000 px at 500 mm, the lens focused elsewhere.
Curve blur() {
    Curve curve{"blur radius", "px", {}};
    CameraModel camera = large_camera();
    const Rigid pose = benchmark_scene("webcam-500").scene.markers[0].camera_from_marker;
    const Scene scene{{placed("apriltag:36h11:0@100mm", {pose.rotation, {3.0, -2.0, 500.0}})}};
    for (const double radius_px : {1.0, 3.0, 10.0, 30.0, 100.0, 200.0}) {
        // radius = f / 2 D |1/z - 1/focus| with D from the f-number: the focus is solved for.
        const double f_mm = 4000 * 3e-3, aperture_mm = f_mm / camera.lens->f_number;
        const double per_mm = radius_px / (0.5 * aperture_mm * 4000.0);
        camera.lens->focus_distance_mm = 1.0 / (1.0 / 500.0 + per_mm);
        curve.add(radius_px, frame_ms(camera, scene));
    }
    return curve;
}

double wall_ms(const std::function<void()>& work) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
        .count();
}

void render_many(const BenchmarkScene& scene, const Renderer& renderer, int frames) {
    tbb::parallel_for(0, frames, [&](int i) {
        Scene moved = scene.scene;
        moved.markers[0].camera_from_marker.translation.z() += 0.1 * (i % 100);
        renderer.render(moved);
    });
}

Curve frames() {
    Curve curve{"frames, wall time", "", {}};
    const BenchmarkScene scene = benchmark_scene("webcam-500");
    const Renderer renderer(scene.camera);
    for (const int count : {10, 100, 1000, 10000})
        curve.add(count, wall_ms([&] { render_many(scene, renderer, count); }));
    return curve;
}

Curve cores() {
    Curve curve{"cores, wall time of 4000 frames", "", {}};
    const BenchmarkScene scene = benchmark_scene("webcam-500");
    const Renderer renderer(scene.camera);
    for (unsigned count = 1; count <= std::thread::hardware_concurrency(); count *= 2) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, count);
        curve.add(count, wall_ms([&] { render_many(scene, renderer, 4000); }));
    }
    return curve;
}

void write_picture(const std::vector<Curve>& curves, const char* path) {
    std::vector<SvgPlot> plots;
    for (const Curve& curve : curves) {
        SvgPlot& plot =
            plots.emplace_back(curve.name + (curve.unit.empty() ? "" : ", " + curve.unit), "ms");
        plot.set_log_axes();
        plot.add_curve(curve.times, Color::blue, "measured");
    }
    std::ofstream(path) << svg_panels(plots, 3, 480, 320);
}

}  // namespace
}  // namespace etalon

int main(int argc, char** argv) {
    using namespace etalon;
    keep_freed_memory();
    fmt::print("| of | at | CPU ms | slope |\n|---|---|---|---|\n");
    std::vector<Curve> curves;
    {
        const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
        for (const auto measured : {pixels, cells, markers, blur})
            curves.push_back(measured());
    }
    curves.push_back(frames());
    curves.push_back(cores());
    if (argc > 1)
        write_picture(curves, argv[1]);
}
