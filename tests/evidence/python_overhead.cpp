// What one call costs in C++, for tests/evidence/python_overhead.sh: names and the best of several
// times, a line each.
#include <fmt/format.h>

#include <chrono>
#include <limits>

#include "calib/camera/projector.h"
#include "calib/files/camera_file.h"
#include "core/statistics/random.h"
#include "sim/marker/marker.h"
#include "sim/render/renderer.h"

namespace etalon {
namespace {

template <class Work>
void measure(const char* name, int times, Work work) {
    double best_ms = std::numeric_limits<double>::infinity();
    for (int i = 0; i < times; ++i) {
        const auto start = std::chrono::steady_clock::now();
        work();
        const std::chrono::duration<double, std::milli> took =
            std::chrono::steady_clock::now() - start;
        best_ms = std::min(best_ms, took.count());
    }
    fmt::print("{}\t{:.4f}\n", name, best_ms);
}

// A million of them, before the camera.
std::vector<Eigen::Vector3d> points() {
    RandomStream random(7, 0, 0);
    std::vector<Eigen::Vector3d> all(1'000'000);
    for (Eigen::Vector3d& point : all)
        point = {300.0 * random.uniform() - 150.0, 200.0 * random.uniform() - 100.0,
                 300.0 + 500.0 * random.uniform()};
    return all;
}

void measure_all(const std::filesystem::path& camera_file) {
    const CameraModel camera = read_any_camera(camera_file);
    const Projector projector(camera);
    const std::vector<Eigen::Vector3d> at = points();
    const Eigen::Vector2d none =
        Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
    std::vector<Eigen::Vector2d> pixels(at.size());
    measure("project 1e6 points", 9, [&] {
        for (std::size_t i = 0; i < at.size(); ++i)
            pixels[i] = projector.project(at[i]).value_or(none);
    });
    std::vector<Eigen::Vector3d> rays(at.size());
    measure("unproject 1e6 pixels", 5, [&] {
        for (std::size_t i = 0; i < at.size(); ++i)
            rays[i] = projector.ray(pixels[i]).value_or(Eigen::Vector3d::Zero());
    });
    measure("1000 calls of 1 point", 99, [&] {
        for (std::size_t i = 0; i < 1000; ++i)
            pixels[i] = projector.project(at[i]).value_or(none);
    });
    const Renderer renderer(camera);
    const Scene scene{{{parse_marker("apriltag:36h11:5@80mm", "marker").grid,
                        rigid_from_vector({0.3, -0.2, 0.1, 20.0, -10.0, 400.0})}}};
    measure("render a tag", 50, [&] { renderer.render(scene); });
}

}  // namespace
}  // namespace etalon

int main(int, char** argv) {
    etalon::measure_all(argv[1]);
}
