// Frames per second: many poses of a marker rendered to sensor frames in memory, on all cores.
#pragma once

#include "bench/benchmark_scenes.h"

namespace etalon {

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

// The scene's camera and marker at the poses; each frame is rendered on one thread, exposed by the
// sensor model (no noise) and thrown away. The published method gets every n-th pose, a twentieth
// of them but at least 20.
Throughput measure_throughput(const BenchmarkScene& scene, const std::vector<Rigid>& poses);

}  // namespace etalon
