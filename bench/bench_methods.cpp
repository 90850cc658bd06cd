#include "bench/bench_methods.h"

#include <fmt/format.h>
#include <malloc.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <cmath>
#include <tuple>
#include <vector>

#include "bench/published_method.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"
#include "core/time/clock.h"
#include "sim/scene/pose_volume.h"
#include "sim/sensor/sensor_model.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {
namespace {

// Seven repetitions at least; of short work more, up to so much time, as its first runs are slower.
constexpr std::size_t repetitions = 7;
constexpr double long_enough_ms = 150.0;
constexpr double long_run_ms = 1000.0;

double run_ms(const std::function<void()>& work) {
    const double start = thread_cpu_ms();
    work();
    return thread_cpu_ms() - start;
}

// After a run that only warms the processor's caches: one, or as many as take 50 ms. Their median.
double add_warm_runs(const std::function<void()>& work, std::vector<double>& times) {
    constexpr double long_enough_ms = 50.0;
    run_ms(work);
    std::vector<double> of_turn;
    double sum = 0.0;
    while (sum < long_enough_ms) {
        of_turn.push_back(run_ms(work));
        sum += of_turn.back();
    }
    times.insert(times.end(), of_turn.begin(), of_turn.end());
    return median(of_turn);
}

using Undistortion = PublishedMethod::Undistortion;

constexpr std::uint64_t cloud_seed = 20;
constexpr std::uint64_t quasi_monte_carlo_seed = 99;  // not the reference's

// One thread while it lives.
class OneThread {
    tbb::global_control limit_{tbb::global_control::max_allowed_parallelism, 1};
};

// Measures one scene row by row.
class SceneBench {
public:
    SceneBench(const BenchmarkScene& scene, const BenchPlan& plan)
        : scene_(scene),
          plan_(plan),
          truth_(integrate_truth(scene.camera, scene.scene, plan.window_side_px,
                                 {.samples_per_scramble = plan.reference_samples})) {
        result_.name = scene.name;
    }

    BenchScene run() {
        const bool has_published = scene_.camera.projection.kind == Projection::perspective;
        result_.refined_pixels = has_published ? blurred_edge_pixels() : refined_pixels();
        measure_default();
        measure_forced("E", RenderMethod::exact_lens, plan_.lens_sides);
        measure_forced("C", RenderMethod::exact_area, plan_.area_sides);
        if (has_published) {
            measure_published("published", Undistortion::per_ray);
            measure_published("published-linearised", Undistortion::linearised);
            time_promised_ratio();
        }
        for (const int samples : plan_.quasi_monte_carlo)
            measure_quasi_monte_carlo(samples);
        return result_;
    }

private:
    int blurred_edge_pixels() const {
        return PublishedMethod(scene_.camera, 64, Undistortion::linearised)
            .render(scene_.scene)
            .edge_pixels;
    }

    // Of the tiles that are not uniform: where there is no published method to say.
    int refined_pixels() const {
        int pixels = 0;
        for (const TileUse& use : Renderer(scene_.camera).render(scene_.scene).plan.used)
            pixels += static_cast<int>(use.tiles) * tile_px * tile_px;
        return pixels;
    }

    void add_row(const std::string& method, const std::string& setting, double cpu_ms,
                 const RenderComparison& error) {
        result_.rows.push_back({scene_.name, method, setting, cpu_ms, error,
                                1e6 * cpu_ms / std::max(1, result_.refined_pixels)});
    }

    // The whole frame, again and again.
    template <class Render>
    double time_and_add(const std::string& method, const std::string& setting,
                        const Render& render) {
        Radiance image;
        const double ms = median_cpu_ms([&] { image = render(); });
        add_row(method, setting, ms, compare_with_truth(image, truth_));
        return ms;
    }

    void measure_default() {
        const double start = thread_cpu_ms();
        renderer_.emplace(scene_.camera);
        renderer_->render(scene_.scene);
        const double first_ms = thread_cpu_ms() - start;
        const double ms = time_and_add("default", "0.1",
                                       [&] { return renderer_->render(scene_.scene).radiance; });
        result_.cache_ms = std::max(0.0, first_ms - ms);
    }

