#include "station/rendered_corners.h"

#include <tbb/parallel_for.h>

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

RenderedCorners::RenderedCorners(const StationFile& station)
    : view_(station.camera.model, station.marker.grid, station.background, station.white_level),
      seed_(station.plan.seed) {
    const int exposures = states_noise(station.camera.model) ? noisy_exposures : 1;
    for (int i = 0; i < exposures; ++i)
        detectors_.push_back(make_detector(station.detector, station.marker, station.detector));
}

double RenderedCorners::noise_ratio(const StationFile& station) {
    return states_noise(station.camera.model) ? double(station.plan.frames) / noisy_exposures : 0.0;
}

std::optional<std::vector<Eigen::Vector2d>> RenderedCorners::at(
    const Rigid& camera_from_marker) const {
    const ExpectedExposures exposures(view_, camera_from_marker);
    std::vector<std::optional<DetectedCorners>> seen(detectors_.size());
    if (seen.size() == 1)
        seen[0] = exposures.without_noise(*detectors_[0]);
    else
        tbb::parallel_for(std::size_t{0}, seen.size(), [&](std::size_t i) {
            const auto frame = first_frame + static_cast<std::uint32_t>(i);
            seen[i] = exposures.with_noise(*detectors_[i], {seed_, frame});
        });
    return mean_of(seen);
}

}  // namespace etalon
