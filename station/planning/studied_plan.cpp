#include "station/planning/studied_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compare/expect/expected_view.h"
#include "core/program/errors.h"
#include "station/shell/command_output.h"

namespace etalon {
namespace {

void require_noise(const StationFile& station) {
    const auto& sensor = station.camera.model.sensor;
    if (!sensor || !(sensor->gain_e_per_dn > 0.0))
        throw ConfigError({station.inputs.at(1).path.string(), 0, "sensor.gain_e_per_dn"},
                          "is needed: without the sensor's noise nothing can be said of a run's "
                          "uncertainty (`etalon characterise` measures it)");
}

}  // namespace

StudiedPlan study_plan(const std::filesystem::path& path, int noisy_frames) {
    StudiedPlan studied;
    studied.station = read_station(path);
    const StationFile& station = studied.station;
    studied.plan = plan_of(station);
    require_noise(station);
    const std::vector<Rigid> poses = expected_poses(station, studied.plan);
    StderrProgress progress;
    progress.begin("rendering", static_cast<int>(poses.size()),
                   poses.size() * noisy_frames * std::chrono::milliseconds(12));
    DetectorStudy study = study_detector(expected_scene(station), poses, noisy_frames,
                                         station.plan.seed, [&] { progress.count(); });
    progress.end();
    studied.simulator =
        std::make_unique<const RunSimulator>(station, studied.plan, std::move(study));
    return studied;
}

DetectorFigures figures_of(const DetectorStudy& study) {
    const auto seen = std::count_if(study.poses.begin(), study.poses.end(),
                                    [](const auto& pose) { return pose.has_value(); });
    return {study.noise_px, study.bias_px,          study.noise_bias_px,
            study.frames,   static_cast<int>(seen), static_cast<int>(study.poses.size())};
}

std::string detector_text(const DetectorFigures& detector) {
    return fmt::format(
        "the marker is detected in {} of {} poses ({} noisy renders of each)\n"
        "corner noise {:.4f} px a frame; the detector's bias {:.4f} px, of which noise moves {:.4f}"
        " px\n",
        detector.seen, detector.poses, detector.frames, detector.noise_px, detector.bias_px,
        detector.noise_bias_px);
}

std::string size_text(double size, const std::string& unit) {
    if (!std::isfinite(size))
        return "-";
    if (unit == "1")
        return std::abs(size) < 1e-3 ? fmt::format("{:.3g} ppm", 1e6 * size)
                                     : fmt::format("{:.3g} %", 100.0 * size);
    if (unit == "rad")
        return fmt::format("{:.3g} mrad", 1e3 * size);
    return unit.empty() ? fmt::format("{:.3g}", size) : fmt::format("{:.3g} {}", size, unit);
}

}  // namespace etalon
