#include "bench/bench_throughput.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>

#include "bench/published_method.h"
#include "core/program/errors.h"
#include "core/time/cpu_time.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

// `render` makes the frame of a pose. One pose per task, because one may take 100 times as long as
// another; each renders in an arena of one thread: only the loop over the poses is parallel.
template <class Render>
RenderRate rate(const std::vector<Rigid>& poses, const Render& render) {
    tbb::enumerable_thread_specific<tbb::task_arena> serial([] { return tbb::task_arena(1); });
    const auto start = std::chrono::steady_clock::now();
    const double cpu_start = process_cpu_ms();
    tbb::parallel_for(
        std::size_t{0}, poses.size(),
        [&](std::size_t i) { serial.local().execute([&] { render(poses[i]); }); },
        tbb::simple_partitioner());
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
    return {static_cast<int>(poses.size()), static_cast<double>(poses.size()) / wall.count(),
            1e-3 * (process_cpu_ms() - cpu_start) / wall.count()};
}

std::vector<Rigid> every_nth(const std::vector<Rigid>& poses, std::size_t count) {
    std::vector<Rigid> some;
    count = std::min(count, poses.size());
    for (std::size_t i = 0; i < count; ++i)
        some.push_back(poses[i * poses.size() / count]);
    return some;
}

}  // namespace

Throughput measure_throughput(const BenchmarkScene& scene, const std::vector<Rigid>& poses) {
    const auto posed = [&](const Rigid& pose) {
        Scene result = scene.scene;
        result.markers.front().camera_from_marker = pose;
        return result;
    };
    const Renderer renderer(scene.camera);
    const PublishedMethod published(scene.camera, 256, PublishedMethod::Undistortion::per_ray);
    const SensorModel sensor(scene.camera);
    std::atomic<int> refused = 0;
    const auto render = [&](const Rigid& pose) {
        try {
            sensor.expose(renderer.render_part(posed(pose)));
        } catch (const NumericalError&) {
            ++refused;
        }
    };
    for (const Rigid& pose : every_nth(poses, 100))  // fills the caches
        render(pose);

    Throughput result;
    refused = 0;
    std::atomic<std::size_t> done = 0;
    std::atomic<double> early_peak = 0.0;
    result.by_default = rate(poses, [&](const Rigid& pose) {
        render(pose);
        if (++done == std::max<std::size_t>(1, poses.size() / 10))
            early_peak = peak_memory_mib();
    });
    result.refused = refused;
    result.early_peak_mib = early_peak;
    result.final_peak_mib = peak_memory_mib();
    result.by_published =
        rate(every_nth(poses, std::max<std::size_t>(20, poses.size() / 20)),
             [&](const Rigid& pose) { sensor.expose(published.render(posed(pose)).radiance); });
    return result;
}

}  // namespace etalon
