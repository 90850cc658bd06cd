#include "station/rendered_corners.h"

namespace etalon {
namespace {

// Frame numbers of the noise that no device's frames have: with the seed of a twin by chance the
// noise of photograph and render would be the same.
constexpr std::uint32_t first_frame = 0xE0000000u;

bool states_noise(const CameraModel& camera) {
    return camera.sensor && camera.sensor->gain_e_per_dn > 0.0;
}

}  // namespace

RenderedCorners::RenderedCorners(const StationFile& station, Detector& detector)
    : view_(station.camera.model, station.marker.grid, station.background, station.white_level),
      sensor_(station.camera.model),
      detector_(detector),
      exposures_(states_noise(station.camera.model) ? noisy_exposures : 1),
      seed_(station.plan.seed) {}

std::optional<std::vector<Eigen::Vector2d>> RenderedCorners::at(
    const Rigid& camera_from_marker) const {
    const Radiance radiance = view_.radiance_at(camera_from_marker);
    std::vector<Eigen::Vector2d> sum;
    int seen = 0;
    for (int i = 0; i < exposures_; ++i) {
        std::optional<NoiseKey> noise;
        if (exposures_ > 1)
            noise = NoiseKey{seed_, first_frame + static_cast<std::uint32_t>(i)};
        const auto detected = detector_.detect(sensor_.expose(radiance, noise));
        if (!detected)
            continue;
        ++seen;
        sum.resize(detected->pixels.size(), Eigen::Vector2d::Zero());
        for (std::size_t k = 0; k < sum.size(); ++k)
            sum[k] += detected->pixels[k];
    }
    if (2 * seen <= exposures_)
        return std::nullopt;
    for (Eigen::Vector2d& corner : sum)
        corner /= seen;
    return sum;
}

}  // namespace etalon
