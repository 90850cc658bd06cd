// What a reader of a study's results must know of the study, and what the results follow from:
// study.json in its folder. Two runs may be continued, or merged, where it is the same.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "report/result_rows.h"
#include "study/study_evaluation.h"

namespace etalon {

// An axis that is drawn along with the poses: a disturbance or the focus distance.
struct StudyAxis {
    std::string name, unit;
    friend bool operator==(const StudyAxis&, const StudyAxis&) = default;
};

// What a reader of the results must know of the study.
struct StudyDescription {
    struct DetectorEntry {
        std::string name, detector, marker;
    };
    std::string id;
    std::string camera;  // in words, for people
    std::size_t poses = 0;
    std::string volume;  // in words
    std::vector<DetectorEntry> detectors;
    std::vector<std::string> variants;
    std::vector<StudyAxis> axes;
    Shard shard;
    std::string made_from;  // JSON: hashes of files, seeds; equal where results must be

    std::size_t rows_per_pose() const { return detectors.size() * variants.size(); }
};

inline constexpr ShardedWork study_work{"study", "pose", "study merge", "study.json"};

StudyDescription describe(const StudyFile& study, const std::filesystem::path& file,
                          const std::vector<StudyVariant>& variants, const Shard& shard);

// Of the folder's study.json. Throws ConfigError for a folder without one or with another's.
StudyDescription read_description(const std::filesystem::path& folder);

// What study.json says, as JSON.
std::string description_text(const StudyDescription& description);

}  // namespace etalon
