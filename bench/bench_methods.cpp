#include "bench/bench_methods.h"

#include <fmt/format.h>
#include <malloc.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <tuple>

#include "bench/published_method.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"
#include "sim/scene/pose_volume.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {
namespace {

double run_ms(const std::function<void()>& work) {
    const double start = thread_cpu_ms();
    work();
    return thread_cpu_ms() - start;
}

// As many runs as take so long, within these numbers.
std::vector<double> runs_ms(const std::function<void()>& work, double long_enough_ms,
                            std::size_t least, std::size_t most) {
    std::vector<double> times;
    for (double sum = 0.0; times.size() < least || (sum < long_enough_ms && times.size() < most);
         sum += times.back())
        times.push_back(run_ms(work));
    return times;
}

using Undistortion = PublishedMethod::Undistortion;

constexpr std::uint64_t cloud_seed = 20;
constexpr std::uint64_t quasi_monte_carlo_seed = 99;  // not the reference's

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
        if (has_published)
            result_.refined_pixels = PublishedMethod(scene_.camera, 64, Undistortion::linearised)
                                         .render(scene_.scene)
                                         .edge_pixels;
        else  // of the tiles that are not uniform
            for (const TileUse& use : Renderer(scene_.camera).render(scene_.scene).plan.used)
                result_.refined_pixels += static_cast<int>(use.tiles) * tile_px * tile_px;
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
    template <class Render>
    double time_and_add(const std::string& method, const std::string& setting,
                        const Render& render) {
        Radiance image;
        const double ms = median_cpu_ms([&] { image = render(); });
        result_.rows.push_back({scene_.name, method, setting, ms,
                                compare_with_truth(values_at(image, truth_.pixels), truth_)});
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

    // The times of the two rows whose ratio is promised, once more and by turns, so that what slows
    // the machine for a while slows both. Each turn: one warm run, or as many as take 50 ms.
    void time_promised_ratio() {
        constexpr int rays = 256, turns = 9;
        const auto baseline = std::ranges::find_if(result_.rows, [](const BenchRow& row) {
            return row.method == "published" && row.setting == published_setting;
        });
        if (baseline == result_.rows.end())
            return;
        BenchRow& ours = result_.rows.front();
        const PublishedMethod published(scene_.camera, rays, Undistortion::per_ray);
        std::vector<double> ours_ms, baseline_ms;
        const auto run_turn = [](const std::function<void()>& work, std::vector<double>& all) {
            run_ms(work);  // warms the processor's caches
            const std::vector<double> times = runs_ms(work, 50.0, 1, 1'000'000);
            all.insert(all.end(), times.begin(), times.end());
            return median(times);
        };
        double sum = 0.0, squares = 0.0;
        for (int turn = 0; turn < turns; ++turn) {
            const double ms = run_turn([&] { renderer_->render(scene_.scene); }, ours_ms);
            const double log_ratio =
                std::log(run_turn([&] { published.render(scene_.scene); }, baseline_ms) / ms);
            sum += log_ratio;
            squares += log_ratio * log_ratio;
        }
        ours.cpu_ms = median(ours_ms);
        baseline->cpu_ms = median(baseline_ms);
        const double variance = std::max(0.0, squares - sum * sum / turns) / (turns - 1);
        result_.ratio_error = std::sqrt(variance / turns);
    }

    // On the compared pixels; the time is scaled to the refined pixels of the frame.
    void measure_quasi_monte_carlo(int samples) {
        const ReferenceOptions options{
            .scrambles = 2, .samples_per_scramble = samples / 2, .seed = quasi_monte_carlo_seed};
        std::vector<ReferencePixel> pixels;
        const double ms = median_cpu_ms([&] {
            pixels = integrate_reference(scene_.camera, scene_.scene, truth_.pixels, options);
        });
        std::vector<double> values;
        for (const ReferencePixel& pixel : pixels)
            values.push_back(pixel.mean);
        result_.rows.push_back(
            {scene_.name, "qmc", fmt::format("n{}", samples),
             ms * result_.refined_pixels / static_cast<double>(truth_.pixels.size()),
             compare_with_truth(values, truth_)});
    }

    const BenchmarkScene& scene_;
    const BenchPlan& plan_;
    RenderTruth truth_;
    std::optional<Renderer> renderer_;
    BenchScene result_;
};

template <class List>
void append(List& all, const List& some) {
    all.insert(all.end(), some.begin(), some.end());
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
    return first > 1000.0 ? first : median(runs_ms(work, 150.0, 7, 140));
}

BenchPlan quick_plan() {
    return {.window_side_px = 4,
            .reference_samples = 512,
            .cloud_reference_samples = 256,
            .lens_sides = {2, 4},
            .area_sides = {3},
            .rays = {64, 256},
            .quasi_monte_carlo = {64},
            .slowest_frame_ms = 1000.0};
}

const BenchRow* BenchScene::row(const std::string& method, const std::string& setting) const {
    for (const BenchRow& row : rows)
        if (row.method == method && row.setting == setting)
            return &row;
    return nullptr;
}

std::optional<double> BenchScene::ratio_to_published(const BenchRow& of) const {
    const BenchRow* published = row("published", published_setting);
    return published ? std::optional(published->cpu_ms / of.cpu_ms) : std::nullopt;
}

BenchScene measure_scene(const BenchmarkScene& scene, const BenchPlan& plan) {
    SceneBench bench(scene, plan);  // the reference takes all cores
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    return bench.run();
}

BenchScene measure_cloud(const BenchmarkScene& scene, int poses, const BenchPlan& plan,
                         const std::function<void(int)>& progress) {
    const PublishedMethod published(scene.camera, 256, Undistortion::per_ray);
    const Renderer renderer(scene.camera);
    RenderTruth truth;
    std::vector<double> by_default, by_published;  // at the truth's pixels
    BenchScene result;
    result.name = "cloud";
    result.rows = {{"cloud", "default", "0.1", 0.0, {}},
                   {"cloud", "published", published_setting, 0.0, {}}};
    Scene posed = scene.scene;
    int done = 0;
    for (const Rigid& pose :
         volume_poses(scene.camera, posed.markers.front().grid, poses, cloud_seed)) {
        posed.markers.front().camera_from_marker = pose;
        const RenderTruth here =
            integrate_truth(scene.camera, posed, plan.cloud_window_side_px,
                            {.samples_per_scramble = plan.cloud_reference_samples});
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
        RenderedImage image;
        progress(++done);
        try {
            result.rows[0].cpu_ms += median_cpu_ms([&] { image = renderer.render(posed); });
        } catch (const NumericalError& error) {
            ++result.refused_poses;
            result.left_out = {fmt::format("poses refused, the last because {}", error.what())};
            continue;
        }
        PublishedImage baseline;
        result.rows[1].cpu_ms += median_cpu_ms([&] { baseline = published.render(posed); });
        append(by_default, values_at(image.radiance, here.pixels));
        append(by_published, values_at(baseline.radiance, here.pixels));
        result.refined_pixels += baseline.edge_pixels;
        append(truth.windows, here.windows);
        append(truth.pixels, here.pixels);
        append(truth.values, here.values);
    }
    const int rendered = std::max(1, poses - result.refused_poses);
    for (BenchRow& row : result.rows)
        row.cpu_ms /= rendered;
    result.refined_pixels /= rendered;
    result.rows[0].error = compare_with_truth(by_default, truth);
    result.rows[1].error = compare_with_truth(by_published, truth);
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
