// What a reader of a study's results must know of the study, and what the results follow from:
// study.json in its folder. Two runs may be continued, or merged, where it is the same.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "study/study_evaluation.h"

namespace etalon {

// Part `index` of `count`: the poses index - 1, index - 1 + count, ...
struct StudyShard {
    std::size_t index = 1, count = 1;

    bool is_all() const { return count == 1; }
    bool holds(std::size_t pose) const { return pose % count == index - 1; }
    std::size_t poses(std::size_t of) const { return (of + count - index) / count; }
};
// "2/5"; throws ConfigError at --shard for anything else.
StudyShard parse_shard(const std::string& text);

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
    StudyShard shard;
    std::string made_from;  // JSON: hashes of files, seeds; equal where results must be

    std::size_t rows_per_pose() const { return detectors.size() * variants.size(); }
};

StudyDescription describe(const StudyFile& study, const std::filesystem::path& file,
                          const std::vector<StudyVariant>& variants, const StudyShard& shard);

// Of the folder's study.json. Throws ConfigError for a folder without one or with another's.
StudyDescription read_description(const std::filesystem::path& folder);

std::string description_text(const StudyDescription& description);

// The first entry of study.json in which the two differ, its path inside; empty if none does.
std::string first_difference(const StudyDescription& one, const StudyDescription& other);

}  // namespace etalon
