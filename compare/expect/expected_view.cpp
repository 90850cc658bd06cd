#include "compare/expect/expected_view.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "compare/make_detector.h"
#include "sim/scene/marker_view.h"

namespace etalon {
namespace {

// Grown to borders of squares of `step` px.
cv::Rect on_squares(const cv::Rect& area, int step) {
    const auto down = [&](int pixel) { return pixel / step * step; };
    return cv::Rect(cv::Point(down(area.x), down(area.y)),
                    cv::Point(down(area.br().x + step - 1), down(area.br().y + step - 1)));
}

// Frame numbers of the noise that no device's frames have: with the seed of a twin by chance the
// noise of photograph and render would be the same.
constexpr std::uint32_t first_frame = 0xE0000000u;

using Exposures = std::vector<std::optional<DetectedCorners>>;

// Those in which the whole marker was detected.
std::vector<const DetectedCorners*> whole_of(const Exposures& seen) {
    std::vector<const DetectedCorners*> whole;
    for (const auto& corners : seen)
        if (corners && corners->is_whole())
            whole.push_back(&*corners);
    return whole;
}

// Nothing when half of them or more are missing.
std::optional<ImagePoints> mean_of(const Exposures& seen) {
    const auto whole = whole_of(seen);
    if (2 * whole.size() <= seen.size())
        return std::nullopt;
    ImagePoints mean(whole.front()->pixels.size(), Eigen::Vector2d::Zero());
    for (const DetectedCorners* corners : whole)
        for (std::size_t k = 0; k < mean.size(); ++k)
            mean[k] += corners->pixels[k];
    for (Eigen::Vector2d& corner : mean)
        corner /= static_cast<double>(whole.size());
    return mean;
}

}  // namespace

bool states_noise(const CameraModel& camera) {
    return camera.sensor && camera.sensor->gain_e_per_dn > 0.0;
}

bool is_rendered(const CellGrid& marker, const Rigid& camera_from_marker,
                 const CameraModel& camera) {
    return static_cast<bool>(attempted([&] {
        check_reach({{{marker, camera_from_marker}}}, camera);
    }));
}

ExpectedView::ExpectedView(const ExpectedScene& scene)
    : renderer_(scene.camera),
      projector_(scene.camera),
      sensor_(scene.camera),
      marker_(scene.marker.grid),
      background_(scene.background),
      white_level_(scene.white_level) {}

RenderedPart ExpectedView::radiance_at(const Rigid& camera_from_marker) const {
    RenderedPart part = renderer_.render_part({{{marker_, camera_from_marker}}, background_},
                                              {.tolerance_gray = tolerance_gray});
    part.radiance = part.radiance * white_level_;
    part.background *= white_level_;
    return part;
}

CodeImage ExpectedView::at(const Rigid& camera_from_marker) const {
    return sensor_.expose(radiance_at(camera_from_marker));
}

cv::Rect ExpectedView::area_of(const Rigid& camera_from_marker) const {
    constexpr int points_a_side = 9, step_px = 16;
    constexpr double margin_px = 25.0;
    const CameraModel& camera = projector_.camera();
    const cv::Rect all(0, 0, camera.width, camera.height);
    const MarkerView view({marker_, camera_from_marker}, background_, aperture_of(camera));
    const cv::Rect area = pixels_around(marker_outline(view, projector_, points_a_side),
                                        Eigen::Array2d::Constant(margin_px), all);
    return area.empty() ? all : on_squares(area, step_px) & all;
}

ExpectedExposures::ExpectedExposures(const ExpectedView& view, const Rigid& camera_from_marker)
    : sensor_(view.sensor()), whole_(view.radiance_at(camera_from_marker)) {
    area_.region = view.area_of(camera_from_marker);
    area_.radiance = whole_.within(area_.region);
    area_.background = whole_.background;
}

std::optional<DetectedCorners> ExpectedExposures::without_noise(Detector& detector) const {
    return detector.detect(without_noise()).corners;
}

std::optional<DetectedCorners> ExpectedExposures::with_noise(Detector& detector,
                                                             const NoiseKey& noise) const {
    auto corners = detector.detect(sensor_.expose_region(area_, noise)).corners;
    if (corners)
        for (Eigen::Vector2d& pixel : corners->pixels)
            pixel += Eigen::Vector2d(area_.region.x, area_.region.y);
    return corners;
}

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

std::optional<ImagePoints> RenderedCorners::at(const Rigid& camera_from_marker) const {
    return mean_of(exposed_at(camera_from_marker));
}

std::optional<CornerNoise> RenderedCorners::noise_at(const Rigid& camera_from_marker) const {
    const auto seen = exposed_at(camera_from_marker);
    const auto mean = mean_of(seen);
    if (!mean)
        return std::nullopt;
    const auto whole = whole_of(seen);
    double squares = 0.0;
    for (const DetectedCorners* corners : whole)
        for (std::size_t k = 0; k < mean->size(); ++k)
            squares += (corners->pixels[k] - (*mean)[k]).squaredNorm();
    if (whole.size() < 2 || !(squares > 0.0))
        return std::nullopt;
    const double freedom =
        2.0 * static_cast<double>(mean->size()) * (static_cast<double>(whole.size()) - 1.0);
    return CornerNoise{squares / freedom / frames_, freedom};
}

}  // namespace etalon
