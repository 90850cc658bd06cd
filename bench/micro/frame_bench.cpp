// What surrounds the kernels: the undistortion map, whole frames with their filters, the sensor.
#include <benchmark/benchmark.h>

#include <array>

#include "bench/benchmark_scenes.h"
#include "sim/render/renderer.h"
#include "sim/sensor/sensor_model.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {
namespace {

std::int64_t pixels(const CameraModel& camera) {
    return std::int64_t{camera.width} * camera.height;
}

void build_undistortion_map(benchmark::State& state) {
    const CameraModel camera = benchmark_scene("webcam-500").camera;
    const Projector projector(camera);
    constexpr int block_px = UndistortionMap::block_side * tile_px;
    for (auto _ : state) {
        const UndistortionMap map(projector, 0);
        for (int y = 0; y < camera.height; y += block_px)
            for (int x = 0; x < camera.width; x += block_px)
                benchmark::DoNotOptimize(map.validity(x / tile_px, y / tile_px));
    }
    state.SetItemsProcessed(state.iterations() * pixels(camera));
}
BENCHMARK(build_undistortion_map)->Unit(benchmark::kMillisecond);

void sample_undistortion_map(benchmark::State& state) {
    const UndistortionMap map(Projector(benchmark_scene("webcam-500").camera), 0);
    const int n = static_cast<int>(state.range(0));
    std::vector<std::optional<MappedPoint>> points;
    int tile = 0;
    for (auto _ : state) {
        map.sample(tile % 100, tile / 100, n, points);
        benchmark::DoNotOptimize(points.data());
        tile = (tile + 37) % 10000;
    }
    state.SetItemsProcessed(state.iterations() * n * n);
}
BENCHMARK(sample_undistortion_map)->Arg(4)->Arg(16)->Arg(36);

// The default plan with warm caches: tiles, core filter and tails.
void render_frame(benchmark::State& state, const std::string& name) {
    const BenchmarkScene benchmark = benchmark_scene(name);
    const Renderer renderer(benchmark.camera);
    renderer.render(benchmark.scene);  // makes the filters
    for (auto _ : state)
        benchmark::DoNotOptimize(renderer.render(benchmark.scene).radiance.data);
    state.SetItemsProcessed(state.iterations() * pixels(benchmark.camera));
}
BENCHMARK_CAPTURE(render_frame, webcam_500, "webcam-500")
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(render_frame, sharp_1000, "sharp-1000")
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime();

// A measured curve: straight lines through 41 points.
Transfer measured_curve() {
    Transfer transfer{Transfer::Kind::table, {}};
    for (int i = 0; i <= 40; ++i)
        transfer.table.emplace_back(i / 40.0, i / 40.0 * (1.6 - 0.6 * i / 40.0));
    return transfer;
}

// From radiance to codes: of a rendered frame, most of which is background or (Canon) none; with
// noise, or not.
void expose(benchmark::State& state, const std::string& name) {
    BenchmarkScene benchmark = benchmark_scene(name);
    Sensor& section = *benchmark.camera.sensor;
    section.transfer = std::array{Transfer{}, Transfer{Transfer::Kind::rec709, {}},
                                  measured_curve()}[static_cast<std::size_t>(state.range(0))];
    section.bits = static_cast<int>(state.range(1));
    section.gain_e_per_dn = state.range(2) ? 20.0 : 0.0;
    const SensorModel sensor(benchmark.camera);
    const Radiance radiance = Renderer(benchmark.camera).render(benchmark.scene).radiance;
    const auto key = state.range(2) ? std::optional(NoiseKey{1, 2}) : std::nullopt;
    for (auto _ : state)
        benchmark::DoNotOptimize(sensor.expose(radiance, key));
    state.SetItemsProcessed(state.iterations() * pixels(benchmark.camera));
}
BENCHMARK_CAPTURE(expose, webcam_500, "webcam-500")
    ->ArgNames({"linear_rec709_table", "bits", "noise"})
    ->ArgsProduct({{0, 1, 2}, {8, 12, 16}, {0, 1}})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(expose, canon_500, "canon-500")
    ->ArgNames({"linear_rec709_table", "bits", "noise"})
    ->ArgsProduct({{0, 1, 2}, {8, 12, 16}, {0}})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime();

}  // namespace
}  // namespace etalon
