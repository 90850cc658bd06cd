// Prints what the TopoTag detector does on exact renders:
//   1. the published comparison's poses: detection rate and vertex errors over the tag's size,
//      without and with a tone curve;
//   2. tags of at least 60 px tilted by up to 60 degrees;
//   3. ids that are not there, in images with and without tags of every family;
//   4. CPU time for 640 x 480.
// Arguments: POSES IMAGES, default 2000 100000. About twenty minutes of CPU time.
#include <tbb/parallel_for.h>

#include <atomic>
#include <cstdlib>
#include <map>

#include "core/statistics/distributions.h"
#include "core/time/clock.h"
#include "tests/evidence/topotag_study.h"

namespace etalon::test {
namespace {

struct SizeClass {
    int tags = 0, found = 0;
    std::vector<double> errors;  // px, of each vertex
};

struct PoseStudy {
    const char* title;
    CameraModel camera;
    std::string family;
    double near_mm, far_mm, tilt_deg, least_side_px;
};

double quantile(std::vector<double> values, double part) {
    const auto place =
        values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), place, values.end());
    return *place;
}

void print_class(const std::string& name, const SizeClass& size) {
    fmt::print("| {} | {} | {:.1f} % |", name, size.tags, 100.0 * size.found / size.tags);
    if (size.errors.empty())
        fmt::print(" | |\n");
    else
        fmt::print(" {:.4f} | {:.4f} |\n", median(size.errors), quantile(size.errors, 0.99));
}

void study_poses(const PoseStudy& study, int count) {
    const Renderer renderer(study.camera);
    const SensorModel sensor(study.camera);
    const Projector projector(study.camera);
    std::map<int, SizeClass> sizes;
    SizeClass all;
    std::mutex mutex;
    std::atomic<int> wrong = 0;
    tbb::parallel_for(0, count, [&](int i) {
        Draw draw(1, static_cast<std::uint64_t>(i));
        const Marker tag = Distraction::random_tag(draw, study.family, 50.0);
        SeenTag seen;
        do
            seen = study_pose(projector, tag, draw, study.near_mm, study.far_mm, study.tilt_deg);
        while (seen.side_px < study.least_side_px);
        const Scene scene{{{tag.grid, seen.camera_from_marker}}, 1.0};
        const CodeImage image =
            sensor.expose(with_noise(renderer.render(scene).radiance, study.camera, draw));
        const auto tags = find_in(image, study.family);
        const std::lock_guard lock(mutex);
        SizeClass& size = sizes[static_cast<int>(seen.side_px / 10.0) * 10];
        ++size.tags;
        ++all.tags;
        for (const DetectedCorners& found : tags) {
            if (found.id != tag.id) {
                ++wrong;
                continue;
            }
            ++size.found;
            ++all.found;
            for (std::size_t v = 0; v < found.pixels.size(); ++v) {
                size.errors.push_back((found.pixels[v] - seen.vertices[v]).norm());
                all.errors.push_back(size.errors.back());
            }
        }
    });
    fmt::print(
        "\n{}\n\n| side, px | tags | found | median error, px | 99 % below |\n"
        "|---|---|---|---|---|\n",
        study.title);
    for (const auto& [side, size] : sizes)
        print_class(fmt::format("{} to {}", side, side + 10), size);
    print_class("all", all);
    fmt::print("\nwrong ids: {}\n", wrong.load());
    std::fflush(stdout);
}

struct FalseIds {
    std::map<std::string, std::array<int, 3>> by_kind;  // images, tags found, wrong
    std::mutex mutex;

    void add(const std::string& kind, int found, int wrong) {
        const std::lock_guard lock(mutex);
        auto& row = by_kind[kind];
        ++row[0];
        row[1] += found;
        row[2] += wrong;
    }
};

// Where a tag is: the same id and no vertex more than 2 px off.
bool is_there(const DetectedCorners& found, int id, const SeenTag& seen) {
    for (std::size_t v = 0; v < found.pixels.size(); ++v)
        if (!((found.pixels[v] - seen.vertices[v]).norm() < 2.0))
            return false;
    return found.id == id;
}

// A camera that may be out of focus, noisy, and have a tone curve.
struct AnyCamera {
    explicit AnyCamera(const CameraModel& camera)
        : renderer(camera), sensor(camera), projector(camera) {}
    Renderer renderer;
    SensorModel sensor;
    Projector projector;
};

std::vector<AnyCamera> any_cameras(int width, int height) {
    std::vector<AnyCamera> cameras;
    for (const double focus_mm : {200.0, 400.0, 1000.0, 2000.0})
        for (const double gain : {40.0, 8.0, 2.0}) {
            CameraModel camera = cropped(study_camera(), width, height);
            camera.lens->focus_distance_mm = focus_mm;
            camera.sensor->gain_e_per_dn = gain;
            cameras.emplace_back(camera);
            cameras.emplace_back(with_tone_curve(camera));
        }
    return cameras;
}