    // A sweep over rising k, as long as frames take a bearable time (cost grows as k^2).
    void measure_forced(const std::string& name, RenderMethod method,
                        const std::vector<int>& sides) {
        double ms_per_sample = 0.0;
        for (const int k : sides) {
            const std::string setting = fmt::format("k{}", k);
            if (ms_per_sample * k * k > plan_.slowest_frame_ms) {
                result_.left_out.push_back(name + " " + setting + ": too slow");
                continue;
            }
            RenderOptions options;
            options.method = method;
            options.samples_per_side = k;
            try {
                const double ms = time_and_add(name, setting, [&] {
                    return renderer_->render(scene_.scene, options).radiance;
                });
                ms_per_sample = ms / (k * k);
            } catch (const NumericalError& error) {
                result_.left_out.push_back(name + " " + setting + ": " + error.what());
            }
        }
    }

    void measure_published(const std::string& name, Undistortion undistortion) {
        std::vector<std::pair<int, double>> times;
        for (const int n : plan_.rays) {
            const PublishedMethod method(scene_.camera, n, undistortion);
            const double ms = time_and_add(name, fmt::format("n{}", n),
                                           [&] { return method.render(scene_.scene).radiance; });
            times.emplace_back(n, ms);
        }
        if (undistortion == Undistortion::per_ray && times.size() >= 2) {
            const auto& [n1, t1] = times[times.size() - 2];
            const auto& [n2, t2] = times.back();
            result_.ns_per_ray = 1e6 * (t2 - t1) / (n2 - n1) / std::max(1, result_.refined_pixels);
        }
    }

    // The times of the two rows whose ratio is promised, once more and by turns.
    void time_promised_ratio() {
        constexpr int rays = 256;
        const auto baseline = std::ranges::find_if(result_.rows, [](const BenchRow& row) {
            return row.method == "published" && row.setting == published_setting;
        });
        if (baseline == result_.rows.end())
            return;
        BenchRow& ours = result_.rows.front();
        const PublishedMethod published(scene_.camera, rays, Undistortion::per_ray);
        const TimesByTurns times = cpu_ms_by_turns([&] { renderer_->render(scene_.scene); },
                                                   [&] { published.render(scene_.scene); });
        ours.cpu_ms = times.one_ms;
        baseline->cpu_ms = times.other_ms;
        result_.ratio_error = times.ratio_error;
        for (BenchRow* each : {&ours, &*baseline})
            each->ns_per_pixel = 1e6 * each->cpu_ms / std::max(1, result_.refined_pixels);
    }

    // On the compared pixels; the time is scaled to the refined pixels of the frame.
    void measure_quasi_monte_carlo(int samples) {
        ReferenceOptions options;
        options.scrambles = 2;
        options.samples_per_scramble = samples / options.scrambles;
        options.seed = quasi_monte_carlo_seed;
        std::vector<ReferencePixel> pixels;
        const double ms = median_cpu_ms([&] {
            pixels = integrate_reference(scene_.camera, scene_.scene, truth_.pixels, options);
        });
        std::vector<double> values;
        for (const ReferencePixel& pixel : pixels)
            values.push_back(pixel.mean);
        add_row("qmc", fmt::format("n{}", samples),
                ms * result_.refined_pixels / static_cast<double>(truth_.pixels.size()),
                compare_with_truth(values, truth_));
    }

    const BenchmarkScene& scene_;
    const BenchPlan& plan_;
    RenderTruth truth_;
    std::optional<Renderer> renderer_;
    BenchScene result_;
};

// One method's part of the cloud.
struct CloudSums {
    std::vector<double> values;  // at the truth's pixels
    double cpu_ms = 0.0;

