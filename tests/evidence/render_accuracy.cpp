// Prints the renderer's error against the reference integrator on the eight scenes, and its time
// for a whole frame. Takes some minutes.
//
//     render_accuracy [SAMPLES_PER_SCRAMBLE [WINDOW_SIDE]]      default 4096 12

#include <time.h>

#include <cstdlib>

#include "core/errors.h"
#include "core/text.h"
#include "sim/render_comparison.h"

namespace etalon {
namespace {

double cpu_ms() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

// Of a whole frame, kernels ready: the smallest of three.
double frame_ms(const BenchmarkScene& scene) {
    const Renderer renderer(scene.camera);
    renderer.render(scene.scene);
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
        const double start = cpu_ms();
        renderer.render(scene.scene);
        least = std::min(least, cpu_ms() - start);
    }
    return least;
}

void print_table(int samples, int side) {
    fmt::print("{:<12} {:<7} {:>2} {:>9} {:>7} {:>9} {:>9} {:>8} {:>9} {:>8}\n", "scene", "method",
               "k", "blur px", "pixels", "RMS gray", "corrected", "max gray", "ref s.e.", "CPU ms");
    for (const BenchmarkScene& scene : benchmark_scenes()) {
        ReferenceOptions reference;
        reference.samples_per_scramble = samples;
        const RenderComparison c = compare_with_reference(scene, side, reference);
        const char* method = c.plan.method == RenderMethod::exact_lens ? "E" : "C";
        fmt::print(
            "{:<12} {:<7} {:>2} {:>9} {:>7} {:>9.4f} {:>9.4f} {:>8.3f} {:>9.4f} {:>8.1f}\n",
            scene.name, method, c.plan.points_per_pixel_side,
            fmt::format("{:.2f}-{:.2f}", c.plan.min_blur_radius_px, c.plan.max_blur_radius_px),
            c.pixels, c.rms_gray, c.corrected_rms_gray(), c.max_gray, c.reference_rms_gray,
            frame_ms(scene));
        std::fflush(stdout);
    }
}

int number(const char* text) {
    const auto value = parse_integer(text);
    if (!value || *value < 1 || *value > 1 << 20)
        throw ConfigError({"render_accuracy"}, fmt::format("not a count: {}", text));
    return static_cast<int>(*value);
}

}  // namespace
}  // namespace etalon

int main(int argc, char** argv) {
    try {
        etalon::print_table(argc > 1 ? etalon::number(argv[1]) : 4096,
                            argc > 2 ? etalon::number(argv[2]) : 12);
        return EXIT_SUCCESS;
    } catch (const etalon::Error& error) {
        fmt::print(stderr, "{}\n", error.what());
        return 3;
    }
}