// Any size down to where nothing is found any more, exposed dark to clipped, on any background.
void show_tag(const AnyCamera& camera, std::uint64_t index, const std::string& family,
              FalseIds& result) {
    Draw draw(5, index);
    const Marker tag = Distraction::random_tag(draw, family, 50.0);
    const SeenTag seen = study_pose(camera.projector, tag, draw, 250.0, 2200.0, 60.0);
    const Scene scene{{{tag.grid, seen.camera_from_marker}}, draw.between(0.0, 1.0)};
    const Radiance radiance =
        camera.renderer.render(scene, {.tolerance_gray = 0.5}).radiance * draw.between(0.2, 1.2);
    const CodeImage image =
        camera.sensor.expose(with_noise(radiance, camera.renderer.camera(), draw));
    int wrong = 0;
    const auto tags = find_in(image, family);
    for (const DetectedCorners& found : tags)
        wrong += is_there(found, tag.id, seen) ? 0 : 1;
    result.add("the tag itself", static_cast<int>(tags.size()), wrong);
    if (wrong > 0)
        fmt::print("wrong: image {}, {}, {:.1f} px\n", index, tag.spec, seen.side_px);
}

void look_at(int image, const std::vector<AnyCamera>& cameras, const Distraction& distraction,
             FalseIds& result) {
    const auto index = static_cast<std::uint64_t>(image);
    const auto& families = topotag_families();
    // Squares come first in the list; round tags, which take long to render, in one of 4 images.
    const std::size_t turn = index / 48 % 16;
    const std::string& family = families[turn < 12 ? turn % 4 : 4 + turn % 4];
    if (image % 2 == 0) {
        show_tag(cameras[index / 2 % cameras.size()], index, family, result);
        return;
    }
    const int kind = static_cast<int>(index / 16 % Distraction::kinds);
    const int found =
        static_cast<int>(find_in(distraction.picture(kind, index, family), family).size());
    result.add(Distraction::names[kind], found, found);
    if (found > 0)
        fmt::print("found in {}, image {}, {}\n", Distraction::names[kind], index, family);
}

// The table after every ten thousand images, so that a run that is ended has a result.
void count_false_ids(int images) {
    constexpr int part = 10000;
    const std::vector<AnyCamera> cameras = any_cameras(320, 240);
    const Distraction distraction(cameras[0].renderer, cameras[0].sensor);
    FalseIds result;
    for (int first = 0; first < images; first += part) {
        const int last = std::min(images, first + part);
        tbb::parallel_for(first, last, [&](int i) { look_at(i, cameras, distraction, result); });
        fmt::print(
            "\nof {} images\n\n| images | number | tags found | of them wrong |\n"
            "|---|---|---|---|\n",
            last);
        for (const auto& [kind, row] : result.by_kind)
            fmt::print("| {} | {} | {} | {} |\n", kind, row[0], row[1], row[2]);
        std::fflush(stdout);
    }
}

void measure_time() {
    const CameraModel camera = study_camera();
    const Renderer renderer(camera);
    const SensorModel sensor(camera);
    const Projector projector(camera);
    cv::setNumThreads(1);
    constexpr int images = 50;
    double ms = 0.0;
    for (int i = 0; i < images; ++i) {
        Draw draw(9, static_cast<std::uint64_t>(i));
        const Marker tag = Distraction::random_tag(draw, "4x4", 50.0);
        const SeenTag seen = study_pose(projector, tag, draw, 300.0, 1500.0, 45.0);
        const Scene scene{{{tag.grid, seen.camera_from_marker}}, 0.7};
        const CodeImage image =
            sensor.expose(with_noise(renderer.render(scene).radiance, camera, draw));
        const double start = process_cpu_ms();
        find_in(image, "4x4");
        ms += (process_cpu_ms() - start) / images;
    }
    fmt::print("\n{:.1f} ms of CPU time for an image of 640 x 480 with a tag\n", ms);
}

}  // namespace
}  // namespace etalon::test

int main(int argc, char** argv) {
    using namespace etalon::test;
    const int poses = argc > 1 ? std::atoi(argv[1]) : 2000;
    const int images = argc > 2 ? std::atoi(argv[2]) : 100000;
    measure_time();
    const auto camera = study_camera(), tone = with_tone_curve(camera);
    if (poses > 0) {
        study_poses({"published poses, 4x4, linear", camera, "4x4", 500, 1500, 45, 0}, poses);
        study_poses({"published poses, 4x4, Rec. 709", tone, "4x4", 500, 1500, 45, 0}, poses);
        study_poses({"published poses, 4x4-circle, linear", camera, "4x4-circle", 500, 1500, 45, 0},
                    poses);
        study_poses({"at least 60 px, 60 degrees, 4x4", camera, "4x4", 250, 700, 60, 60}, poses);
        study_poses({"at least 60 px, 60 degrees, 5x5-circle, Rec. 709", tone, "5x5-circle", 250,
                     700, 60, 60},
                    poses);
    }
    if (images > 0)
        count_false_ids(images);
}
