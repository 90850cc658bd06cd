#include "compare/expect/rendered_corners.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "compare/make_detector.h"

namespace etalon {
namespace {

// Frame numbers of the noise that no device's frames have: with the seed of a twin by chance the
// noise of photograph and render would be the same.
constexpr std::uint32_t first_frame = 0xE0000000u;

bool states_noise(const CameraModel& camera) {
    return camera.sensor && camera.sensor->gain_e_per_dn > 0.0;
}

// Nothing when half of them or more are missing.
std::optional<std::vector<Eigen::Vector2d>> mean_of(
    const std::vector<std::optional<DetectedCorners>>& seen) {
    std::vector<Eigen::Vector2d> mean;
    std::size_t count = 0;
    for (const auto& corners : seen) {
        if (!corners || !corners->is_whole())
            continue;
        ++count;
        mean.resize(corners->pixels.size(), Eigen::Vector2d::Zero());
        for (std::size_t k = 0; k < mean.size(); ++k)
            mean[k] += corners->pixels[k];
    }
    if (2 * count <= seen.size())
        return std::nullopt;
    for (Eigen::Vector2d& corner : mean)
        corner /= static_cast<double>(count);
    return mean;
}

}  // namespace

RenderedCorners::RenderedCorners(const ExpectedScene& scene, int frames, std::uint64_t seed)
    : view_(scene),
      detectors_([name = scene.detector, marker = scene.marker] {
          return make_detector(name, marker, name);
      }),
      frames_(frames),
      exposures_(states_noise(scene.camera) ? exposures_per_frame * frames : 1),
      seed_(seed) {
    detectors_.local();  // whether there is one
}

double RenderedCorners::noise_ratio(const CameraModel& camera) {
    return states_noise(camera) ? 1.0 / exposures_per_frame : 0.0;
}

std::vector<std::optional<DetectedCorners>> RenderedCorners::exposed_at(
    const Rigid& camera_from_marker) const {
    if (!view_.takes(camera_from_marker))
        return {};
    const ExpectedExposures exposures(view_, camera_from_marker);
    if (exposures_ == 1)
        return {exposures.without_noise(*detectors_.local())};
    std::vector<std::optional<DetectedCorners>> seen(static_cast<std::size_t>(exposures_));
    // Isolated: a thread that waits in its detector must not begin another exposure with it.
    tbb::parallel_for(std::size_t{0}, seen.size(), [&](std::size_t i) {
        const auto frame = first_frame + static_cast<std::uint32_t>(i);
        tbb::this_task_arena::isolate([&] {
            seen[i] = exposures.with_noise(*detectors_.local(), {seed_, frame});
        });
    });
    return seen;
}

std::optional<std::vector<Eigen::Vector2d>> RenderedCorners::at(
    const Rigid& camera_from_marker) const {
    return mean_of(exposed_at(camera_from_marker));
}

std::optional<RenderedCorners::Noise> RenderedCorners::noise_at(
    const Rigid& camera_from_marker) const {
    const auto seen = exposed_at(camera_from_marker);
    const auto mean = mean_of(seen);
    if (!mean)
        return std::nullopt;
    double squares = 0.0;
    int count = 0;
    for (const auto& corners : seen) {
        if (!corners || !corners->is_whole())
            continue;
        ++count;
        for (std::size_t k = 0; k < mean->size(); ++k)
            squares += (corners->pixels[k] - (*mean)[k]).squaredNorm();
    }
    if (count < 2 || !(squares > 0.0))
        return std::nullopt;
    const double freedom = 2.0 * static_cast<double>(mean->size()) * (count - 1.0);
    return Noise{squares / freedom / frames_, freedom};
}

}  // namespace etalon
