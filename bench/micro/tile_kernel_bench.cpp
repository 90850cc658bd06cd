// The kernels of methods E and C per point, on every instruction set of this machine.
#include <benchmark/benchmark.h>
#include <hwy/targets.h>

#include <cmath>
#include <string>

#include "sim/tiles/tile_kernel.h"

namespace etalon {
namespace {

// A tile of the webcam scenes' kind: 4 px wide, a little turned and bent, the blur changing over
// it.
TileGeometry tile_with_blur(float blur_px) {
    TileGeometry tile{};
    tile.dx = {0.0f, 4.0f, 1e-3f, 8e-6f, 0.1f, 2e-3f};
    tile.dy = {0.0f, -0.05f, 0.0f, 0.0f, 3.9f, 0.0f, 0.0f, 0.0f, 1e-3f};
    tile.base = 0.1f;
    tile.blur = blur_px;
    tile.blur_slope_x = 0.003f;
    tile.blur_slope_y = -0.002f;
    tile.turn_x = 0.002f;
    tile.turn_y = 0.001f;
    return tile;
}

// `count` lines of each direction, `spacing_px` apart around the centre, with contrast across every
// line and crossing.
void add_lines(TileGeometry& tile, int count, float spacing_px) {
    const float angle = 0.6f, cosine = std::cos(angle), sine = std::sin(angle);
    for (int i = 0; i < count; ++i) {
        const float offset = spacing_px * (0.5f * static_cast<float>(count - 1 - 2 * i));
        tile.columns.push_back({offset + 0.3f, cosine, sine});
        tile.rows.push_back({offset - 0.2f, -sine, cosine});
    }
    const auto lines = static_cast<std::size_t>(count);
    tile.column_contrast.assign(lines, 0.8f);
    tile.row_contrast.assign(lines, -0.5f);
    tile.mixed.assign(lines * lines, 0.4f);
}

void count_points(benchmark::State& state, int n) {
    state.SetItemsProcessed(state.iterations() * n * n);
    state.counters["ns_per_point"] = benchmark::Counter(
        n * n, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void lens_samples(benchmark::State& state, std::int64_t target, const TileGeometry& tile) {
    hwy::SetSupportedTargetsForTest(target);
    constexpr int n = 16;  // k = 4
    const TilePositions positions(n);
    std::vector<float> values(n * n);
    for (auto _ : state) {
        exact_lens_samples(tile, positions, values.data());
        benchmark::DoNotOptimize(values.data());
        benchmark::ClobberMemory();
    }
    count_points(state, n);
    hwy::SetSupportedTargetsForTest(0);
}

void area_samples(benchmark::State& state, std::int64_t target, const TileGeometry& tile,
                  int lens_points) {
    hwy::SetSupportedTargetsForTest(target);
    constexpr int n = 36;  // k = 9
    const TilePositions positions(n);
    std::vector<UnitLensPoint> points;
    for (int i = 0; i < lens_points; ++i) {
        const float radius = lens_points == 1 ? 0.0f : 0.7f, angle = 0.5f * static_cast<float>(i);
        points.push_back({radius * std::cos(angle), radius * std::sin(angle),
                          1.0f / static_cast<float>(lens_points)});
    }
    std::vector<float> values(n * n);
    for (auto _ : state) {
        exact_area_samples(tile, positions, points, values.data());
        benchmark::DoNotOptimize(values.data());
        benchmark::ClobberMemory();
    }
    count_points(state, n);
    hwy::SetSupportedTargetsForTest(0);
}

void add_benchmarks(std::int64_t target) {
    const std::string end = std::string("/") + hwy::TargetName(target);
    const auto add_lens = [&](const std::string& name, float blur_px, int lines, float spacing) {
        TileGeometry tile = tile_with_blur(blur_px);
        add_lines(tile, lines, spacing);
        benchmark::RegisterBenchmark(("E/" + name + end).c_str(), lens_samples, target, tile);
    };
    const auto add_area = [&](const std::string& name, float blur_px, int lens_points) {
        TileGeometry tile = tile_with_blur(blur_px);
        add_lines(tile, 2, 2.2f);
        benchmark::RegisterBenchmark(("C/" + name + end).c_str(), area_samples, target, tile,
                                     lens_points);
    };
    // Cells of 5.4 px, as in webcam-500, and of 2.2 px: there the apertures meet all of the lines.
    add_lens("blur_2_px/1x1_lines", 2.0f, 1, 5.4f);
    add_lens("blur_2_px/2x2_lines", 2.0f, 2, 5.4f);
    add_lens("blur_2_px/2x2_close_lines", 2.0f, 2, 2.2f);
    add_lens("blur_8_px/4x4_close_lines", 8.0f, 4, 2.2f);
    add_lens("blur_0.4_px/2x2_close_lines", 0.4f, 2, 2.2f);
    add_area("sharp/1_lens_point", 0.0f, 1);
    add_area("blur_0.1_px/12_lens_points", 0.1f, 12);
}

const bool added = [] {
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets())
        add_benchmarks(target);
    return true;
}();

}  // namespace
}  // namespace etalon
