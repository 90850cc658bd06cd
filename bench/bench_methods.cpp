#include "bench/bench_methods.h"

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <tuple>

#include "bench/bench_timing.h"
#include "bench/published_method.h"
#include "core/program/errors.h"
#include "core/time/cpu_time.h"
#include "sim/scene/bench_poses.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {
namespace {

using Undistortion = PublishedMethod::Undistortion;

constexpr std::uint64_t cloud_seed = 20;
constexpr std::uint64_t quasi_monte_carlo_seed = 99;  // not the reference's

ReferenceOptions reference_options(int samples) {
    ReferenceOptions options;
    options.samples_per_scramble = samples;
    return options;
}

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
                                 reference_options(plan.reference_samples))) {
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

    BenchRow* row(const std::string& method, const std::string& setting) {
        for (BenchRow& each : result_.rows)
            if (each.method == method && each.setting == setting)
                return &each;
        return nullptr;
    }

    // The times of the two rows whose ratio is promised, once more and by turns.
    void time_promised_ratio() {
        constexpr int rays = 256;
        BenchRow* ours = row("default", "0.1");
        BenchRow* baseline = row("published", fmt::format("n{}", rays));
        if (!ours || !baseline)
            return;
        const PublishedMethod published(scene_.camera, rays, Undistortion::per_ray);
        const TimesByTurns times = cpu_ms_by_turns([&] { renderer_->render(scene_.scene); },
                                                   [&] { published.render(scene_.scene); });
        ours->cpu_ms = times.one_ms;
        baseline->cpu_ms = times.other_ms;
        result_.ratio_error = times.ratio_error;
        for (BenchRow* each : {ours, baseline})
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

}  // namespace

BenchPlan full_plan() {
    return {};
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
         spread_poses(scene.camera, posed.markers.front().grid, poses, cloud_seed)) {
        posed.markers.front().camera_from_marker = pose;
        const RenderTruth here = integrate_truth(scene.camera, posed, plan.cloud_window_side_px,
                                                 reference_options(plan.cloud_reference_samples));
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

}  // namespace etalon
