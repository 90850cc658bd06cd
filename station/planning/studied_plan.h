// What `etalon plan` and `etalon oc` share: the station's plan with what its detector makes of it.
#pragma once

#include <filesystem>
#include <memory>

#include "station/planning/simulated_run.h"

namespace etalon {

struct StudiedPlan {
    StationFile station;
    Plan plan;
    std::unique_ptr<const RunSimulator> simulator;
};

// Reads the station, plans, and renders and detects every pose with `noisy_frames` different
// noises, with progress on stderr. Throws ConfigError as read_station, plan_of and
// study_detector do.
StudiedPlan study_plan(const std::filesystem::path& station, int noisy_frames);

// What is said of a detector's study (compare/expect/detector_study.h).
struct DetectorFigures {
    double noise_px = 0.0, bias_px = 0.0, noise_bias_px = 0.0;
    int frames = 0, seen = 0, poses = 0;  // seen: poses whose marker is detected
};
DetectorFigures figures_of(const DetectorStudy& study);

// "The detector: corner noise 0.017 px a frame, ..." as lines of at most 80 columns.
std::string detector_text(const DetectorFigures& detector);

// A size with its unit, for people: "0.182 %" of a relative one, "0.31 px".
std::string size_text(double size, const std::string& unit);

}  // namespace etalon
