// The folder of a study (report/result_rows.h):
//
//   study.json     what the results follow from: the study, its camera, the program's version
//   results.csv    a line per pose, variant and detector, in this order
//
// and, once all of it is there, what is made of it (study/study_report.h). Layout of the files:
// docs/study.md.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "study/study_description.h"

namespace etalon {

// Writes a study's results. Not thread-safe.
class StudyRecord {
public:
    // Makes the folder, or continues the one that was made with the same study; what was half
    // written is cut off. Throws ConfigError (place --out) when the folder holds something else or
    // a study that differs: in what, is said. Throws it too while another program writes there.
    StudyRecord(const std::filesystem::path& folder, const StudyDescription& description);

    const std::filesystem::path& folder() const { return rows_.folder(); }
    std::size_t poses_done() const { return rows_.units_done(); }  // of the shard

    // Poses must come in order. Lines are in the file when this returns; throws ConfigError when
    // they cannot be written.
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

}  // namespace etalon
