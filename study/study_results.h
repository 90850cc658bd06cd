// A study's results as study.json and results.csv (docs/study.md), written and read back.
#pragma once

#include "report/result_rows.h"
#include "study/study_evaluation.h"

namespace etalon {

// An axis that is drawn along with the poses: a disturbance or the focus distance.
struct StudyAxis {
    std::string name, unit;
    friend bool operator==(const StudyAxis&, const StudyAxis&) = default;
};

// What the results follow from. Where it is the same, runs can be continued or merged.
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

StudyDescription describe(const StudyFile& study, const std::filesystem::path& file,
                          const std::vector<StudyVariant>& variants, const Shard& shard);

// Of the folder's study.json. Throws ConfigError for a folder without one or with another's.
StudyDescription read_description(const std::filesystem::path& folder);

// Writes a study's results. Not thread-safe.
class StudyRecord {
public:
    // Makes the folder, or continues the one that was made with the same study; what was half
    // written is cut off. Throws ConfigError (place --out) when the folder holds something else or
    // a study that differs: in what, is said. Throws it too while another program writes there.
    StudyRecord(const std::filesystem::path& folder, const StudyDescription& description);

    const std::filesystem::path& folder() const { return rows_.folder(); }
    std::size_t poses_done() const { return rows_.units_done(); }  // of the shard

    // Poses come in order. Lines are in the file when this returns; throws ConfigError.
    void add(const StudyPose& pose, const std::vector<double>& axis_values,
             const std::vector<StudyFinding>& findings);

private:
    StudyDescription description_;
    RowRecord rows_;
};

// Writes study.json and results.csv of the whole into `out`, from all of its shards in any order.
// Throws ConfigError for shards that are missing, doubled, unfinished or of different studies.
void merge_shards(const std::vector<std::filesystem::path>& shards,
                  const std::filesystem::path& out);

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

// Throws ConfigError with file and line for others. 0.5 us a line and number; 120 bytes a line.
StudyResults read_results(const std::filesystem::path& folder);

}  // namespace etalon
