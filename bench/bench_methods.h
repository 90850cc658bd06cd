// Error against run time: every method and setting on a scene, on one thread.
#pragma once

#include "bench/render_comparison.h"

namespace etalon {

// From now on this process keeps the memory that it frees. glibc would hand every image of some MiB
// back to the kernel: 1.5 of the published method's 6 ms, and none of the default plan's.
void keep_freed_memory();

// Median CPU time of `work` in the calling thread: limit TBB to one. After a warm run seven runs,
// or as many as take 150 ms (at most 140); only the first where it takes more than a second.
double median_cpu_ms(const std::function<void()>& work);

// How much is measured, unless quick.
struct BenchPlan {
    int window_side_px = 6;
    int reference_samples = 16384;  // in each of 16 scrambles
    int cloud_window_side_px = 1;
    int cloud_reference_samples = 4096;
    std::vector<int> lens_sides{1, 2, 3, 4, 5, 6, 8};        // k of E
    std::vector<int> area_sides{1, 2, 3, 4, 5, 6, 7, 8, 9};  // k of C
    std::vector<int> rays{64, 256, 1024, 4096};              // n of the published method
    std::vector<int> quasi_monte_carlo{64, 256, 1024};       // samples per pixel
    double slowest_frame_ms = 8000.0;  // a sweep ends before a frame that would take longer
};
BenchPlan quick_plan();

struct BenchRow {
    std::string scene, method, setting;
    double cpu_ms = 0.0;  // of a whole frame, caches warm
    RenderComparison error;
};

// Of one scene, or of the cloud of poses.
struct BenchScene {
    std::string name;
    std::vector<BenchRow> rows;  // `default` first
    double cache_ms = 0.0;       // CPU time to build what the renderer keeps for this camera
    int refined_pixels = 0;  // within blur radius + 1 px of an edge (the published method's); of a
                             // wide lens those of the tiles that are not uniform
    double ratio_error = 0.0;           // relative standard error of the promised ratio of times
    double ns_per_ray = 0.0;            // of the published method, from its two largest settings
    int refused_poses = 0;              // of the cloud, with NumericalError; not in the rows
    std::vector<std::string> left_out;  // settings not measured, and why

    // Nothing where the setting was not measured.
    const BenchRow* row(const std::string& method, const std::string& setting) const;
    // How much longer than this one the published method takes; nothing where it was not measured.
    std::optional<double> ratio_to_published(const BenchRow& row) const;
    const BenchRow& default_row() const { return rows.front(); }
};

// The setting of the published method that ratios refer to.
inline constexpr const char* published_setting = "n256";

BenchScene measure_scene(const BenchmarkScene& scene, const BenchPlan& plan);

// The scene at many poses: the default plan and the published method at 256 rays. Times are means,
// errors are over all poses. `progress` gets the number of poses that are done.
BenchScene measure_cloud(const BenchmarkScene& scene, int poses, const BenchPlan& plan,
                         const std::function<void(int)>& progress);

struct RenderRate {
    int frames = 0;
    double frames_per_s = 0.0;
    double cores_used = 0.0;  // CPU time over wall time
};

struct Throughput {
    RenderRate by_default, by_published;  // the published method at 256 rays, on fewer frames
    int refused = 0;                      // of the default plan's frames, with NumericalError
    double early_peak_mib = 0.0;          // peak memory after a tenth of the default plan's frames
    double final_peak_mib = 0.0;          // and at their end

    double ratio() const { return by_default.frames_per_s / by_published.frames_per_s; }
};

// The scene at the poses: rendered on one thread each, exposed without noise, thrown away. The
// published method gets every n-th pose, a twentieth of them but at least 20.
Throughput measure_throughput(const BenchmarkScene& scene, const std::vector<Rigid>& poses);

}  // namespace etalon
