// The results of a study, read back: what its statistics and its report are made from.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "compare/expect/pose_statistics.h"
#include "study/study_description.h"

namespace etalon {

// The first line of results.csv, with its end.
std::string results_header(const StudyDescription& description);

// The results of a whole study, read back.
struct StudyResults {
    StudyDescription description;
    std::vector<PoseComponents> truth;                // by pose
    std::vector<std::vector<double>> axes;            // by axis, by pose
    std::vector<std::vector<double>> sizes_px;        // by detector, by pose
    std::vector<std::vector<DetectorErrors>> errors;  // by variant, by detector
    // The same, by pose; nothing where there are no corners.
    std::vector<std::vector<std::vector<std::optional<double>>>> corner_rms_px;
    // By detector: why it has no pose, and how often, in the study as it is.
    std::vector<std::map<std::string, std::size_t>> failures;
    std::size_t refused = 0;  // poses that could not be rendered
};

// Throws ConfigError with file and line for results that are not whole or not as they were written.
// 0.5 us a line and number; 120 bytes a line.
StudyResults read_results(const std::filesystem::path& folder);

}  // namespace etalon
