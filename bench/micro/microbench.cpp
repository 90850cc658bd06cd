// Prints a table of the inner loops' speed (items are points or pixels) in 10 s: the renderer's
// kernels, the undistortion map, the sensor, arriving frames. Whole renders: etalon bench.
#include "sim/tiles/vector_targets.h"

#include <benchmark/benchmark.h>
#include <hwy/targets.h>

#include <cstring>

#include "bench/benchmark_scenes.h"
#include "capture/frame/frame_checks.h"
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

// A measured curve: straight lines through 41 points.
Transfer measured_curve() {
    Transfer transfer{Transfer::Kind::table, {}};
    for (int i = 0; i <= 40; ++i)
        transfer.table.emplace_back(i / 40.0, i / 40.0 * (1.6 - 0.6 * i / 40.0));
    return transfer;
}

// From radiance to codes: of a rendered frame, most of which is background or (Canon) none.
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

// A frame of 5 megapixels from the library's buffer to the caller's image (copy, unpack, checks),
// beside a plain copy of its bytes: `x_memcpy`. Fresh memory for every frame on both sides.
// Promised: at most 4 for Mono8, at most 8 for Mono12p.
constexpr int width = 2592, height = 1944;

std::vector<std::uint8_t> frame_bytes(const PixelFormat& format) {
    std::vector<std::uint8_t> bytes(image_bytes(format, width, height, 0));
    for (std::size_t i = 0; i < bytes.size(); ++i)
        bytes[i] = static_cast<std::uint8_t>(i * 7 >> 3);
    return bytes;
}

void copy(const std::vector<std::uint8_t>& bytes) {
    const std::unique_ptr<std::uint8_t[]> copied(new std::uint8_t[bytes.size()]);
    std::memcpy(copied.get(), bytes.data(), bytes.size());
    benchmark::DoNotOptimize(copied.get());
    benchmark::ClobberMemory();
}

// The median is what a frame costs.
double median_seconds(const auto& call) {
    std::vector<double> seconds(31);
    for (double& each : seconds) {
        const auto start = std::chrono::steady_clock::now();
        call();
        each = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }
    std::nth_element(seconds.begin(), seconds.begin() + 15, seconds.end());
    return seconds[15];
}

void receive_frame(benchmark::State& state, const PixelFormat* format) {
    const std::vector<std::uint8_t> bytes = frame_bytes(*format);
    const auto receive = [&] {
        CodeImage image;
        benchmark::DoNotOptimize(unpack(*format, {bytes, width, height, 0}, image));
        if (can_exceed_full_scale(*format, format->bits))
            benchmark::DoNotOptimize(exceeds_full_scale(image));
    };
    for (auto _ : state)
        receive();
    state.SetItemsProcessed(state.iterations() * width * height);
    state.counters["x_memcpy"] = median_seconds(receive) / median_seconds([&] { copy(bytes); });
}

void add_frames() {
    std::map<std::string, const PixelFormat*> formats;
    for (const char* name : {"Mono8", "Mono10p", "Mono12", "Mono12p", "Mono12Packed", "Mono16"})
        formats[name] = find_pfnc_format(name);
    for (const char* name : {"Y10P", "Y12P", "YUYV"})
        formats[name] = find_v4l2_format(name);
    for (const auto& [name, format] : formats)
        benchmark::RegisterBenchmark(("receive_frame/" + name).c_str(), receive_frame, format)
            ->Unit(benchmark::kMillisecond);
}

// The kernels of methods E and C per point, on every instruction set of this machine.
struct KernelCase {
    const char* name;
    float blur_px;
    int lines;  // a direction
    float spacing_px;
    int lens_points = 0;  // none: method E
};

