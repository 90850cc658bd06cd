// What `etalon plan` and `etalon oc` share: the station's plan with what its detector makes of it.
#pragma once

#include <filesystem>
#include <memory>

#include "station/foresee/simulated_run.h"

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

// "The detector: corner noise 0.017 px a frame, ..." as lines of at most 80 columns.
std::string detector_text(const DetectorStudy& study);

// A size with its unit, for people: "0.182 %" of a relative one, "0.31 px".
std::string size_text(double size, const std::string& unit);

}  // namespace etalon