    void add(const Radiance& image, const std::vector<cv::Point>& pixels) {
        for (const cv::Point& pixel : pixels)
            values.push_back(image.at<float>(pixel));
    }
};

void append(RenderTruth& all, const RenderTruth& one) {
    all.windows.insert(all.windows.end(), one.windows.begin(), one.windows.end());
    all.pixels.insert(all.pixels.end(), one.pixels.begin(), one.pixels.end());
    all.values.insert(all.values.end(), one.values.begin(), one.values.end());
}

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

void keep_freed_memory() {
    mallopt(M_MMAP_THRESHOLD, 32 << 20);  // the largest that glibc takes
    mallopt(M_TRIM_THRESHOLD, 1 << 30);
}

double median_cpu_ms(const std::function<void()>& work) {
    const double first = run_ms(work);
    if (first > long_run_ms)
        return first;
    std::vector<double> times;
    double sum = 0.0;
    while (times.size() < repetitions ||
           (sum < long_enough_ms && times.size() < 20 * repetitions)) {
        times.push_back(run_ms(work));
        sum += times.back();
    }
    return median(times);
}

TimesByTurns cpu_ms_by_turns(const std::function<void()>& one, const std::function<void()>& other) {
    constexpr int turns = 9;
    std::vector<double> ones, others;
    double sum = 0.0, squares = 0.0;
    for (int turn = 0; turn < turns; ++turn) {
        const double one_ms = add_warm_runs(one, ones);
        const double log_ratio = std::log(add_warm_runs(other, others) / one_ms);
        sum += log_ratio;
        squares += log_ratio * log_ratio;
    }
    const double variance = std::max(0.0, squares - sum * sum / turns) / (turns - 1);
    return {median(ones), median(others), std::sqrt(variance / turns)};
}

BenchPlan quick_plan() {
    BenchPlan plan;
    plan.window_side_px = 4;
    plan.reference_samples = 512;
    plan.cloud_reference_samples = 256;
    plan.lens_sides = {2, 4};
    plan.area_sides = {3};
    plan.rays = {64, 256};
    plan.quasi_monte_carlo = {64};
    plan.slowest_frame_ms = 1000.0;
    return plan;
}

const BenchRow* BenchScene::row(const std::string& method, const std::string& setting) const {
    const auto found = std::find_if(rows.begin(), rows.end(), [&](const BenchRow& r) {
        return r.method == method && r.setting == setting;
    });
    return found == rows.end() ? nullptr : &*found;
}

BenchScene measure_scene(const BenchmarkScene& scene, const BenchPlan& plan) {
    SceneBench bench(scene, plan);  // the reference takes all cores
    const OneThread limit;
    return bench.run();
}

BenchScene measure_cloud(const BenchmarkScene& scene, int poses, const BenchPlan& plan,
                         const std::function<void(int)>& progress) {
    const PublishedMethod published(scene.camera, 256, Undistortion::per_ray);
    const Renderer renderer(scene.camera);
    RenderTruth truth;
    CloudSums by_default, by_published;
    BenchScene result;
    result.name = "cloud";
    Scene posed = scene.scene;
    int done = 0;
    for (const Rigid& pose :
         volume_poses(scene.camera, posed.markers.front().grid, poses, cloud_seed)) {
        posed.markers.front().camera_from_marker = pose;
        const RenderTruth here =
            integrate_truth(scene.camera, posed, plan.cloud_window_side_px,
                            {.samples_per_scramble = plan.cloud_reference_samples});
        const OneThread limit;
        RenderedImage image;
        progress(++done);
        try {
            by_default.cpu_ms += median_cpu_ms([&] { image = renderer.render(posed); });
        } catch (const NumericalError& error) {
            ++result.refused_poses;
            result.left_out = {fmt::format("poses refused, the last because {}", error.what())};
            continue;
        }
        by_default.add(image.radiance, here.pixels);
        PublishedImage baseline;
        by_published.cpu_ms += median_cpu_ms([&] { baseline = published.render(posed); });
        by_published.add(baseline.radiance, here.pixels);
        result.refined_pixels += baseline.edge_pixels;
        append(truth, here);
    }
    const int rendered = std::max(1, poses - result.refused_poses);
    by_default.cpu_ms /= rendered;
    by_published.cpu_ms /= rendered;
    result.refined_pixels /= rendered;
    const double pixels = std::max(1, result.refined_pixels);
    result.rows = {
        {"cloud", "default", "0.1", by_default.cpu_ms, compare_with_truth(by_default.values, truth),
         1e6 * by_default.cpu_ms / pixels},
        {"cloud", "published", published_setting, by_published.cpu_ms,
         compare_with_truth(by_published.values, truth), 1e6 * by_published.cpu_ms / pixels}};
    return result;
}

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