// Cells of 5.4 px, as in webcam-500, and of 2.2 px: there the apertures meet all of the lines.
constexpr KernelCase kernel_cases[] = {{"E/blur_2_px/1x1_lines/", 2.0f, 1, 5.4f},
                                       {"E/blur_2_px/2x2_lines/", 2.0f, 2, 5.4f},
                                       {"E/blur_2_px/2x2_close_lines/", 2.0f, 2, 2.2f},
                                       {"E/blur_8_px/4x4_close_lines/", 8.0f, 4, 2.2f},
                                       {"E/blur_0.4_px/2x2_close_lines/", 0.4f, 2, 2.2f},
                                       {"C/sharp/1_lens_point/", 0.0f, 2, 2.2f, 1},
                                       {"C/blur_0.1_px/12_lens_points/", 0.1f, 2, 2.2f, 12}};

// A tile 4 px wide, a little turned and bent, the blur changing over it, as of the webcam scenes.
// There is contrast across every line and crossing.
TileGeometry tile_with_lines(const KernelCase& kernel) {
    TileGeometry tile{};
    tile.dx = {0.0f, 4.0f, 1e-3f, 8e-6f, 0.1f, 2e-3f};
    tile.dy = {0.0f, -0.05f, 0.0f, 0.0f, 3.9f, 0.0f, 0.0f, 0.0f, 1e-3f};
    tile.blur = kernel.blur_px;
    tile.blur_slope_x = 0.003f;
    tile.blur_slope_y = -0.002f;
    tile.turn_x = 0.002f;
    tile.turn_y = 0.001f;
    const float angle = 0.6f, cosine = std::cos(angle), sine = std::sin(angle);
    const int count = kernel.lines;
    for (int i = 0; i < count; ++i) {
        const float offset = kernel.spacing_px * (0.5f * static_cast<float>(count - 1 - 2 * i));
        tile.columns.push_back({offset + 0.3f, cosine, sine});
        tile.rows.push_back({offset - 0.2f, -sine, cosine});
    }
    for (int j = 0; j <= count; ++j)
        for (int i = 0; i <= count; ++i)
            tile.cells.push_back(0.1 + 0.8 * i - 0.5 * j + 0.4 * i * j);
    return tile;
}

void time_kernel(benchmark::State& state, std::int64_t target, const KernelCase& kernel) {
    hwy::SetSupportedTargetsForTest(target);
    const TileGeometry tile = tile_with_lines(kernel);
    std::vector<UnitLensPoint> points;
    for (int i = 0; i < kernel.lens_points; ++i) {
        const float radius = kernel.lens_points == 1 ? 0.0f : 0.7f;
        const float angle = 0.5f * static_cast<float>(i);
        points.push_back({radius * std::cos(angle), radius * std::sin(angle),
                          1.0f / static_cast<float>(kernel.lens_points)});
    }
    const int n = points.empty() ? 16 : 36;  // k = 4 and 9
    const TilePositions positions(n);
    std::vector<float> values(n * n);
    for (auto _ : state) {
        if (points.empty())
            exact_lens_samples(tile, positions, values.data());
        else
            exact_area_samples(tile, positions, points, values.data());
        benchmark::DoNotOptimize(values.data());
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * n * n);
    state.counters["ns_per_point"] = benchmark::Counter(
        n * n, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
    hwy::SetSupportedTargetsForTest(0);
}

const bool added = [] {
    add_frames();
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets())
        for (const KernelCase& kernel : kernel_cases)
            benchmark::RegisterBenchmark(
                (std::string(kernel.name) + hwy::TargetName(target)).c_str(), time_kernel, target,
                kernel);
    return true;
}();

}  // namespace
}  // namespace etalon

int main(int argc, char** argv) {
    // Before the user's options, which therefore win.
    std::string short_run = "--benchmark_min_time=0.1";
    std::vector<char*> arguments(argv, argv + argc);
    arguments.insert(arguments.begin() + 1, short_run.data());
    int count = static_cast<int>(arguments.size());
    benchmark::AddCustomContext("instruction set in use", etalon::tile_kernel_target());
    benchmark::Initialize(&count, arguments.data());
    if (benchmark::ReportUnrecognizedArguments(count, arguments.data()))
        return 2;
    benchmark::RunSpecifiedBenchmarks();
    benchmark::Shutdown();
}
